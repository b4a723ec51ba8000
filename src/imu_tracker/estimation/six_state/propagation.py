"""The six-state filter between fixes.

Each step is rotated by the attitude filter, gravity is added, and the sum drives the
Kalman filter of position and velocity.
"""

import math
from operator import attrgetter
from typing import Final

import numpy as np

from imu_tracker.estimation.six_state import constraints
from imu_tracker.estimation.six_state.attitude import AttitudeFilter
from imu_tracker.estimation.six_state.attitude_aiding import AttitudeAiding
from imu_tracker.estimation.six_state.position_filter import (
    VELOCITY,
    VELOCITY_NE,
    PositionFilter,
)
from imu_tracker.estimation.tuning import (
    SIX_ACCEL_BIAS_SIGMA_MPS2,
    SIX_ACCEL_NOISE_PSD,
    SIX_CRUISE_SPEED_MPS,
    SIX_UNKNOWN_ACCEL_PSD,
)
from imu_tracker.geometry.geodesy import FRAME_RADIUS_M, LocalFrame, gravity_mps2
from imu_tracker.geometry.rotation import rotate
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import Vec3

_CONSTRAINT_PERIOD_S: Final = 0.2  # see CONSTRAINT_CORRELATION_FACTOR

_OF_AN_INSTANT: Final = (
    *("_is_started", "_frame", "_gravity_mps2", "_alt_origin_m", "_a_n"),
    *("_rate_b_radps", "_outage_s", "_drift_m", "_constraint_due_s", "_is_resting"),
)
_instant_of = attrgetter(*_OF_AN_INSTANT)


class Propagation:
    """Position and velocity of the chip through time, and how to return to an instant.

    Parameters
    ----------
    profile : {"free", "vehicle", "walker"}
    lever_arm_m : Vec3, body axes
        From the chip to the antenna.
    """

    def __init__(self, profile: str, lever_arm_m: Vec3) -> None:
        self._profile = profile
        self._lever_arm_m = lever_arm_m if any(lever_arm_m) else None
        self._cruise_var = SIX_CRUISE_SPEED_MPS[profile] ** 2
        self._attitude = AttitudeFilter()
        self._aiding = AttitudeAiding(self._attitude, profile)
        self._kf = PositionFilter()
        # Of an instant: what a snapshot holds.
        self._is_started = False
        self._frame = LocalFrame.at(0.0, 0.0)
        self._gravity_mps2 = gravity_mps2(math.radians(45.0))
        self._alt_origin_m: float | None = None
        self._a_n: Vec3 = (0.0, 0.0, 0.0)
        self._rate_b_radps: Vec3 = (0.0, 0.0, 0.0)
        self._outage_s = 0.0
        self._drift_m = (0.0, 0.0)
        self._constraint_due_s = 0.0
        self._is_resting = False

    def start_motion(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        self._frame = LocalFrame.at(lat_rad, lon_rad)
        self._gravity_mps2 = gravity_mps2(lat_rad)
        self._alt_origin_m = None
        self._kf.x = np.zeros(6)
        any_speed = 0.25 * self._cruise_var
        self._kf.P = np.diag([sigma_m**2] * 2 + [1e4] + [any_speed] * 2 + [1.0])
        self._outage_s, self._drift_m = 0.0, (0.0, 0.0)
        self._is_started = True

    def _lever_n(self) -> tuple[Vec3, Vec3]:
        """Lever arm in navigation axes, and how fast its end moves: rate x lever."""
        if self._lever_arm_m is None or not self._attitude.is_yaw_usable:
            return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        (lx, ly, lz), (wx, wy, wz) = self._lever_arm_m, self._rate_b_radps
        q_nb = self._attitude.q_nb
        swing_b = (wy * lz - wz * ly, wz * lx - wx * lz, wx * ly - wy * lx)
        return rotate(q_nb, self._lever_arm_m), rotate(q_nb, swing_b)

    def speed(self) -> tuple[float, float]:
        """Horizontal speed in m/s and its standard deviation."""
        vn, ve = self._kf.x[VELOCITY_NE].tolist()
        worst = max(self._kf.P.diagonal()[VELOCITY_NE])
        return math.hypot(vn, ve), math.sqrt(worst)

    def snapshot(self) -> object:
        """All that changes with time; arrays are replaced, never changed in place."""
        filters = self._attitude.snapshot(), self._aiding.snapshot()
        return (*filters, self._kf.x, self._kf.P, _instant_of(self))

    def restore(self, saved: object) -> None:
        """Return to a snapshot."""
        assert isinstance(saved, tuple)
        attitude, aiding, self._kf.x, self._kf.P, instant = saved
        self._attitude.restore(attitude)
        self._aiding.restore(aiding)
        for name, value in zip(_OF_AN_INSTANT, instant, strict=True):
            setattr(self, name, value)

    def propagate(self, step: ImuStep, rest: Rest | None) -> None:
        """Move on by a step; `rest` when the body stands still."""
        dt = step.dt_s
        attitude = self._attitude
        self._is_resting = rest is not None
        clipped_mps = 0.0
        if step.is_gap:
            attitude.propagate_gap(dt)
            self._a_n, can_rotate = (0.0, 0.0, 0.0), False
        else:
            # The increment is in body axes at the start of the step: rotate first.
            (dvx, dvy, dvz), (bx, by, bz) = step.dv_b_mps, self._aiding.accel_bias_mps2
            dv_b = (dvx - bx * dt, dvy - by * dt, dvz - bz * dt)
            dvn, dve, dvd = rotate(attitude.q_nb, dv_b)
            tx, ty, tz = step.dtheta_b_rad
            self._rate_b_radps = (tx / dt, ty / dt, tz / dt)
            attitude.propagate(step)
            if step.is_saturated:
                # The error of a clipped reading may be as large as the reading.
                attitude.inflate(math.hypot(tx, ty, tz))
                clipped_mps = math.hypot(*dv_b)
            can_rotate = attitude.is_level
            self._a_n = (dvn / dt, dve / dt, dvd / dt + self._gravity_mps2)
        self._aiding.propagate(step, self._a_n)
        if self._is_started:
            self._predict(dt, can_rotate, clipped_mps)
        self._constraint_due_s -= dt
        if self._constraint_due_s <= 0.0:
            self._constraint_due_s = _CONSTRAINT_PERIOD_S
            if rest is not None:
                self._aiding.update_from_rest(rest, self._gravity_mps2)
            self._aiding.update_from_gravity(self._kf.v_n, self._gravity_mps2)
            if self._is_started:
                self._constrain(rest is not None, can_rotate)

    def _predict(self, dt: float, can_rotate: bool, clipped_mps: float) -> None:
        """Kalman prediction with the acceleration as input."""
        attitude, P = self._attitude, self._kf.P
        self._outage_s += dt
        vn, ve, _ = self._kf.v_n
        sigma_yaw = attitude.yaw_sigma_rad
        an = ae = ad = 0.0
        psd = psd_down = (
            SIX_ACCEL_NOISE_PSD if self._is_resting else SIX_UNKNOWN_ACCEL_PSD
        )
        if can_rotate and attitude.is_yaw_usable:
            an, ae, ad = self._a_n
            # An error that lasts, s for a time T, has the variances s^2 T^2 of the
            # velocity and s^2 T^4 / 4 of the position. White noise of 3 s^2 T grows
            # to the same position.
            lasting = (
                SIX_ACCEL_BIAS_SIGMA_MPS2**2
                + (self._gravity_mps2 * attitude.tilt_sigma_rad) ** 2
                + (an * an + ae * ae) * sigma_yaw**2
            )
            # At rest each step is a new measurement.
            lasted_s = 0.0 if self._is_resting else self._outage_s
            psd = SIX_ACCEL_NOISE_PSD + lasting * max(1.0, 3.0 * lasted_s)
            psd_down = SIX_ACCEL_NOISE_PSD + SIX_ACCEL_BIAS_SIGMA_MPS2**2
            dn, de = self._drift_m
            self._drift_m = (dn - sigma_yaw * ve * dt, de + sigma_yaw * vn * dt)
        if sum(P.diagonal()[VELOCITY_NE]) > self._cruise_var:
            psd = 0.0
        psd += clipped_mps**2 / dt
        self._kf.predict(dt, (an, ae, ad), (psd, psd, psd_down))

    def _constrain(self, is_resting: bool, can_rotate: bool) -> None:
        """Apply what the body cannot do."""
        attitude, v_n = self._attitude, self._kf.v_n
        if is_resting:
            self._kf.update_constraint(constraints.zero_velocity(v_n))
        elif self._profile == "vehicle" and can_rotate and attitude.is_yaw_usable:
            self._kf.update_constraint(
                constraints.non_holonomic(
                    v_n,
                    self._kf.P[VELOCITY, VELOCITY],
                    attitude.yaw_rad,
                    attitude.yaw_sigma_rad,
                    self._aiding.rate_down_radps,
                )
            )
        if self._outage_s > 3.0:
            self._move_frame()

    def _move_frame(self) -> None:
        """Take the origin along when the way from it grows."""
        north, east, *_ = self._kf.x.tolist()
        if math.hypot(north, east) > FRAME_RADIUS_M:
            lat, lon = self._frame.to_lat_lon(north, east)
            self._frame = LocalFrame.at(lat, lon)
            self._gravity_mps2 = gravity_mps2(lat)
            self._kf.x = self._kf.x * [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
