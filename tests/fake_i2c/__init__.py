"""A strict model of the MPU-6050 on an I2C bus that fails by plan.

    chip = FakeMpu6050(clock)
    bus = FakeBus(clock, {0x68: chip})

`bus` has the calls of `smbus2.SMBus`; `bus.open()` gives handles of their own, to be
closed, that die when the adapter is unplugged. The chip takes its time from any clock:
a `FakeClock`, or the real one for tests of the whole daemon.

Written from RM-MPU-6000A-00 rev. 4.2 (RM) and PS-MPU-6000A-00 rev. 3.4 (PS), with its
own numbers. It never imports the driver, and refuses what the chip refuses.
"""

from fake_i2c.bus import FakeBus
from fake_i2c.chip import DatasheetError, FakeMpu6050

__all__ = ["DatasheetError", "FakeBus", "FakeMpu6050"]
