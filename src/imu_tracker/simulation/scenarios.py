"""The scenarios: who goes where, near Delft.

A new one is a function that makes a `Trajectory` and a row of `SCENARIOS`.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.simulation.imu.errors import TABLET, TYPICAL_CHIP, SensorErrors
from imu_tracker.simulation.motion import figures
from imu_tracker.simulation.motion.driver import Driver
from imu_tracker.simulation.motion.paths import (
    Leg,
    Path,
    change_speed,
    cruise,
    stand,
    turn,
)
from imu_tracker.simulation.motion.positions import Place
from imu_tracker.simulation.motion.trajectory import (
    Gait,
    Hills,
    Ride,
    Suspension,
    Trajectory,
)
from imu_tracker.simulation.receiver.receiver import TYPICAL_RECEIVER, ReceiverErrors

DELFT: Final = Place(math.radians(52.0), math.radians(4.37), 5.0)

START_STILL_S: Final = 20.0
"""Every scenario begins at rest: time to level, and to find the gyro's bias."""

END_STILL_S: Final = 10.0

_WALK_MPS: Final = 1.4
_WALK_MPS2: Final = 0.8
_RIDE_MPS: Final = 6.0
_RIDE_MPS2: Final = 1.2


class Scenario(NamedTuple):
    """One thing to simulate.

    `trajectory` makes it from a generator of random numbers; equal generators must
    give equal trajectories.
    """

    description: str
    profile: str  # "free", "walker" or "vehicle", for the header
    duration_s: float
    trajectory: Callable[[np.random.Generator], Trajectory]
    has_engine: bool = False
    has_wheels: bool = False  # whose lines can be measured
    start: Place = DELFT
    rate_hz: float = 100.0  # of the samples, unless somebody wishes another
    errors: SensorErrors = TYPICAL_CHIP
    receiver: ReceiverErrors = TYPICAL_RECEIVER


THESIS_RECEIVER: Final = TYPICAL_RECEIVER._replace(
    slow_sigma_m=0.0, white_sigma_m=1.0, sends_gst=True
)
"""As the thesis takes its receiver to be, R = I: one metre, anew with each fix."""


def line_walk(length_m: float = 500.0) -> tuple[Leg, ...]:
    """Walk straight on, from rest to rest."""
    return _from_rest_to_rest(_walk(length_m))


def square_walk(perimeter_m: float = 500.0) -> tuple[Leg, ...]:
    """Walk round a square with rounded corners, to the right, from mid-side on."""
    corner = turn(math.pi / 2.0, _WALK_MPS, radius_m=2.0, ramp_s=0.8)
    side_m = perimeter_m / 4.0 - sum(leg.length_m for leg in corner)
    begin = change_speed(0.0, _WALK_MPS, _WALK_MPS2)
    end = change_speed(_WALK_MPS, 0.0, _WALK_MPS2)
    side = cruise(side_m, _WALK_MPS)
    return _from_rest_to_rest(
        (
            begin,
            cruise(side_m / 2.0 - begin.length_m, _WALK_MPS),
            *(*corner, side) * 3,
            *corner,
            cruise(side_m / 2.0 - end.length_m, _WALK_MPS),
            end,
        )
    )


def roundabout(rounds: int = 5, circumference_m: float = 200.0) -> tuple[Leg, ...]:
    """Drive round and round to the left, from rest to rest on the circle."""
    curvature_per_m = -2.0 * math.pi / circumference_m
    begin = change_speed(0.0, _RIDE_MPS, _RIDE_MPS2, curvature_per_m)
    end = change_speed(_RIDE_MPS, 0.0, _RIDE_MPS2, curvature_per_m)
    rest_m = rounds * circumference_m - begin.length_m - end.length_m
    return _from_rest_to_rest((begin, cruise(rest_m, _RIDE_MPS, curvature_per_m), end))


def _walk(length_m: float) -> tuple[Leg, ...]:
    begin = change_speed(0.0, _WALK_MPS, _WALK_MPS2)
    end = change_speed(_WALK_MPS, 0.0, _WALK_MPS2)
    return (begin, cruise(length_m - begin.length_m - end.length_m, _WALK_MPS), end)


def _from_rest_to_rest(legs: tuple[Leg, ...]) -> tuple[Leg, ...]:
    return (stand(START_STILL_S), *legs, stand(END_STILL_S))


def _duration_s(legs: tuple[Leg, ...]) -> float:
    return float(math.ceil(sum(leg.duration_s for leg in legs)))


def _figure(
    description: str, trajectory: Callable[[], figures.Figure], moving_s: float
) -> Scenario:
    """Make one of the thesis's simulations, with its sensors."""
    return Scenario(
        description,
        "free",
        math.ceil(START_STILL_S + moving_s + END_STILL_S),
        lambda _: trajectory(),
        rate_hz=figures.RATE_HZ,
        errors=TABLET,
        receiver=THESIS_RECEIVER,
    )


def _drive(rng: np.random.Generator) -> Trajectory:
    hills = Hills(
        slope_rad=(0.035, 0.02),
        length_m=(1300.0, 410.0),
        phase_rad=tuple(rng.uniform(0.0, 2.0 * math.pi, 2)),
    )
    heading_rad = float(rng.uniform(0.0, 2.0 * math.pi))
    legs = Driver(rng, START_STILL_S).legs(heading_rad)
    return Ride(Path(legs, heading_rad), hills=hills, suspension=Suspension())


SCENARIOS: Final[Mapping[str, Scenario]] = {
    "still": Scenario(
        "lie still for two minutes",
        "free",
        120.0,
        lambda _: Ride(Path(())),
    ),
    "walk-line": Scenario(
        "walk 500 m straight on",
        "walker",
        _duration_s(line_walk()),
        lambda _: Ride(Path(line_walk(), math.radians(40.0)), gait=Gait()),
    ),
    "walk-square": Scenario(
        "walk round a square, 500 m in all",
        "walker",
        _duration_s(square_walk()),
        lambda _: Ride(Path(square_walk(), math.radians(10.0)), gait=Gait()),
    ),
    "roundabout": Scenario(
        "drive five rounds of a roundabout of 200 m",
        "vehicle",
        _duration_s(roundabout()),
        lambda _: Ride(Path(roundabout()), suspension=Suspension()),
        has_engine=True,
    ),
    "drive": Scenario(
        "drive about town: turns, stops, hills, a tunnel; different with each seed",
        "vehicle",
        900.0,
        _drive,
        has_engine=True,
        has_wheels=True,
    ),
    "square": _figure(
        "slide round a square of 1 m, stopping in its corners",
        lambda: figures.side_by_side(START_STILL_S),
        figures.ROUND_S,
    ),
    "circle": _figure(
        "slide round a circle of 1 m radius",
        lambda: figures.going_round(figures.circle, START_STILL_S),
        figures.ROUND_S + 2.0 * figures.RUN_UP_S,
    ),
    "lissajous": _figure(
        "slide along the Lissajous figure (cos 3t, sin 2t)",
        lambda: figures.going_round(figures.lissajous, START_STILL_S),
        figures.ROUND_S + 2.0 * figures.RUN_UP_S,
    ),
}
