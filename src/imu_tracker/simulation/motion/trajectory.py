"""The motion of a body: what a trajectory must tell the sensors.

Velocity and attitude with their first derivatives are all that an ideal IMU needs,
and velocity is all that position needs. A scenario that is not a ride along a path
only has to be a `Trajectory`.

The navigation axes are those of the place, north, east and down, and are taken as
inertial: the Earth does not turn here. Its 15 deg/h (and 0.003 m/s^2 of Coriolis at
20 m/s) are far below what an MPU-6050 can tell, and no part of this program models
them.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from imu_tracker.simulation.motion.paths import FloatArray, Kinematics, Path


class Motion(NamedTuple):
    """A body at some instants; arrays of shape (n, 3), or (n,) for time and cover.

    `rpy_rad` is roll, pitch, yaw of the body (FRD) to NED; yaw does not wrap.
    """

    t_s: FloatArray
    v_n: FloatArray
    a_n: FloatArray  # time derivative of v_n
    rpy_rad: FloatArray
    rpy_rate_radps: FloatArray
    is_covered: NDArray[np.bool_]


class Trajectory(Protocol):
    """A motion that can be evaluated at any instant."""

    def at(self, t_s: FloatArray) -> Motion:
        """Evaluate at growing instants; calls may go back by at most a minute."""
        ...


class Hills(NamedTuple):
    """Road slope as a sum of sines of the distance, so that height stays bounded."""

    slope_rad: Sequence[float] = ()
    length_m: Sequence[float] = ()
    phase_rad: Sequence[float] = ()

    def at(self, distance_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slope, upwards positive, and its change per metre."""
        wave_per_m = 2.0 * np.pi / np.asarray(self.length_m)
        angle = distance_m[:, None] * wave_per_m + np.asarray(self.phase_rad)
        slope = np.asarray(self.slope_rad)
        return np.sin(angle) @ slope, np.cos(angle) @ (slope * wave_per_m)


class Gait(NamedTuple):
    """Bounce and sway of a walker at his usual speed; less when he is slower."""

    speed_mps: float = 1.4
    steps_hz: float = 1.8
    bounce_m: float = 0.02
    pitch_rad: float = 0.02  # with each step
    sway_rad: Sequence[float] = (0.03, 0.03)  # roll and yaw, with each second step


class Suspension(NamedTuple):
    """How a body leans, in radians per m/s^2: outwards in turns, back when pushed."""

    roll_per_mps2: float = 0.006
    pitch_per_mps2: float = 0.005


class Ride:
    """Somebody or something that goes along a path.

    Parameters
    ----------
    path : Path
        Speed and curvature along the road.
    hills : Hills
        Slope of the road; flat by default.
    suspension : Suspension, optional
        Lean of a car's body; rigid when left out.
    gait : Gait, optional
        Steps of a walker.
    """

    def __init__(
        self,
        path: Path,
        *,
        hills: Hills | None = None,
        suspension: Suspension | None = None,
        gait: Gait | None = None,
    ) -> None:
        self._path = path
        self._hills = hills
        self._suspension = suspension
        self._gait = gait

    def at(self, t_s: FloatArray) -> Motion:
        """Evaluate at growing instants; calls may go back by at most a minute."""
        k = self._path.at(t_s)
        motion = _along_the_road(k, self._hills)
        if self._suspension:
            _lean(motion, k, self._suspension)
        if self._gait:
            _step(motion, k, self._gait)
        return motion


def _along_the_road(k: Kinematics, hills: Hills | None) -> Motion:
    """Point the body along its velocity."""
    zero = np.zeros_like(k.t_s)
    slope, slope_per_m = hills.at(k.distance_m) if hills else (zero, zero)
    v, a = k.speed_mps, k.accel_mps2
    slope_rate, yaw_rate = slope_per_m * v, k.curvature_per_m * v
    sin_slope, cos_slope = np.sin(slope), np.cos(slope)
    sin_yaw, cos_yaw = np.sin(k.heading_rad), np.cos(k.heading_rad)
    level_v, level_a = v * cos_slope, a * cos_slope - v * sin_slope * slope_rate
    across_a = level_v * yaw_rate
    return Motion(
        k.t_s,
        v_n=np.column_stack([level_v * cos_yaw, level_v * sin_yaw, -v * sin_slope]),
        a_n=np.column_stack(
            [
                level_a * cos_yaw - across_a * sin_yaw,
                level_a * sin_yaw + across_a * cos_yaw,
                -a * sin_slope - v * cos_slope * slope_rate,
            ]
        ),
        rpy_rad=np.column_stack([zero, slope, k.heading_rad]),
        rpy_rate_radps=np.column_stack([zero, slope_rate, yaw_rate]),
        is_covered=k.is_covered,
    )


def _lean(motion: Motion, k: Kinematics, suspension: Suspension) -> None:
    """Lean the body by the acceleration along and across the road."""
    v = k.speed_mps
    across = v**2 * k.curvature_per_m
    across_rate = 2.0 * v * k.accel_mps2 * k.curvature_per_m + v**2 * k.curvature_rate
    motion.rpy_rad[:, 0] -= suspension.roll_per_mps2 * across
    motion.rpy_rate_radps[:, 0] -= suspension.roll_per_mps2 * across_rate
    motion.rpy_rad[:, 1] += suspension.pitch_per_mps2 * k.accel_mps2
    motion.rpy_rate_radps[:, 1] += suspension.pitch_per_mps2 * k.jerk_mps3


def _step(motion: Motion, k: Kinematics, gait: Gait) -> None:
    """Add the bounce of velocity and the sway of attitude, in proportion to speed."""
    size, size_rate = k.speed_mps / gait.speed_mps, k.accel_mps2 / gait.speed_mps
    omega = 2.0 * np.pi * gait.steps_hz
    sine, cosine = np.sin(omega * k.t_s), np.cos(omega * k.t_s)
    bounce_mps = gait.bounce_m * omega
    motion.v_n[:, 2] += bounce_mps * size * cosine
    motion.a_n[:, 2] += bounce_mps * (size_rate * cosine - size * omega * sine)
    motion.rpy_rad[:, 1] += gait.pitch_rad * size * sine
    motion.rpy_rate_radps[:, 1] += gait.pitch_rad * (
        size_rate * sine + size * omega * cosine
    )
    half = 0.5 * omega
    sine, cosine = np.sin(half * k.t_s), np.cos(half * k.t_s)
    for axis, sway_rad in zip((0, 2), gait.sway_rad, strict=True):
        motion.rpy_rad[:, axis] += sway_rad * size * sine
        motion.rpy_rate_radps[:, axis] += sway_rad * (
            size_rate * sine + size * half * cosine
        )
