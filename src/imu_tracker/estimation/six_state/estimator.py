"""The six-state filter: position and velocity, with an attitude filter beside it.

Steps drive it (`propagation`), and each fix corrects it. It does not estimate its
accelerometer bias or its mounting: these are in the process noise and, where no noise
can represent them, in the radius.
"""

import math

import numpy as np
from numpy.typing import NDArray

from imu_tracker.estimation.estimate import R95_PER_SIGMA, Estimate, r95_of
from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.receiver.gate import FixOutcome, Gate
from imu_tracker.estimation.receiver.innovations import InnovationMonitor
from imu_tracker.estimation.report import EstimatorReport
from imu_tracker.estimation.six_state.position_filter import (
    DOWN,
    POSITION_NE,
    VELOCITY_DOWN,
    VELOCITY_NE,
)
from imu_tracker.estimation.six_state.propagation import Propagation
from imu_tracker.estimation.tuning import (
    ALTITUDE_FACTOR,
    LARGEST_RADIUS_M,
    RECEIVER_CORRELATION_S,
    SIX_CORRELATED_SHARE,
    SIX_LATENCY_SIGMA_S,
    SIX_VELOCITY_SIGMA_MPS,
)
from imu_tracker.samples import GpsFix, Vec3


class SixState(Propagation):
    """Position and velocity in NED by a linear Kalman filter.

    Parameters
    ----------
    profile : {"free", "vehicle", "walker"}
        A vehicle does not move sideways; what else moves may.
    lever_arm_m : Vec3, body axes
        From the chip to the antenna. The filter follows the chip; estimates are of the
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
        super().__init__(profile, lever_arm_m)
        self._gate = Gate(profile)
        # Of the whole run, not of an instant: never taken back.
        self._monitor = InnovationMonitor(fix_period or FixPeriod())
        self._ambiguity_m = 0.0

    # ------------------------------------------------------------- the estimate

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        self.start_motion(lat_rad, lon_rad, sigma_m)
        self._monitor.start()

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
        return Estimate(lat, lon, alt, (vn, ve, vd), q_nb, min(r95, LARGEST_RADIUS_M))

    def _position_cov_m2(self, vn: float, ve: float) -> NDArray[np.float64]:
        """Covariance of the horizontal position, with what is only considered.

        Beside P: the lasting part of the receiver's error, the way travelled under a
        yaw that is off (`_drift_m`), and the way travelled within the error of the
        latency.
        """
        monitor = self._monitor
        lasting = SIX_CORRELATED_SHARE * monitor.sigma_h_m**2 * monitor.nis_level
        late = SIX_LATENCY_SIGMA_S**2
        dn, de = self._drift_m
        cross = dn * de + late * vn * ve
        considered = [
            [lasting + dn * dn + late * vn * vn, cross],
            [cross, lasting + de * de + late * ve * ve],
        ]
        cov: NDArray[np.float64] = self._kf.P[POSITION_NE, POSITION_NE] + considered
        return cov

    def gyro_bias(self) -> tuple[Vec3, float]:
        """Gyro bias in rad/s, body axes, and its standard deviation per axis."""
        return self._attitude.gyro_bias_radps, self._attitude.gyro_bias_sigma_radps

    def report(self) -> EstimatorReport:
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

    # ------------------------------------------------------------- with each fix

    def update(self, fix: GpsFix, ahead_s: float) -> FixOutcome:
        """Correct by a fix that describes the instant `ahead_s` after the last step."""
        speed = math.hypot(*fix.vel_ne_mps) if fix.vel_ne_mps else self.speed()[0]
        if self._gate.is_frozen(fix, speed):
            # It moves by its own velocity, or by the filter's, which may be wrong.
            if fix.vel_ne_mps is None and self._gate.reject(fix):
                self._restart(fix)
                return FixOutcome.REACQUIRED
            return FixOutcome.FROZEN
        monitor = self._monitor
        monitor.period.add_fix(fix)
        z, z_v = self._measured_ne(fix, ahead_s)
        # The way travelled under a wrong yaw becomes part of P before it is weighed.
        drift = np.zeros(6)
        drift[POSITION_NE], self._drift_m = self._drift_m, (0.0, 0.0)
        self._kf.P = self._kf.P + np.outer(drift, drift)

        variance = fix.sigma_h_m**2 * monitor.nis_level
        innovation = z - self._kf.x[POSITION_NE]
        if not self._is_resting:  # at rest it is the receiver that wanders
            self._kf.P = self._kf.P * monitor.fading
        S = self._kf.P[POSITION_NE, POSITION_NE] + np.eye(2) * variance
        nis = float(innovation @ np.linalg.solve(S, innovation))
        if not self._gate.passes(nis):
            miss_m = math.hypot(*innovation.tolist())
            if self._gate.reject(fix):
                self._restart(fix)
                return FixOutcome.REACQUIRED
            if self._gate.n_agreeing > 1:
                # Two rejected fixes agree: r95 must reach them.
                self._ambiguity_m = miss_m + R95_PER_SIGMA * fix.sigma_h_m
            return FixOutcome.OUTLIER
        self._ambiguity_m = 0.0
        monitor.learn_noise(fix, innovation, S, nis)
        factor = max(1.0, 1.0 / monitor.period.mean_s)
        parked = 2.0 * RECEIVER_CORRELATION_S / monitor.period.mean_s
        weight = parked if self._is_resting else factor
        self._kf.update(z, POSITION_NE, variance * weight)
        self._update_altitude(fix, variance * weight)
        sigma_v = math.hypot(
            SIX_VELOCITY_SIGMA_MPS, SIX_LATENCY_SIGMA_S * math.hypot(*self._a_n[:2])
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
        vn, ve = self._kf.x[VELOCITY_NE].tolist()
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
            self._kf.update(np.zeros(1), VELOCITY_DOWN, 1.0)
            return
        if self._alt_origin_m is None:
            self._alt_origin_m = fix.alt_m
            self._kf.x = self._kf.x * [1.0, 1.0, 0.0, 1.0, 1.0, 1.0]
        z = np.array([self._alt_origin_m - fix.alt_m])
        self._kf.update(z, DOWN, variance * ALTITUDE_FACTOR**2)

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
            vn, ve = self._kf.x[VELOCITY_NE].tolist()
            _, sigma = self.speed()
            self._aiding.update_from_course(
                (vn, ve), sigma, self._monitor.period.mean_s
            )

    def _restart(self, fix: GpsFix) -> None:
        """Start again at the receiver's position; the attitude stays."""
        alt_m = self.estimate().alt_m if fix.alt_m is None else fix.alt_m
        self.start(fix.lat_rad, fix.lon_rad, fix.sigma_h_m)
        self._alt_origin_m = alt_m
        self._monitor.start(fix.sigma_h_m)
        self._ambiguity_m = 0.0
        if fix.vel_ne_mps is not None:
            self._kf.x = np.array([0.0, 0.0, 0.0, *fix.vel_ne_mps, 0.0])
            variances = [fix.sigma_h_m**2] * 2 + [1e4] + [1.0] * 3
            self._kf.P = np.diag(variances)
