"""The simulated chip: specific force and angular rate, then its errors, then counts.

In: exact motion. Out: bursts of 14 bytes. Not here: the I2C bus (`tests/fake_i2c`).
"""

__all__ = ["chip", "errors", "ideal", "noise", "rolling"]
