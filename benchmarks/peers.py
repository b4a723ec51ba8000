"""The same drive by others: a plain filterpy loop, and pyins.

Both get samples and fixes that were read and decoded for them, and write no log: the
comparison flatters them. Both start from the same attitude.
"""

import math
from typing import Any, Final

import numpy as np
from filterpy.kalman import KalmanFilter

from benchmarks.drives import Drive
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import (
    from_rotation_vector,
    level_from_gravity,
    multiply,
    rotate,
    to_euler,
    turn_about_down,
)
from imu_tracker.samples import GpsFix, Quat

GRAVITY_MPS2: Final = 9.81
LATENCY_S: Final = 0.2
COURSE_SPEED_MPS: Final = 3.0
VELOCITY_SIGMA_MPS: Final = 0.3
LEVELLING_SAMPLES: Final = 100


def run_plain_filterpy(drive: Drive) -> tuple[float, float]:
    """Filter a drive as one does in an afternoon; return the last place in radians.

    Six states, one prediction a sample, one update a fix. No bias, no gate, no
    standstill, no late fixes, no radius. The quaternions are imu-tracker's.
    """
    q_nb = starting_attitude(drive)
    frame = LocalFrame.at(drive.fixes[0].lat_rad, drive.fixes[0].lon_rad)
    kf = KalmanFilter(dim_x=6, dim_z=4, dim_u=3)
    kf.x = np.zeros(6)
    kf.P = np.diag([10.0**2] * 3 + [1.0] * 3)
    kf.H = np.eye(6)[[0, 1, 3, 4]]
    last_ns = drive.samples[0].t_ns
    for event in drive.events():
        if isinstance(event, GpsFix):
            vel_ne_mps = event.vel_ne_mps or kf.x[3:5]
            kf.R = np.diag([event.sigma_h_m**2] * 2 + [VELOCITY_SIGMA_MPS**2] * 2)
            kf.update(
                np.array([*frame.to_ne(event.lat_rad, event.lon_rad), *vel_ne_mps])
            )
            continue
        dt, last_ns = (event.t_ns - last_ns) * 1e-9, event.t_ns
        wx, wy, wz = event.gyro_radps
        q_nb = multiply(q_nb, from_rotation_vector((wx * dt, wy * dt, wz * dt)))
        u = np.add(rotate(q_nb, event.accel_mps2), (0.0, 0.0, GRAVITY_MPS2))
        F = np.eye(6)
        F[:3, 3:] = np.eye(3) * dt
        B = np.vstack([np.eye(3) * dt**2 / 2, np.eye(3) * dt])
        kf.predict(u, B=B, F=F, Q=B @ B.T)
    return frame.to_lat_lon(*kf.x[:2].tolist())


def run_pyins(drive: Drive) -> tuple[float, float]:
    """Filter a drive by pyins' feedback filter; return the last place in radians."""
    last = pyins_trajectory(drive).iloc[-1]
    return math.radians(last.lat), math.radians(last.lon)


def pyins_trajectory(drive: Drive) -> Any:
    """Filter a drive by pyins' feedback filter; return its table of places.

    Fifteen states: the biases of a chip of this class are modelled, as its
    documentation shows; all else is its default. Source: python-ins 1.0,
    `filters.run_feedback_filter`.
    """
    import pandas as pd  # type: ignore[import-untyped]
    from pyins import filters, inertial_sensor, measurements, strapdown, util

    imu = pd.DataFrame(
        [(*sample.gyro_radps, *sample.accel_mps2) for sample in drive.samples],
        index=[sample.t_ns * 1e-9 for sample in drive.samples],
        columns=util.GYRO_COLS + util.ACCEL_COLS,
    )
    gps = pd.DataFrame(
        [_lat_lon_alt_and_velocity(fix) for fix in drive.fixes],
        index=[fix.t_ns * 1e-9 - LATENCY_S for fix in drive.fixes],
        columns=util.LLA_COLS + util.VEL_COLS,
    )
    rph_deg = [math.degrees(angle) for angle in to_euler(starting_attitude(drive))]
    start = pd.Series(
        [*gps.iloc[0], *rph_deg], index=util.TRAJECTORY_COLS, name=imu.index[0]
    )
    result = filters.run_feedback_filter(
        start,
        position_sd=10.0,
        velocity_sd=1.0,
        level_sd=5.0,
        azimuth_sd=10.0,
        increments=strapdown.compute_increments_from_imu(imu, "rate"),
        gyro_model=inertial_sensor.EstimationModel(
            bias_sd=math.radians(3.0),
            noise=math.radians(0.02),
            bias_walk=math.radians(0.002),
        ),
        accel_model=inertial_sensor.EstimationModel(
            bias_sd=0.3, noise=0.1, bias_walk=0.001
        ),
        measurements=[
            measurements.Position(gps, sd=drive.fixes[0].sigma_h_m),
            measurements.NedVelocity(gps, sd=VELOCITY_SIGMA_MPS),
        ],
    )
    return result.trajectory


def starting_attitude(drive: Drive) -> Quat:
    """Level by the first second, heading by the first course."""
    forces = [sample.accel_mps2 for sample in drive.samples[:LEVELLING_SAMPLES]]
    fx, fy, fz = np.mean(forces, axis=0).tolist()
    velocities = (fix.vel_ne_mps or (0.0, 0.0) for fix in drive.fixes)
    fast = (v for v in velocities if math.hypot(*v) > COURSE_SPEED_MPS)
    vn, ve = next(fast, (1.0, 0.0))
    return turn_about_down(level_from_gravity((fx, fy, fz)), math.atan2(ve, vn))


def _lat_lon_alt_and_velocity(fix: GpsFix) -> tuple[float, ...]:
    place = (math.degrees(fix.lat_rad), math.degrees(fix.lon_rad), fix.alt_m or 0.0)
    return (*place, *(fix.vel_ne_mps or (0.0, 0.0)), 0.0)
