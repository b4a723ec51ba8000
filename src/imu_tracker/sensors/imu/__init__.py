"""The MPU-6050 and its relatives.

In: a bus (three methods of `smbus2.SMBus`). Out: `Frame` of 14 bytes with the instant
of sampling. `chips` holds the table of known chips. Not here: calibration and units
(`calibration/`), choice of bus (`sources/`).
"""

__all__ = ["i2c", "mpu6050", "reader", "selftest", "setup", "sources"]
