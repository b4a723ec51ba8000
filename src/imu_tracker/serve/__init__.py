"""What others see and hear of the track: live page, gpsd JSON, NMEA.

In: the log and the status file. Out: three listening ports. Not here: sensors,
estimation and the daemon, which know nothing of this program and do not notice when it
hangs, crashes or is attacked.
"""

__all__ = ["server"]
