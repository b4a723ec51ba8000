"""Rows to others, each once and in order, also after weeks without a network.

In: the log, which is the outbox, and a cursor for each destination. Out: messages and
requests (`senders/`), the cursors, a status. Not here: sensors, estimation and the
daemon, which do not notice whether this program runs; a second copy of any row.
"""

__all__ = ["program", "trial"]
