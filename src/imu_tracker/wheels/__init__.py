"""Speed from the vibration of the wheels. Pure.

In: calibrated samples at the IMU's rate, and the speed of a filter over time. Out: by
how much that speed is wrong, where the wheels' orders can be heard. Not here: the
filter that takes it.
"""

__all__ = ["orders", "posterior", "speed", "windows"]
