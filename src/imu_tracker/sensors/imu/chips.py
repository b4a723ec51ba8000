"""The MPU-6050 and its relatives: who answers to WHO_AM_I, and how it differs.

About half of the modules sold as MPU-6050 carry another chip of the maker. They
share the register map as far as we use it; what differs is a row of these tables.
What a newcomer gets wrong: pin AD0 is not in the identity. A chip at 0x69 says 0x68.

Sources: RM-MPU-6000A-00 rev. 4.2; RM-MPU-6500A; RM-MPU-9250A rev. 1.6, section 4.5;
the scale and offset constants of the Linux driver inv_mpu6050.
"""

from enum import Enum
from struct import Struct
from typing import Final, NamedTuple

_TEMPERATURE: Final = Struct(">h")
_TEMPERATURE_AT: Final = slice(6, 8)  # in a burst, behind the accelerometer


class LowPass(NamedTuple):
    """One setting of the digital low-pass filter, as the gyro sees it."""

    dlpf_cfg: int
    bandwidth_hz: int
    delay_us: int
    internal_hz: int  # what the sample rate divider divides


_MPU6050_LOW_PASS: Final = (  # RM section 4.3
    LowPass(0, 256, 980, 8000),
    LowPass(1, 188, 1900, 1000),
    LowPass(2, 98, 2800, 1000),
    LowPass(3, 42, 4800, 1000),
    LowPass(4, 20, 8300, 1000),
    LowPass(5, 10, 13400, 1000),
    LowPass(6, 5, 18600, 1000),
)

_MPU6500_LOW_PASS: Final = (  # setting 0 is left out: the divider is dead there
    LowPass(1, 184, 2900, 1000),
    LowPass(2, 92, 3900, 1000),
    LowPass(3, 41, 5900, 1000),
    LowPass(4, 20, 9900, 1000),
    LowPass(5, 10, 17850, 1000),
    LowPass(6, 5, 33480, 1000),
)


class FamilyTraits(NamedTuple):
    """What the chips of a family have in common, where families differ."""

    temp_counts_per_degc: float
    temp_offset_degc: float  # at zero counts
    low_pass: tuple[LowPass, ...]
    has_own_accel_filter: bool  # ACCEL_CONFIG2
    has_mpu6050_trim: bool  # the self-test of the MPU-6050's datasheet applies


class Family(Enum):
    """Chips that a driver can treat alike."""

    MPU6050 = FamilyTraits(340.0, 36.53, _MPU6050_LOW_PASS, False, True)
    MPU6500 = FamilyTraits(333.87, 21.0, _MPU6500_LOW_PASS, True, False)
    ICM20608 = FamilyTraits(326.8, 25.0, _MPU6500_LOW_PASS, True, False)


class Chip(NamedTuple):
    """One kind of chip, by its WHO_AM_I.

    `fifo_bytes` is 0 where the FIFO is not known to hold the MPU-6050's frames;
    such a chip is read by bursts.
    """

    who_am_i: int
    name: str
    family: Family
    fifo_bytes: int
    is_known: bool = True

    def to_mpu6050(self, burst: bytes) -> bytes:
        """Rewrite the temperature field into the counts of the MPU-6050.

        A recording defines counts as the MPU-6050's; scales of accelerometer and
        gyro are the same in all families.
        """
        if self.family is Family.MPU6050:
            return burst
        own, reference = self.family.value, Family.MPU6050.value
        (raw,) = _TEMPERATURE.unpack(burst[_TEMPERATURE_AT])
        degc = raw / own.temp_counts_per_degc + own.temp_offset_degc
        counts = round(
            (degc - reference.temp_offset_degc) * reference.temp_counts_per_degc
        )
        field = _TEMPERATURE.pack(min(max(counts, -0x8000), 0x7FFF))
        return burst[: _TEMPERATURE_AT.start] + field + burst[_TEMPERATURE_AT.stop :]


_CHIPS: Final = (
    Chip(0x68, "MPU-6050", Family.MPU6050, 1024),  # also MPU-6000 and MPU-9150
    Chip(0x70, "MPU-6500", Family.MPU6500, 512),
    Chip(0x71, "MPU-9250", Family.MPU6500, 512),
    Chip(0x73, "MPU-9255", Family.MPU6500, 512),
    Chip(0x74, "MPU-6515", Family.MPU6500, 512),
    Chip(0x78, "MPU-6880", Family.MPU6500, 512),
    Chip(0x98, "ICM-20689", Family.ICM20608, 512),
    Chip(0xAF, "ICM-20608", Family.ICM20608, 512),
    Chip(0xAE, "ICM-20608D", Family.ICM20608, 512),
    Chip(0xA6, "ICM-20609", Family.ICM20608, 512),
    Chip(0xA9, "IAM-20680", Family.ICM20608, 512),
    # One switch for all gyro axes, and the temperature goes with it: other frames.
    Chip(0x11, "ICM-20600", Family.ICM20608, 0),
    Chip(0x12, "ICM-20602", Family.ICM20608, 0),
    Chip(0x20, "ICM-20690", Family.ICM20608, 0),
    Chip(0x19, "MPU-6886", Family.ICM20608, 0),
)

CHIPS: Final = {chip.who_am_i: chip for chip in _CHIPS}


def unknown_chip(who_am_i: int) -> Chip:
    """Return how to treat a chip that no table names: as an MPU-6050 by bursts."""
    name = f"unknown chip 0x{who_am_i:02X}"
    return Chip(who_am_i, name, Family.MPU6050, 0, is_known=False)
