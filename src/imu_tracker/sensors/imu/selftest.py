"""The factory-trim self-test of the MPU-6050.

The chip pushes its own proof masses, and the response is held against what the
factory measured. What a newcomer gets wrong: a trim code of 0 means that the factory
wrote nothing down. Such an axis is neither good nor bad.

Source: RM-MPU-6000A-00 rev. 4.2, section 4.1; limits PS-MPU-6000A-00 rev. 3.4,
sections 6.1 and 6.2, for chips made since week 47 of 2011.
"""

from enum import StrEnum
from struct import Struct
from typing import Final, NamedTuple

from imu_tracker.sensors.clock import MILLISECOND_NS, Clock, Pacer
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.registers import (
    ACCEL_SELF_TEST,
    AFS_SEL,
    FS_SEL,
    GYRO_SELF_TEST,
    Reg,
)
from imu_tracker.sensors.imu.setup import ACCEL_RANGES_G, GYRO_RANGES_DPS, ImuSettings

LIMIT: Final = 0.14

_ACCEL_RANGE_G, _GYRO_RANGE_DPS = 8, 250  # the formulas hold at these
_SETTINGS: Final = ImuSettings(200.0, _ACCEL_RANGE_G, _GYRO_RANGE_DPS, 42.0)
_ALL_AXES: Final = 0b111
_SAMPLES: Final = 100
_SETTLE_SAMPLES: Final = 50  # thrown away after each change
_COUNTS: Final = Struct(">3h 2x 3h")

AXES: Final = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")


class Verdict(StrEnum):
    """What the self-test says of one axis."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_GRADED = "not graded"  # the factory wrote no trim down
    NOT_APPLICABLE = "not applicable"  # the chip is of another family


class AxisResult(NamedTuple):
    """The self-test of one axis, in counts at 8 g and 250 deg/s."""

    axis: str
    verdict: Verdict
    response: float = 0.0
    expected: float = 0.0

    @property
    def change(self) -> float | None:
        """Relative deviation from the factory's response; within 0.14 is good."""
        return (self.response / self.expected - 1) if self.expected else None


def self_test(imu: Mpu6050, clock: Clock) -> tuple[AxisResult, ...]:
    """Test all axes of a chip that is held still; takes 2 s.

    The chip is in reset afterwards: configure it again before use.

    Raises
    ------
    BusError, DeviceNotFoundError
        As `Mpu6050.configure`.
    """
    chip = imu.probe()
    if not (chip.is_known and chip.family.value.has_mpu6050_trim):
        return tuple(AxisResult(axis, Verdict.NOT_APPLICABLE) for axis in AXES)
    imu.configure(_SETTINGS)
    trim = imu.registers.read(Reg.SELF_TEST_X, 4)
    at_rest = _mean(imu, clock)
    afs_sel = AFS_SEL.put(ACCEL_RANGES_G.index(_ACCEL_RANGE_G))
    fs_sel = FS_SEL.put(GYRO_RANGES_DPS.index(_GYRO_RANGE_DPS))
    imu.registers.put(Reg.ACCEL_CONFIG, ACCEL_SELF_TEST.put(_ALL_AXES) | afs_sel)
    imu.registers.put(Reg.GYRO_CONFIG, GYRO_SELF_TEST.put(_ALL_AXES) | fs_sel)
    pushed = _mean(imu, clock)
    imu.reset()
    responses = [b - a for a, b in zip(at_rest, pushed, strict=True)]
    return tuple(map(_grade, AXES, responses, factory_response(trim)))


def factory_response(trim: bytes) -> list[float]:
    """Return the response of accel x y z and gyro x y z that the factory measured.

    Parameters
    ----------
    trim : bytes, length 4
        Registers SELF_TEST_X, _Y, _Z and _A.

    Returns
    -------
    list of float, length 6, counts at 8 g and 250 deg/s
        0 where there is no trim.
    """
    *xyz, low = trim
    accel = [
        (row >> 5) << 2 | low >> 2 * (2 - axis) & 3 for axis, row in enumerate(xyz)
    ]
    gyro = [row & 0x1F for row in xyz]
    return [
        *(
            4096 * 0.34 * (0.92 / 0.34) ** ((code - 1) / 30) if code else 0.0
            for code in accel
        ),
        *(
            sign * 25 * 131 * 1.046 ** (code - 1) if code else 0.0
            for sign, code in zip((1, -1, 1), gyro, strict=True)
        ),
    ]


def _mean(imu: Mpu6050, clock: Clock) -> list[float]:
    """Average the axes, in the order of `AXES`, after they have settled."""
    pacer = Pacer(clock, round(1000 / _SETTINGS.rate_hz) * MILLISECOND_NS)
    sums = [0.0] * len(AXES)
    for number in range(_SETTLE_SAMPLES + _SAMPLES):
        pacer.wait()
        counts = _COUNTS.unpack(imu.read_burst())
        if number >= _SETTLE_SAMPLES:
            sums = [a + b for a, b in zip(sums, counts, strict=True)]
    return [total / _SAMPLES for total in sums]


def _grade(axis: str, response: float, expected: float) -> AxisResult:
    if not expected:
        return AxisResult(axis, Verdict.NOT_GRADED, response)
    is_good = abs(response / expected - 1) <= LIMIT
    verdict = Verdict.PASSED if is_good else Verdict.FAILED
    return AxisResult(axis, verdict, response, expected)
