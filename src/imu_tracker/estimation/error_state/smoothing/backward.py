"""The pass back through a history: its marks, in the light of all that came later.

Afterwards it is known which hypothesis was right. The history is that of the filter
that leads at the end; where the receiver alone had to lead, the filter was wrong since
its odds began to fall; and a filter that was found lost was wrong by as much more than
it said, since the last fix that it had used.
"""

from typing import Final, NamedTuple

import numpy as np

from imu_tracker.estimation.error_state.smoothing.entries import (
    SEEN_DELAY,
    SEEN_RECEIVER,
    Entry,
    Loss,
    Mark,
    nothing_later,
)
from imu_tracker.estimation.error_state.states import Array
from imu_tracker.estimation.estimate import r95_of
from imu_tracker.estimation.tuning import LONGER_SHARE
from imu_tracker.geometry.rotation import (
    from_rotation_vector,
    multiply,
    normalise,
    rotate,
)
from imu_tracker.samples import Quat, Vec3

RIGHT_NATS: Final = 4.0
"""Odds of fifty to one for the filter. Below, the future decides."""

TRACKING_S: Final = 0.5
"""Within this of a fix that was used a filter was not yet lost."""


class Point(NamedTuple):
    """A smoothed place.

    Attributes
    ----------
    t_ns : int
        On the time scale of the rows.
    filter_ns : int
        On that of the samples.
    lat_rad, lon_rad : float
        Of the antenna.
    alt_m : float or None
    v_n : Vec3, m/s
    q_nb : Quat
    r95_m : float
    outage_s : float
    is_imu_right : bool
        Whether the filter was right; else the receiver alone is.
    """

    t_ns: int
    filter_ns: int
    lat_rad: float
    lon_rad: float
    alt_m: float | None
    v_n: Vec3
    q_nb: Quat
    r95_m: float
    outage_s: float
    is_imu_right: bool


def points(newest: Entry | None, lever_arm_m: Vec3) -> list[Point]:
    """Go back through a history; return its marks smoothed, oldest first."""
    found = []
    later, entry = nothing_later(), newest
    widening, is_right = 1.0, True
    while entry is not None:
        if isinstance(entry, Mark):
            scene = entry.scene
            if not scene.has_imu or scene.odds_nats > RIGHT_NATS:
                is_right = scene.has_imu
            if scene.outage_s < TRACKING_S:
                widening = 1.0
            point = _point(entry, *entry.errors(later), lever_arm_m)
            found.append(
                point._replace(r95_m=point.r95_m * widening, is_imu_right=is_right)
            )
        else:
            if isinstance(entry, Loss):
                widening = entry.widening
            later = entry.back(later)
        entry = entry.before
    found.reverse()
    return found


def _point(mark: Mark, errors: Array, cov: Array, lever_arm_m: Vec3) -> Point:
    """Add the errors of a mark to its solution."""
    e = errors.tolist()
    scene = mark.scene
    (north, east, down), (vn, ve, vd) = mark.p_n, mark.v_n
    north, east, down = north + e[0], east + e[1], down + e[2]
    vn, ve, vd = vn + e[3], ve + e[4], vd + e[5]
    q_nb = normalise(multiply(from_rotation_vector((e[6], e[7], e[8])), mark.q_nb))
    if scene.is_aligned and any(lever_arm_m):
        ln, le, ld = rotate(q_nb, lever_arm_m)
        north, east, down = north + ln, east + le, down + ld
    lat, lon = scene.frame.to_lat_lon(north, east)
    H = np.zeros((2, len(e)))
    H[0, 0] = H[1, 1] = 1.0
    if scene.is_aligned:
        H[:, SEEN_DELAY] = vn, ve
    delay_s = (
        scene.shift_s + mark.delay_s + (e[SEEN_DELAY] if scene.is_aligned else 0.0)
    )
    alt_m = None if scene.alt_origin_m is None else scene.alt_origin_m - down
    return Point(
        mark.t_ns - round(delay_s * 1e9),
        mark.t_ns,
        *(lat, lon, alt_m, (vn, ve, vd), q_nb),
        r95_of(H @ cov @ H.T + LONGER_SHARE * cov[SEEN_RECEIVER, SEEN_RECEIVER]),
        scene.outage_s,
        is_imu_right=True,
    )
