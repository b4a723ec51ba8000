"""The doctor: probes sensors and outputs, and says how to mend what is missing.

In: the configuration. Out: lines of a report with advice. Not here: the retry policy of
the daemon.
"""

__all__ = ["destinations", "hardware", "sensors"]
