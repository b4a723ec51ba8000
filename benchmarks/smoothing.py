"""The best track afterwards, beside others: how far off anywhere in an outage.

    python -m benchmarks.smoothing

Real drives of the folder that `IMU_TRACKER_RECORDINGS` names, the receiver hidden again
and again, tracked by `replay`, `smooth`, sidereon (its loosely coupled EKF with
standstill and vehicle constraints, and its RTS smoother) and pyins (its feedback
filter; it has no smoother). The others get samples and fixes that were decoded for
them, the level of the first second, the first course for a heading, and the latency.
"""

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.drives import FOLDER_VARIABLE, Drive, load
from benchmarks.peers import (
    LATENCY_S,
    VELOCITY_SIGMA_MPS,
    pyins_trajectory,
    starting_attitude,
)
from imu_tracker.config import load_config
from imu_tracker.geometry.rotation import matrix
from imu_tracker.recording.edit import Outage, hide_gps
from imu_tracker.recording.files import read_recording
from imu_tracker.recording.replay import Replay
from imu_tracker.recording.scoring import WARM_UP_S, Track, answer, read_truth
from imu_tracker.recording.smoothing import Smoothing
from imu_tracker.samples import GpsFix

Array = NDArray[np.float64]

FIRST_S: Final = 120.0
CASES: Final = (
    ("rtkexp_car", 15.0, 45.0, 480.0),
    ("rtkexp_car", 30.0, 90.0, 480.0),
    ("rtkexp_car", 60.0, 120.0, 480.0),
    ("rtkexp_car_rtk4hz", 15.0, 45.0, 480.0),
    ("rtkexp_car_rtk4hz", 60.0, 120.0, 480.0),
    ("phone_highway", 60.0, 150.0, 870.0),
)
"""Drive, length of its outages, from one to the next, begin of the last one, s."""


class Figures(NamedTuple):
    """Distances to the truth, m; the worst instant is the median of the outages."""

    with_gps: float
    outage: float
    worst: float
    inside: float | None


def main() -> None:
    folder = os.environ.get(FOLDER_VARIABLE)
    if folder is None:
        raise SystemExit(f"{FOLDER_VARIABLE} names no folder with recordings")
    columns = ["drive", "outages", "by", "with GPS", "in outages", "worst", "inside"]
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for name, length_s, every_s, last_s in CASES:
        path = Path(folder) / f"{name}.rec.gz"
        truth = read_truth(path.with_name(f"{name}.truth.csv.gz"))
        starts = np.arange(FIRST_S, last_s + 1.0, every_s)
        outages = [Outage(float(start_s), length_s) for start_s in starts]
        for who, track, r95_m in tracks(path, outages):
            found = figures(track, r95_m, truth, outages)
            inside = "" if found.inside is None else f"{found.inside:.0%}"
            cells = [name, f"{length_s:.0f} s", who]
            cells += [f"{x:.3g}" for x in found[:3]] + [inside]
            print(f"| {' | '.join(cells)} |", flush=True)


def tracks(
    path: Path, outages: Sequence[Outage]
) -> Iterator[tuple[str, Track, Array | None]]:
    """Track a drive by everybody in turn."""
    for kind in (Replay, Smoothing):
        replay = kind(load_config(None, ["filter.profile=vehicle"]))
        stream = hide_gps(read_recording(path), outages)
        rows = [
            (row.utc_s, math.degrees(row.lat_rad), math.degrees(row.lon_rad), row.r95_m)
            for row in replay.rows(stream)
        ]
        *columns, r95_m = np.array(rows).T
        yield kind.__name__, Track(*columns), r95_m
    drive = load(path.name, path, path.parent)
    first_ns = drive.samples[0].t_ns
    seen = [
        fix
        for fix in drive.fixes
        if not any(o.holds((fix.t_ns - first_ns) * 1e-9) for o in outages)
    ]
    drive = drive._replace(fixes=seen)
    trajectory = pyins_trajectory(drive)
    utc_s = np.array(trajectory.index) + _utc_offset_s(drive)
    yield "pyins", Track(utc_s, *trajectory[["lat", "lon"]].to_numpy().T), None
    yield from sidereon_tracks(drive)


def figures(
    track: Track, r95_m: Array | None, truth: Track, outages: Sequence[Outage]
) -> Figures:
    """Score a track; outages count from the first instant of the truth."""
    zero = truth.utc_s[0]
    radius = np.zeros(len(track.utc_s)) if r95_m is None else r95_m
    found = answer(track, radius, truth)
    since_s = truth.utc_s - zero
    hidden = [
        (since_s >= o.start_s) & (since_s <= o.start_s + o.length_s) for o in outages
    ]
    in_outage = np.any(hidden, axis=0)
    lit = ~in_outage & (since_s > WARM_UP_S) & found.is_answered
    dark = in_outage & found.is_answered
    is_inside = (found.error_m <= found.r95_m)[dark]
    return Figures(
        float(np.sqrt(np.mean(found.error_m[lit] ** 2))),
        float(np.sqrt(np.mean(found.error_m[dark] ** 2))),
        float(np.median([found.error_m[h & dark].max() for h in hidden])),
        None if r95_m is None else float(np.mean(is_inside)),
    )


def _utc_offset_s(drive: Drive) -> float:
    """UTC less the clock of the samples."""
    return float(
        np.median(
            [
                fix.utc_s - (fix.t_ns * 1e-9 - LATENCY_S)
                for fix in drive.fixes
                if fix.utc_s is not None
            ]
        )
    )


def sidereon_tracks(drive: Drive) -> Iterator[tuple[str, Track, None]]:
    """Track by sidereon's EKF, and smooth by its RTS."""
    import sidereon

    s: Any = sidereon  # its stubs take the members of an enumeration for ellipses
    spec = s.ImuSpec(
        accel_vrw_mps_sqrt_s=0.1,
        gyro_arw_rad_sqrt_s=math.radians(0.02),
        accel_bias_instab_mps2=0.02,
        gyro_bias_instab_rps=math.radians(0.02),
        accel_bias_tau_s=1000.0,
        gyro_bias_tau_s=1000.0,
    )
    still = s.StationaryUpdateConfig(
        s.StationaryDetectorConfig(100, 0.3, math.radians(1.0)), 0.05, 0.001
    )
    wheels = s.NonHolonomicConstraintConfig(0.3, 0.5, 3.0, math.radians(20.0))
    config = s.InertialFilterConfig(
        spec,
        loose=s.LooseCouplingConfig(stationary_updates=still, non_holonomic=wheels),
    )
    first = drive.fixes[0]
    C_en = _ned_to_ecef(first.lat_rad, first.lon_rad)
    q_nb = starting_attitude(drive)
    sigma = [first.sigma_h_m] * 3 + [1.0] * 3 + [math.radians(8.0)] * 3
    sigma += [0.3] * 3 + [math.radians(3.0)] * 3
    nominal = s.NavState(
        drive.samples[0].t_ns * 1e-9,
        _ecef(first.lat_rad, first.lon_rad, first.alt_m or 0.0).tolist(),
        (C_en @ np.array([*(first.vel_ne_mps or (0.0, 0.0)), 0.0])).tolist(),
        C_en @ matrix(q_nb),
    )
    state = s.InsFilterState.from_diagonal(
        nominal, s.ErrorStateLayout.FIFTEEN, [x * x for x in sigma]
    )
    running = s.InertialFilter.with_config(state, config)
    history = s.FusionRtsHistoryBuilder.from_filter(running)
    fixes, ahead = iter(drive.fixes[1:]), []
    fix = next(fixes, None)
    for i, sample in enumerate(drive.samples[1:]):
        if fix is None:  # a history ends with a correction
            break
        t_s = sample.t_ns * 1e-9
        reading = s.ImuSample.rate(t_s, sample.accel_mps2, sample.gyro_radps)
        running.propagate_recorded(reading, history)
        if i % 10 == 0:
            running.update_stationary_recorded(history)
            running.update_non_holonomic_recorded(history)
            ahead.append((t_s, *running.state.nominal.position_ecef_m))
        while fix is not None and fix.t_ns * 1e-9 - LATENCY_S <= t_s:
            running.update_loose_recorded(_measured(s, fix, t_s), history)
            fix = next(fixes, None)
    offset_s = _utc_offset_s(drive)
    yield "sidereon, EKF", _track(np.array(ahead), offset_s), None
    smoothed = s.smooth_fusion_rts(history.finish())
    back = {
        epoch.t_j2000_s: epoch.snapshot.state.nominal.position_ecef_m
        for epoch in smoothed.epochs
    }
    rows = np.array([(t_s, *place) for t_s, place in back.items()])[::10]
    yield "sidereon, RTS", _track(rows, offset_s), None


def _measured(s: Any, fix: GpsFix, t_s: float) -> Any:
    """Return a fix as sidereon wants it, at the instant of the filter."""
    C_en = _ned_to_ecef(fix.lat_rad, fix.lon_rad)
    place = _ecef(fix.lat_rad, fix.lon_rad, fix.alt_m or 0.0)
    vn, ve = fix.vel_ne_mps or (0.0, 0.0)
    place = place + C_en @ np.array([vn, ve, 0.0]) * (t_s - fix.t_ns * 1e-9 + LATENCY_S)
    horizontal, vertical = fix.sigma_h_m**2, (2.0 * fix.sigma_h_m) ** 2
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = C_en @ np.diag([horizontal, horizontal, vertical]) @ C_en.T
    covariance[3:, 3:] = C_en @ np.diag([VELOCITY_SIGMA_MPS**2] * 2 + [1.0]) @ C_en.T
    velocity = C_en @ np.array([vn, ve, 0.0])
    return s.GnssFixMeasurement.position_velocity(
        t_s, place.tolist(), velocity.tolist(), covariance, 8
    )


def _ned_to_ecef(lat: float, lon: float) -> Array:
    sa, ca, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    return np.array(
        [[-sa * co, -so, -ca * co], [-sa * so, co, -ca * so], [ca, 0.0, -sa]]
    )


def _ecef(lat: float, lon: float, alt_m: float) -> Array:
    """WGS-84."""
    a, e2 = 6378137.0, 6.69437999014e-3
    n = a / math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
    across = (n + alt_m) * math.cos(lat)
    up = (n * (1.0 - e2) + alt_m) * math.sin(lat)
    return np.array([across * math.cos(lon), across * math.sin(lon), up])


def _track(rows: Array, offset_s: float) -> Track:
    """Latitude by three rounds of Bowring's fixed point: to a micrometre."""
    e2 = 6.69437999014e-3
    t_s, x, y, z = rows.T
    across = np.hypot(x, y)
    lat = np.arctan2(z, across * (1.0 - e2))
    for _ in range(5):
        n = 6378137.0 / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
        lat = np.arctan2(z + e2 * n * np.sin(lat), across)
    return Track(t_s + offset_s, np.degrees(lat), np.degrees(np.arctan2(y, x)))


if __name__ == "__main__":
    main()
