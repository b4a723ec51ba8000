"""The six-state filter: position and velocity, with the attitude from beside.

Each step is rotated by the attitude filter, gravity is added, and the sum drives a
Kalman filter of six states; each fix corrects it. It cannot learn its accelerometer
bias or how the box sits in the vehicle: these stay in the process noise and, where
no noise can carry them, are considered in the radius without being estimated.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imu_tracker.estimation.estimate import R95_PER_SIGMA, Estimate, r95_of
from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.receiver.gate import FixOutcome, Gate
from imu_tracker.estimation.receiver.innovations import InnovationMonitor
from imu_tracker.estimation.six_state import constraints
from imu_tracker.estimation.six_state.attitude import AttitudeFilter
from imu_tracker.estimation.six_state.attitude_aiding import AttitudeAiding
from imu_tracker.estimation.six_state.position_filter import PositionFilter
from imu_tracker.geometry.geodesy import FRAME_RADIUS_M, LocalFrame, gravity_mps2
from imu_tracker.geometry.rotation import rotate
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import GpsFix, Vec3

ACCEL_NOISE_PSD: Final = 0.1**2
"""White acceleration noise, (m/s^2)^2/Hz: vibration, scale and timing errors."""

ACCEL_BIAS_SIGMA_MPS2: Final = 0.15
"""What remains in a level axis, beside the tilt that the attitude filter knows of:
bias that turns with the vehicle, scale, a yaw that is the course's and not the box's.
15 mg, a third of the datasheet's zero-g tolerance (PS-MPU-6000A section 6.2)."""

UNKNOWN_ACCEL_PSD: Final = 1.5**2
"""While the yaw or the whole IMU is unknown: a vehicle's own acceleration,
1.5 m/s^2 for a second."""

CORRELATED_SHARE: Final = 0.8
"""Part of a fix's variance that lasts a minute (ionosphere, orbits, multipath): no
averaging removes it, so it is added to the radius."""

PARKED_CORRELATION_S: Final = 60.0
"""How long: fixes of a parked receiver count once in so much time."""

VELOCITY_SIGMA_MPS: Final = 0.15
"""Error of a Doppler velocity, per axis."""

LATENCY_SIGMA_S: Final = 0.1
"""How far the configured latency may be off."""

ALTITUDE_FACTOR: Final = 2.0
"""Vertical against horizontal error of a receiver: its satellites are all above."""

CRUISE_SPEED_MPS: Final = {"vehicle": 40.0, "walker": 2.0, "free": 60.0}
"""In the dark the speed's uncertainty stops growing here."""

_LARGEST_RADIUS_M: Final = 2e7  # half way round the Earth
_CONSTRAINT_PERIOD_S: Final = 0.2  # see CONSTRAINT_CORRELATION_FACTOR


class SixState:
    """Position and velocity in NED by a linear Kalman filter.

    Parameters
    ----------
    profile : {"free", "vehicle", "walker"}
        A vehicle does not move sideways; what else moves may.
    lever_arm_m : Vec3, body axes
        From the chip to the antenna. The filter follows the chip, and speaks of the
        antenna.
    fix_period : FixPeriod, optional
        The tracker's, which sees every fix.

    Notes
    -----
    x = (p_n, v_n) of the chip, driven by the mean acceleration of a step,
    u = C_nb (dv_b / dt - b_a) + g_n.
    """

    def __init__(
        self,
        profile: str,
        lever_arm_m: Vec3 = (0.0, 0.0, 0.0),
        fix_period: FixPeriod | None = None,
    ) -> None:
        self._profile = profile
        self._lever_arm_m = lever_arm_m if any(lever_arm_m) else None
        self._cruise_var = CRUISE_SPEED_MPS[profile] ** 2
        self._attitude = AttitudeFilter()
        self._aiding = AttitudeAiding(self._attitude, profile)
        self._gate = Gate(profile)
        self._kf = PositionFilter()
        # Of the whole run, not of an instant: never taken back.
        self._monitor = InnovationMonitor(fix_period or FixPeriod())
        self._ambiguity_m = 0.0
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

    # ------------------------------------------------------------- the estimate

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        self._frame = LocalFrame.at(lat_rad, lon_rad)
        self._gravity_mps2 = gravity_mps2(lat_rad)
        self._alt_origin_m = None
        self._kf.x = np.zeros(6)
        any_speed = 0.25 * self._cruise_var
        self._kf.P = np.diag([sigma_m**2] * 2 + [1e4] + [any_speed] * 2 + [1.0])
        self._outage_s, self._drift_m = 0.0, (0.0, 0.0)
        self._monitor.start()
        self._is_started = True

    def estimate(self) -> Estimate:
        """The estimate at the end of the last step."""
        north, east, down, vn, ve, vd = self._kf.x.tolist()
        q_nb = self._attitude.q_nb
        if self._lever_arm_m is not None:
            (ln, le, ld), (un, ue, ud) = self._lever_n()
            north, east, down = north + ln, east + le, down + ld
            vn, ve, vd = vn + un, ve + ue, vd + ud
        lat, lon = self._frame.to_lat_lon(north, east)
        alt = None if self._alt_origin_m is None else self._alt_origin_m - down
        r95 = max(r95_of(self._position_cov_m2(vn, ve)), self._ambiguity_m)
        return Estimate(lat, lon, alt, (vn, ve, vd), q_nb, min(r95, _LARGEST_RADIUS_M))

    def _position_cov_m2(self, vn: float, ve: float) -> NDArray[np.float64]:
        """Covariance of the horizontal position, with what is only considered.

        Beside P: the lasting part of the receiver's error, the way travelled under a
        yaw that is off (`_drift_m`), and the way travelled within the error of the
        latency.
        """
        monitor = self._monitor
        lasting = CORRELATED_SHARE * monitor.sigma_h_m**2 * monitor.nis_level
        late = LATENCY_SIGMA_S**2
        dn, de = self._drift_m
        cross = dn * de + late * vn * ve
        considered = [
            [lasting + dn * dn + late * vn * vn, cross],
            [cross, lasting + de * de + late * ve * ve],
        ]
        cov: NDArray[np.float64] = self._kf.P[:2, :2] + considered
        return cov

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
        vn, ve = self._kf.x[3:5].tolist()
        P = self._kf.P
        return math.hypot(vn, ve), math.sqrt(max(P[3, 3], P[4, 4]))

    def gyro_bias(self) -> tuple[Vec3, float]:
        """Gyro bias in rad/s, body axes, and its standard deviation per axis."""
        return self._attitude.gyro_bias_radps, self._attitude.gyro_bias_sigma_radps

    def snapshot(self) -> object:
        """All that changes with time; arrays are replaced, never changed in place."""
        return (
            self._attitude.snapshot(),
            self._aiding.snapshot(),
            self._kf.x,
            self._kf.P,
            self._is_started,
            self._frame,
            self._gravity_mps2,
            self._alt_origin_m,
            self._a_n,
            self._rate_b_radps,
            self._outage_s,
            self._drift_m,
            self._constraint_due_s,
            self._is_resting,
        )

    def restore(self, saved: object) -> None:
        """Return to a snapshot."""
        assert isinstance(saved, tuple)
        attitude, aiding = saved[:2]
        self._attitude.restore(attitude)
        self._aiding.restore(aiding)
        (
            self._kf.x,
            self._kf.P,
            self._is_started,
            self._frame,
            self._gravity_mps2,
            self._alt_origin_m,
            self._a_n,
            self._rate_b_radps,
            self._outage_s,
            self._drift_m,
            self._constraint_due_s,
            self._is_resting,
        ) = saved[2:]

    def report(self) -> dict[str, object]:
        """What was learnt, for people."""
        bias, sigma = self.gyro_bias()
        return {
            "estimator": "six-state",
            "profile": self._profile,
            "gyro_bias_dps": [math.degrees(b) for b in bias],
            "gyro_bias_sigma_dps": math.degrees(sigma),
            "tilt_sigma_deg": math.degrees(self._attitude.tilt_sigma_rad),
            "yaw_sigma_deg": math.degrees(self._attitude.yaw_sigma_rad),
            "fix_period_s": self._monitor.period.mean_s,
            "nis_mean": self._monitor.nis_mean,
        }

    # ------------------------------------------------------------ with each step

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
                # A reading that was clipped may be off by as much as it says.
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
        psd = psd_down = ACCEL_NOISE_PSD if self._is_resting else UNKNOWN_ACCEL_PSD
        if can_rotate and attitude.is_yaw_usable:
            an, ae, ad = self._a_n
            # An error that lasts, s for a time T, has the variances s^2 T^2 of the
            # velocity and s^2 T^4 / 4 of the position. White noise of 3 s^2 T grows
            # to the same position.
            lasting = (
                ACCEL_BIAS_SIGMA_MPS2**2
                + (self._gravity_mps2 * attitude.tilt_sigma_rad) ** 2
                + (an * an + ae * ae) * sigma_yaw**2
            )
            # Rest is seen anew all the time.
            lasted_s = 0.0 if self._is_resting else self._outage_s
            psd = ACCEL_NOISE_PSD + lasting * max(1.0, 3.0 * lasted_s)
            psd_down = ACCEL_NOISE_PSD + ACCEL_BIAS_SIGMA_MPS2**2
            dn, de = self._drift_m
            self._drift_m = (dn - sigma_yaw * ve * dt, de + sigma_yaw * vn * dt)
        if P[3, 3] + P[4, 4] > self._cruise_var:
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
                    self._kf.P[3:, 3:],
                    attitude.yaw_rad,
                    attitude.yaw_sigma_rad,
                    self._aiding.rate_down_radps,
                )
            )
        if self._outage_s > 3.0:
            self._move_frame()

    # ------------------------------------------------------------- with each fix

    def update(self, fix: GpsFix, ahead_s: float) -> FixOutcome:
        """Correct by a fix that describes the instant `ahead_s` after the last step."""
        speed = math.hypot(*fix.vel_ne_mps) if fix.vel_ne_mps else self.speed()[0]
        if self._gate.is_frozen(fix, speed):
            # By its own word it moves, or else by the filter's, which may be wrong.
            if fix.vel_ne_mps is None and self._gate.reject(fix):
                self._restart(fix)
                return FixOutcome.REACQUIRED
            return FixOutcome.FROZEN
        monitor = self._monitor
        monitor.period.add_fix(fix)
        z, z_v = self._measured_ne(fix, ahead_s)
        # The way travelled under a wrong yaw becomes part of P before it is weighed.
        drift = np.zeros(6)
        drift[:2], self._drift_m = self._drift_m, (0.0, 0.0)
        self._kf.P = self._kf.P + np.outer(drift, drift)

        variance = fix.sigma_h_m**2 * monitor.nis_level
        innovation = z - self._kf.x[:2]
        if not self._is_resting:  # at rest it is the receiver that wanders
            self._kf.P = self._kf.P * monitor.fading
        S = self._kf.P[:2, :2] + np.eye(2) * variance
        nis = float(innovation @ np.linalg.solve(S, innovation))
        if not self._gate.passes(nis):
            miss_m = math.hypot(*innovation.tolist())
            if self._gate.reject(fix):
                self._restart(fix)
                return FixOutcome.REACQUIRED
            if self._gate.n_agreeing > 1:
                # Two say the same: the truth may be there as well as here.
                self._ambiguity_m = miss_m + R95_PER_SIGMA * fix.sigma_h_m
            return FixOutcome.OUTLIER
        self._ambiguity_m = 0.0
        monitor.learn_noise(fix, innovation, S, nis)
        factor = max(1.0, 1.0 / monitor.period.mean_s)
        parked = 2.0 * PARKED_CORRELATION_S / monitor.period.mean_s
        weight = parked if self._is_resting else factor
        self._kf.update(z, slice(0, 2), variance * weight)
        self._update_altitude(fix, variance * weight)
        sigma_v = math.hypot(
            VELOCITY_SIGMA_MPS, LATENCY_SIGMA_S * math.hypot(*self._a_n[:2])
        )
        if z_v is not None and not self._is_resting:
            self._kf.update_velocity(z_v, sigma_v**2 * factor)
        self._aid(fix, sigma_v)
        self._outage_s = 0.0
        self._move_frame()
        return FixOutcome.ACCEPTED

    def _measured_ne(
        self, fix: GpsFix, ahead_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        """Position and velocity of the chip at the last step, by the fix."""
        vn, ve = self._kf.x[3:5].tolist()
        (ln, le, _), (un, ue, _) = self._lever_n()
        north, east = self._frame.to_ne(fix.lat_rad, fix.lon_rad)
        z = np.array((north - ln - vn * ahead_s, east - le - ve * ahead_s))
        if fix.vel_ne_mps is None:
            return z, None
        zn, ze = fix.vel_ne_mps
        return z, np.array((zn - un, ze - ue))

    def _update_altitude(self, fix: GpsFix, variance: float) -> None:
        if fix.alt_m is None:
            # Nothing else holds the vertical channel.
            self._kf.update(np.zeros(1), slice(5, 6), 1.0)
            return
        if self._alt_origin_m is None:
            self._alt_origin_m = fix.alt_m
            self._kf.x = self._kf.x * [1.0, 1.0, 0.0, 1.0, 1.0, 1.0]
        z = np.array([self._alt_origin_m - fix.alt_m])
        self._kf.update(z, slice(2, 3), variance * ALTITUDE_FACTOR**2)

    def _aid(self, fix: GpsFix, sigma_v: float) -> None:
        """Let the fix correct the attitude."""
        if fix.vel_ne_mps is not None:
            self._aiding.update_from_velocity(
                fix.vel_ne_mps, sigma_v, self._gravity_mps2
            )
            if not self._is_resting:
                self._aiding.update_from_course(
                    fix.vel_ne_mps, sigma_v, self._monitor.period.mean_s
                )
        elif not self._is_resting:
            vn, ve = self._kf.x[3:5].tolist()
            _, sigma = self.speed()
            self._aiding.update_from_course(
                (vn, ve), sigma, self._monitor.period.mean_s
            )

    def _restart(self, fix: GpsFix) -> None:
        """Begin anew from the receiver; the attitude stays."""
        alt_m = self.estimate().alt_m if fix.alt_m is None else fix.alt_m
        self.start(fix.lat_rad, fix.lon_rad, fix.sigma_h_m)
        self._alt_origin_m = alt_m
        self._monitor.start(fix.sigma_h_m)
        self._ambiguity_m = 0.0
        if fix.vel_ne_mps is not None:
            self._kf.x = np.array([0.0, 0.0, 0.0, *fix.vel_ne_mps, 0.0])
            variances = [fix.sigma_h_m**2] * 2 + [1e4] + [1.0] * 3
            self._kf.P = np.diag(variances)

    def _move_frame(self) -> None:
        """Take the origin along when the way from it grows."""
        north, east, *_ = self._kf.x.tolist()
        if math.hypot(north, east) > FRAME_RADIUS_M:
            lat, lon = self._frame.to_lat_lon(north, east)
            self._frame = LocalFrame.at(lat, lon)
            self._gravity_mps2 = gravity_mps2(lat)
            self._kf.x = self._kf.x * [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
