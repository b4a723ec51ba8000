"""How rows reach others: MQTT, Traccar, InfluxDB, and what is written on the wire.

In: rows that are due. Out: messages and requests, and which rows the other side has
said it has. Not here: which rows, in which order, and when to try again.
"""

__all__ = ["factory", "payloads", "sender"]
