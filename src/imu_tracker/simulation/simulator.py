"""A scenario as a stream of frames, and its truth.

Frames, and the truth, are each made when they are asked for, from the seed alone:
neither needs the other, and a drive of a month takes the memory of ten seconds. A
shorter simulation is a prefix of a longer one.
"""

from collections.abc import Iterator
from enum import IntEnum, auto
from heapq import merge
from itertools import takewhile
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.counts import CountsModel
from imu_tracker.geometry.geodesy import gravity_mps2
from imu_tracker.geometry.rotation import from_euler, multiply
from imu_tracker.samples import (
    DEFAULT_MOUNT,
    Frame,
    Mount,
    Quat,
    SessionHeader,
    Source,
    Vec3,
)
from imu_tracker.simulation.imu.chip import Imu
from imu_tracker.simulation.imu.errors import ChipTraits, SensorErrors
from imu_tracker.simulation.motion.positions import (
    TICKS_PER_S,
    Whereabouts,
    at_antenna,
    whereabouts,
)
from imu_tracker.simulation.receiver.receiver import Receiver, ReceiverErrors
from imu_tracker.simulation.scenarios import SCENARIOS, Scenario

START_UTC_S: Final = 1795348800.0
"""2026-11-22T12:00:00Z: every simulation begins at noon of this day."""

START_NS: Final = 1_000_000_000
"""The monotonic clock at `START_UTC_S`."""


class TruthRow(NamedTuple):
    """Where the body really was; `q_nb` is the box's attitude, mounting included."""

    utc_s: float
    lat_rad: float
    lon_rad: float
    alt_m: float  # above mean sea level
    v_n_mps: Vec3
    q_nb: Quat


class Simulated(NamedTuple):
    """A simulated session; `frames` and `truth` do not wait for each other."""

    header: SessionHeader
    frames: Iterator[Frame]  # in order of arrival
    truth: Iterator[TruthRow]
    chip: ChipTraits


class _Stream(IntEnum):
    """Who draws random numbers: each its own, so that none shifts another's."""

    TRAJECTORY = auto()
    CHIP = auto()
    IMU = auto()
    RECEIVER = auto()


def simulate(
    scenario: str | Scenario,
    *,
    seed: int = 0,
    duration_s: float | None = None,
    rate_hz: float | None = None,
    accel_range_g: int = 4,
    gyro_range_dps: int = 500,
    mount: Mount = DEFAULT_MOUNT,
    gps_every_s: float = 1.0,
    errors: SensorErrors | None = None,
    receiver: ReceiverErrors | None = None,
    baud: int | None = None,
    lever_arm_m: Vec3 = (0.0, 0.0, 0.0),
    truth_hz: int = 4,
    chip: ChipTraits | None = None,
    wheels: bool = True,
) -> Simulated:
    """Simulate what the wires would deliver, and what was true.

    Parameters
    ----------
    scenario : str or Scenario
        One of `SCENARIOS`, or one of your own.
    seed : int, not negative
        Decides everything that is random.
    duration_s : float, optional
        The scenario's own when left out; infinity never ends. Beyond its own a drive
        goes on, and the others stand still.
    rate_hz : float, optional
        Nominal rate of the IMU; its clock is off by up to 1 %. The scenario's own
        when left out.
    accel_range_g, gyro_range_dps, mount
        As for `CountsModel`.
    gps_every_s : float
        Time between the receiver's epochs, a multiple of 0.05 s.
    baud : int, optional
        Bits per second of the receiver's line; the receiver's own when not given.
    lever_arm_m : Vec3, body axes
        From the chip to the antenna, whose position is the truth.
    errors, receiver : optional
        How good the sensors are; the scenario's own when left out.
    truth_hz : int
        Rows of truth per second, a divisor of 20.
    chip : ChipTraits, optional
        The chip and its mounting, where it is to be the one of another simulation.
    wheels : bool
        Whether the wheels of a scenario that has some make lines in the vibration.
    """
    if isinstance(scenario, str) and scenario not in SCENARIOS:
        raise ValueError(f"{scenario!r}: must be one of {', '.join(SCENARIOS)}")
    if truth_hz < 1 or TICKS_PER_S % truth_hz:
        raise ValueError(f"truth at {truth_hz} Hz: must divide {TICKS_PER_S} Hz")
    plan = SCENARIOS[scenario] if isinstance(scenario, str) else scenario
    rate_hz = plan.rate_hz if rate_hz is None else rate_hz
    errors = plan.errors if errors is None else errors
    end_s = plan.duration_s if duration_s is None else duration_s

    def rng(stream: _Stream) -> np.random.Generator:
        return np.random.default_rng([seed, stream])

    def ticks() -> Iterator[Whereabouts]:
        chip_at = whereabouts(plan.trajectory(rng(_Stream.TRAJECTORY)), plan.start)
        return at_antenna(chip_at, lever_arm_m) if any(lever_arm_m) else chip_at

    if chip is None:
        chip = ChipTraits.draw(errors, rng(_Stream.CHIP))
    imu = Imu(
        *(errors, chip, rng(_Stream.IMU), rate_hz),
        has_engine=plan.has_engine,
        has_wheels=plan.has_wheels and wheels,
    )
    bursts = imu.bursts(
        plan.trajectory(rng(_Stream.TRAJECTORY)),
        gravity_mps2(plan.start.lat_rad, plan.start.alt_m),
        CountsModel(accel_range_g, gyro_range_dps, mount),
    )
    traits = receiver or plan.receiver
    if baud is not None:
        traits = traits._replace(baud=baud)
    gps = Receiver(traits, rng(_Stream.RECEIVER), gps_every_s, START_UTC_S)
    end_ns = START_NS + end_s * 1e9
    return Simulated(
        SessionHeader(
            accel_range_g,
            gyro_range_dps,
            rate_hz,
            mount,
            plan.profile,
            START_UTC_S,
            name=scenario if isinstance(scenario, str) else plan.description,
        ),
        takewhile(
            lambda frame: frame.t_ns < end_ns,
            merge(
                (Frame(START_NS + t_ns, Source.IMU, data) for t_ns, data in bursts),
                (
                    Frame(START_NS + round(t_s * 1e9), Source.GPS, data)
                    for t_s, data in gps.lines(ticks())
                ),
            ),
        ),
        _truth(ticks(), TICKS_PER_S // truth_hz, end_s, chip.q_vb),
        chip,
    )


def _truth(
    ticks: Iterator[Whereabouts], every: int, end_s: float, q_vb: Quat
) -> Iterator[TruthRow]:
    """Pick every so many ticks, up to and including the end."""
    for motion, lat_rad, lon_rad, alt_m in ticks:
        for t_s, (north, east, down), rpy_rad, lat, lon, alt in zip(
            motion.t_s[::every].tolist(),
            motion.v_n[::every].tolist(),
            motion.rpy_rad[::every].tolist(),
            lat_rad[::every].tolist(),
            lon_rad[::every].tolist(),
            alt_m[::every].tolist(),
            strict=True,
        ):
            if t_s > end_s:
                return
            q_nb = multiply(from_euler(*rpy_rad), q_vb)
            yield TruthRow(START_UTC_S + t_s, lat, lon, alt, (north, east, down), q_nb)
