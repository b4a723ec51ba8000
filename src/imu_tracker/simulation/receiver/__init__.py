"""The simulated receiver: errors, delay, and the sentences it sends.

In: exact motion. Out: NMEA lines with arrival times. Not here: parsing.
"""

__all__ = ["receiver"]
