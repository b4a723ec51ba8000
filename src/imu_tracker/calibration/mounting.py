"""How the chip is mounted, finer than by the names of axes: level, then drive.

Standing level, gravity tells roll and pitch. Yaw shows when the vehicle speeds up,
brakes and turns: what is felt then must point where the receiver's speed says.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.readings import Array
from imu_tracker.errors import CalibrationError
from imu_tracker.geometry.rotation import level_from_gravity, matrix

MAX_LEAN_RAD: Final = math.radians(30.0)
"""More is another choice of axes, which is `imu.mount`'s to make."""

MAX_YAW_SIGMA_RAD: Final = math.radians(2.0)
MAX_YAW_RAD: Final = math.radians(45.0)

FELT_MPS2: Final = 0.5
"""Weaker accelerations are lost in slopes and bumps."""

LEAST_INTERVALS: Final = 20
SHORTEST_INTERVAL_S: Final = 0.9
LONGEST_INTERVAL_S: Final = 3.0


class Manoeuvre(NamedTuple):
    """One interval between two fixes, means over it."""

    accel_mps2: Array  # shape (3,), in the axes that imu.mount names
    forward_mps2: float  # by the receiver's speed
    right_mps2: float  # speed times rate of turn


class MountFit(NamedTuple):
    """The rotation from the axes that `imu.mount` names to the body's."""

    rotation: Array  # shape (3, 3)
    tilt_rad: tuple[float, float]  # roll and pitch that it takes out
    yaw_rad: float | None  # None: not measured, taken for 0
    yaw_sigma_rad: float | None


def manoeuvres(
    t_s: Array,
    accel_mps2: Array,
    yaw_radps: Array,
    speeds: Sequence[tuple[float, float]],
    latency_s: float,
) -> list[Manoeuvre]:
    """Compare each second or so between two fixes with what was felt meanwhile.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
    accel_mps2 : ndarray, shape (n, 3)
        Specific force in the axes that `imu.mount` names.
    yaw_radps : ndarray, shape (n,)
        Rate of turn to the right.
    speeds : sequence of (t_s, mps)
        Arrival and speed of the fixes.
    latency_s : float
        From the instant of a fix to its arrival.
    """
    found: list[Manoeuvre] = []
    if not speeds:
        return found
    before_s, before_mps = speeds[0]
    for after_s, after_mps in speeds[1:]:
        lasted_s = after_s - before_s
        if lasted_s < SHORTEST_INTERVAL_S:
            continue
        start, stop = np.searchsorted(
            t_s, [before_s - latency_s, after_s - latency_s]
        ).tolist()
        if lasted_s < LONGEST_INTERVAL_S and stop - start > 1:
            speed_mps = 0.5 * (before_mps + after_mps)
            found.append(
                Manoeuvre(
                    accel_mps2[start:stop].mean(axis=0),
                    (after_mps - before_mps) / lasted_s,
                    speed_mps * float(yaw_radps[start:stop].mean()),
                )
            )
        before_s, before_mps = after_s, after_mps
    return found


def level(accel_mps2: Array) -> MountFit:
    """Find roll and pitch from a mean at rest on level ground.

    Parameters
    ----------
    accel_mps2 : ndarray, shape (3,)
        In the axes that `imu.mount` names: near (0, 0, -9.81).

    Raises
    ------
    CalibrationError
        When gravity points elsewhere.
    """
    x, y, z = accel_mps2.tolist()
    size = math.hypot(x, y, z)
    if size == 0.0 or -z < math.cos(MAX_LEAN_RAD) * size:
        raise CalibrationError(
            f"gravity does not point down in the axes of imu.mount but along "
            f"{_direction(accel_mps2)}: set imu.mount first"
        )
    rotation = matrix(level_from_gravity((x, y, z)))
    tilt = math.atan2(-y, -z), math.atan2(x, math.hypot(y, z))
    return MountFit(rotation, tilt, None, None)


def with_yaw(fit: MountFit, manoeuvres: Sequence[Manoeuvre]) -> MountFit:
    """Add yaw from a drive.

    Raises
    ------
    CalibrationError
        When the drive did not show it.

    Notes
    -----
    yaw = atan2(sum m x a, sum m . a), with m what is felt in the levelled axes and a
    what the receiver tells, both horizontal: the rotation of least squares.
    """
    pairs = [
        ((fit.rotation @ each.accel_mps2)[:2], (each.forward_mps2, each.right_mps2))
        for each in manoeuvres
        if math.hypot(each.forward_mps2, each.right_mps2) > FELT_MPS2
    ]
    if len(pairs) < LEAST_INTERVALS:
        raise CalibrationError(
            f"only {len(pairs)} seconds of speeding up, braking or turning with a "
            f"receiver's speed, {LEAST_INTERVALS} are needed: drive about town"
        )
    felt, told = (np.array(column) for column in zip(*pairs, strict=True))
    along = float(np.sum(felt * told))
    across = float(np.sum(felt[:, 0] * told[:, 1] - felt[:, 1] * told[:, 0]))
    yaw_rad = math.atan2(across, along)
    sin, cos = math.sin(yaw_rad), math.cos(yaw_rad)
    turned = felt @ np.array([[cos, sin], [-sin, cos]])
    spread = float(np.mean((turned - told) ** 2))
    sigma_rad = math.sqrt(spread / float(np.sum(felt**2)))
    if sigma_rad > MAX_YAW_SIGMA_RAD or abs(yaw_rad) > MAX_YAW_RAD:
        raise CalibrationError(
            f"the drive shows a yaw of {math.degrees(yaw_rad):.0f} +- "
            f"{math.degrees(sigma_rad):.1f} deg, which is not to be trusted: set "
            "imu.mount to the nearest axes, and drive longer with more turns"
        )
    about_down = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return fit._replace(
        rotation=about_down @ fit.rotation, yaw_rad=yaw_rad, yaw_sigma_rad=sigma_rad
    )


def _direction(accel_mps2: Array) -> str:
    axis = int(np.argmax(np.abs(accel_mps2)))
    down = "-" if accel_mps2[axis] > 0 else "+"  # at rest the force points up
    return f"{down}{'xyz'[axis]} of the body"
