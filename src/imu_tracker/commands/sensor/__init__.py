"""Commands about the sensor itself: calibrate, characterise, selftest.

In: parsed arguments. Out: an exit code. Not here: the fits (`calibration/`).
"""

__all__ = ["calibrate", "characterise", "selftest"]
