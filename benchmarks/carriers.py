"""What it makes of other things than cars: trains, boats, aeroplanes, people on foot.

    python -m benchmarks.carriers --seeds 6

Each is simulated with a chip of the datasheet that was fixed by eye, and tracked by
default settings, which know nothing of the carrier. Prints a line for each: what it was
taken for, whether the truth lies inside r95, and how far off it is after an outage.
"""

import argparse
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from benchmarks.consistency import ASKEW, Array, Drive, pooled, run
from imu_tracker.simulation.imu.errors import SensorErrors
from imu_tracker.simulation.motion.paths import (
    Leg,
    Path,
    change_speed,
    cruise,
    stand,
    turn,
)
from imu_tracker.simulation.motion.trajectory import (
    Gait,
    Hills,
    Motion,
    Ride,
    Suspension,
    Trajectory,
)
from imu_tracker.simulation.scenarios import SCENARIOS, START_STILL_S, Scenario

Rng = np.random.Generator

FIRST_SEED: Final = 2000
DURATION_S: Final = 540.0

BALANCED: Final = Suspension(roll_per_mps2=-1.0 / 9.81, pitch_per_mps2=0.0)
"""Who leans into a turn until nothing is felt across: all that flies, or has two
wheels."""

TILTED_RAIL: Final = Suspension(roll_per_mps2=-0.5 / 9.81, pitch_per_mps2=0.0)
"""Tracks are canted for half of what a train feels."""

ROUGH: Final = ASKEW._replace(
    road_accel_sigma_mps2=(1.0, 1.0, 1.8), road_gyro_sigma_radps=math.radians(3.0)
)
"""Shaken as much as the handlebars of a bicycle are."""

RATTLING: Final = ASKEW._replace(
    road_accel_sigma_mps2=(7.0, 7.0, 12.0),
    road_gyro_sigma_radps=math.radians(40.0),
    idle_accel_sigma_mps2=0.02,
)
"""Small hard wheels on a path: at 1 m/s it shakes as much as a car at 14."""

PROPELLED: Final = ASKEW._replace(
    idle_accel_sigma_mps2=0.6,
    idle_gyro_sigma_radps=math.radians(1.0),
    road_accel_sigma_mps2=(0.1, 0.1, 0.1),
    road_gyro_sigma_radps=math.radians(0.2),
)
"""An engine that shakes at any speed, and no road."""


class Afloat:
    """A ride on water: waves roll, pitch and heave it, and a current sets it aside."""

    ROLL: Final = (math.radians(6.0), 0.25)  # amplitude, Hz
    PITCH: Final = (math.radians(3.0), 0.4)
    HEAVE_M: Final = 0.3
    SET_MPS: Final = 0.3  # by a current, to the east

    def __init__(self, path: Path) -> None:
        self._ride = Ride(path)

    def at(self, t_s: Array) -> Motion:
        """Evaluate at growing instants; calls may go back by at most a minute."""
        motion = self._ride.at(t_s)
        for axis, (angle_rad, hz) in enumerate((self.ROLL, self.PITCH)):
            omega = 2.0 * math.pi * hz
            motion.rpy_rad[:, axis] += angle_rad * np.sin(omega * t_s + axis)
            motion.rpy_rate_radps[:, axis] += (
                angle_rad * omega * np.cos(omega * t_s + axis)
            )
        omega = 2.0 * math.pi * self.PITCH[1]
        motion.v_n[:, 2] += self.HEAVE_M * omega * np.cos(omega * t_s)
        motion.a_n[:, 2] -= self.HEAVE_M * omega**2 * np.sin(omega * t_s)
        motion.v_n[:, 1] += self.SET_MPS
        return motion


class Manner(NamedTuple):
    """How somebody gets about: straight on, a turn, a stop at times, and on."""

    speeds_mps: Sequence[float]
    straight_m: tuple[float, float]
    accel_mps2: float
    lateral_mps2: float
    turn_rad: float  # at most, either way
    ramp_s: float  # into a turn, and out of it
    stops: float = 0.0  # after so many of the turns
    stop_s: tuple[float, float] = (5.0, 20.0)


def _wander(rng: Rng, manner: Manner) -> Path:
    """Go about for ever, to begin with in any direction."""
    heading_rad = float(rng.uniform(0.0, 2.0 * math.pi))
    return Path(_legs(rng, manner), heading_rad)


def _legs(rng: Rng, manner: Manner) -> Iterator[Leg]:
    yield stand(START_STILL_S)
    speed_mps = 0.0
    while True:
        wanted_mps = float(rng.choice(manner.speeds_mps)) * rng.uniform(0.9, 1.1)
        yield change_speed(speed_mps, wanted_mps, manner.accel_mps2)
        speed_mps = wanted_mps
        yield cruise(rng.uniform(*manner.straight_m), speed_mps)
        radius_m = max(speed_mps**2 / manner.lateral_mps2, 0.3)
        angle_rad = rng.uniform(-manner.turn_rad, manner.turn_rad)
        yield from turn(angle_rad, speed_mps, radius_m, manner.ramp_s)
        if rng.random() < manner.stops:
            yield change_speed(speed_mps, 0.0, manner.accel_mps2)
            yield stand(rng.uniform(*manner.stop_s))
            speed_mps = 0.0


MOTORIST: Final = Manner((28.0, 33.0, 36.0), (800.0, 3000.0), 1.5, 1.2, 0.35, 3.0)
CYCLIST: Final = Manner((4.0, 6.0, 8.0), (30.0, 200.0), 1.0, 2.5, 2.2, 1.2, 0.3)
ROBOT: Final = Manner((0.4, 0.8, 1.2), (2.0, 15.0), 0.8, 1.0, 2.8, 0.8, 0.2)
STROLLER: Final = Manner((1.1, 1.4, 1.6), (10.0, 80.0), 0.8, 1.5, 2.8, 0.8, 0.2)
PILOT: Final = Manner((45.0, 50.0, 55.0), (500.0, 3000.0), 2.0, 4.0, 3.0, 3.0)
ENGINE_DRIVER: Final = Manner(
    *((20.0, 30.0, 40.0), (600.0, 2500.0), 0.5, 0.6, 0.6, 6.0, 0.3, (30.0, 60.0))
)
HELMSMAN: Final = Manner(
    *((3.0, 5.0, 7.0), (100.0, 600.0), 0.5, 0.8, 1.5, 3.0, 0.1, (20.0, 60.0))
)

ROLLING_COUNTRY: Final = Hills((0.03, 0.015), (2300.0, 700.0), (0.0, 2.0))
POCKET: Final = Gait(bounce_m=0.04, pitch_rad=0.3, sway_rad=(0.2, 0.15))


def _carrier(
    manner: Manner,
    carried: Callable[[Path], Trajectory],
    chip: SensorErrors = ASKEW,
    *,
    has_engine: bool = True,
) -> Scenario:
    return SCENARIOS["drive"]._replace(
        trajectory=lambda rng: carried(_wander(rng, manner)),
        has_engine=has_engine,
        errors=chip,
    )


CARRIERS: Final[Mapping[str, Scenario]] = {
    "car on a motorway": _carrier(
        MOTORIST, partial(Ride, hills=ROLLING_COUNTRY, suspension=Suspension())
    ),
    "train": _carrier(ENGINE_DRIVER, partial(Ride, suspension=TILTED_RAIL)),
    "bicycle": _carrier(CYCLIST, partial(Ride, suspension=BALANCED), ROUGH),
    "rover": _carrier(ROBOT, Ride, RATTLING),
    "walker": _carrier(STROLLER, partial(Ride, gait=Gait()), has_engine=False),
    "walker, pocket": _carrier(STROLLER, partial(Ride, gait=POCKET), has_engine=False),
    "boat": _carrier(HELMSMAN, Afloat, PROPELLED),
    "aeroplane": _carrier(PILOT, partial(Ride, suspension=BALANCED), PROPELLED),
}


def one(name: str, seed: int) -> Drive:
    """Simulate one of `CARRIERS`, track it with the defaults, and compare."""
    return run(seed, DURATION_S, CARRIERS[name], ["filter.profile=auto"])


def line(name: str, drives: Sequence[Drive]) -> str:
    """Return the line of a carrier in the table."""
    profiles = [drive.profile for drive in drives]
    taken_for = ", ".join(f"{p} {profiles.count(p)}" for p in sorted(set(profiles)))
    error_m, r95_m = pooled(drives, is_dark=False)
    dark_error_m, dark_r95_m = pooled(drives, is_dark=True)
    after = (_after(drives, seconds) for seconds in (30.0, 60.0))
    return (
        f"| {name} | {taken_for} | {np.sqrt(np.mean(error_m**2)):.1f} m |"
        f" {np.mean(error_m <= r95_m):.0%} | {np.mean(dark_error_m <= dark_r95_m):.0%}"
        f" | {' | '.join(after)} |"
    )


def _after(drives: Sequence[Drive], seconds: float) -> str:
    ends = [o for d in drives for o in d.outages if o.name == f"{seconds:.0f} s"]
    _, error_m, r95_m = np.array([end[1:] for end in ends]).T
    return f"{np.median(error_m):.0f} m ({np.median(r95_m):.0f} m)"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.carriers")
    parser.add_argument("--seeds", type=int, default=6)
    args = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + args.seeds)
    print(
        "| carrier | taken for | with GPS, rms | inside r95 | in the dark |"
        " after 30 s, median (r95) | 60 s |"
    )
    print(f"|{' --- |' * 7}")
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for name in CARRIERS:
            print(line(name, list(pool.map(one, [name] * len(seeds), seeds))))


if __name__ == "__main__":
    main()
