"""Estimates for the rows: the leading hypothesis, and a radius that holds both.

The filters run behind the newest step (`fixed_lag`). An estimate is predicted from
their instant through the steps that wait, and is combined with that of the receiver
alone.
"""

import math

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.fix_update import FixUpdate
from imu_tracker.estimation.error_state.fixed_lag import FixedLagBuffer
from imu_tracker.estimation.error_state.hypotheses.alignment import Alignment
from imu_tracker.estimation.error_state.hypotheses.mixture import radius_m
from imu_tracker.estimation.error_state.hypotheses.noise_bank import NoiseBank
from imu_tracker.estimation.error_state.hypotheses.receiver_alone import AloneEstimate
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.propagation import Propagation
from imu_tracker.estimation.error_state.states import (
    DELAY,
    N_ERRORS,
    POSITION,
    RECEIVER,
    V_E,
    V_N,
    VELOCITY,
    Array,
    Scene,
)
from imu_tracker.estimation.estimate import R95_PER_SIGMA, Estimate, r95_of
from imu_tracker.estimation.tuning import LARGEST_RADIUS_M, LONGER_SHARE
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import rotate
from imu_tracker.samples import Vec3


class Combined:
    """Predicts position and velocity to any instant near the newest step.

    Parameters
    ----------
    lever_arm_m : Vec3, body axes
        From the chip to the antenna.
    bank, alignment, platform, propagation, fixes, buffer
        The parts of the estimator; they are read, never changed.
    """

    def __init__(
        self,
        lever_arm_m: Vec3,
        bank: NoiseBank,
        alignment: Alignment,
        platform: Platform,
        propagation: Propagation,
        fixes: FixUpdate,
        buffer: FixedLagBuffer,
    ) -> None:
        self._lever_arm_m = lever_arm_m
        self._bank, self._alignment, self._platform = bank, alignment, platform
        self._propagation, self._fixes, self._buffer = propagation, fixes, buffer

    @property
    def _eskf(self) -> Eskf:
        return self._bank.main

    @property
    def _has_imu_lead(self) -> bool:
        fixes = self._fixes
        is_silent = self._propagation.is_imu_silent
        return not fixes.comparison.alone.is_running or (
            fixes.comparison.odds.has_imu_lead and not is_silent
        )

    def scene(self) -> Scene:
        """Return what a smoother must know beside the filters, at their instant."""
        odds, propagation = self._fixes.comparison.odds, self._propagation
        return Scene(
            propagation.frame,
            self._fixes.alt_origin_m,
            self._buffer.shift_ns * 1e-9,
            propagation.outage_s,
            self._alignment.is_aligned,
            has_imu=not (odds.is_imu_out or propagation.is_imu_silent),
            odds_nats=odds.nats,
        )

    def estimate_after(self, dt_s: float) -> Estimate:
        """Place of the leading hypothesis, and the radius that holds both."""
        imu, alone = self._by_imu(dt_s), self._by_receiver(dt_s)
        imu = imu._replace(r95_m=self._radius_of_headings(imu.r95_m, dt_s))
        if alone is None:
            return imu
        here = LocalFrame.at(imu.lat_rad, imu.lon_rad)
        apart_m = math.hypot(*here.to_ne(alone.lat_rad, alone.lon_rad))
        is_silent = self._propagation.is_imu_silent
        weight = 0.0 if is_silent else self._fixes.comparison.odds.imu_weight
        leader, other, share = imu, alone, weight
        if not self._has_imu_lead:
            leader, other, share = alone, imu, 1.0 - weight
        r95 = radius_m(
            [(share, 0.0, leader.r95_m), (1.0 - share, apart_m, other.r95_m)]
        )
        return leader._replace(r95_m=min(r95, LARGEST_RADIUS_M))

    def _radius_of_headings(self, r95_m: float, dt_s: float) -> float:
        """Radius about the leading filter that holds all headings that are alive."""
        if not self._bank.has_headings:
            return r95_m
        main, *others = self._bank.filters
        weight, *weights = self._bank.weights
        t_ns = self._buffer.now_ns + round(dt_s * 1e9) + self._buffer.shift_ns
        after_s = (t_ns - main.nominal.t_ns) * 1e-9
        parts = [(weight, 0.0, r95_m)]
        for each, share in zip(others, weights, strict=True):
            apart = _position_after(each, after_s) - _position_after(main, after_s)
            cov = self._position_cov_m2(each, *each.nominal.v_n[:2], after_s)
            parts.append((share, math.hypot(*apart), r95_of(cov)))
        return min(radius_m(parts), LARGEST_RADIUS_M)

    def _by_receiver(self, dt_s: float) -> Estimate | None:
        """Estimate without an IMU; height and attitude are the filter's."""
        if not self._fixes.comparison.alone.is_running:
            return None
        eskf, at = self._eskf, self._alone_at(dt_s)
        alt_origin_m = self._fixes.alt_origin_m
        alt_m = None if alt_origin_m is None else alt_origin_m - eskf.nominal.p_n[2]
        r95 = R95_PER_SIGMA * math.sqrt(at.position_var_m2)
        v_n = (*at.v_ne_mps, eskf.nominal.v_n[2])
        return Estimate(at.lat_rad, at.lon_rad, alt_m, v_n, eskf.nominal.q_nb, r95)

    def _alone_at(self, dt_s: float) -> AloneEstimate:
        """State of the receiver's hypothesis `dt_s` after the last step."""
        after_s = dt_s + self._eskf.delay_s
        t_ns = self._buffer.now_ns + round(after_s * 1e9) + self._buffer.shift_ns
        return self._fixes.comparison.alone.estimate_at(
            t_ns, self._platform.unknown_accel_psd
        )

    def _by_imu(self, dt_s: float) -> Estimate:
        """Predict from the filter's instant to one after the last step."""
        eskf, alignment, fixes = self._eskf, self._alignment, self._fixes
        t_ns = self._buffer.now_ns + round(dt_s * 1e9) + self._buffer.shift_ns
        nominal = self._buffer.predict(eskf, t_ns, alignment.can_use_force)
        left_s = (t_ns - nominal.t_ns) * 1e-9 if nominal.t_ns else dt_s
        left_s += eskf.delay_s
        (north, east, down), (vn, ve, vd) = nominal.p_n, nominal.v_n
        north, east, down = north + vn * left_s, east + ve * left_s, down + vd * left_s
        if alignment.is_aligned and any(self._lever_arm_m):
            ln, le, ld = rotate(nominal.q_nb, self._lever_arm_m)
            north, east, down = north + ln, east + le, down + ld
        lat, lon = self._propagation.frame.to_lat_lon(north, east)
        alt = None if fixes.alt_origin_m is None else fixes.alt_origin_m - down
        total_s = (t_ns - eskf.nominal.t_ns) * 1e-9 + eskf.delay_s
        cov = self._position_cov_m2(eskf, vn, ve, total_s)
        r95 = max(r95_of(cov), fixes.ambiguity_m)
        return Estimate(
            lat, lon, alt, (vn, ve, vd), nominal.q_nb, min(r95, LARGEST_RADIUS_M)
        )

    def _position_cov_m2(
        self, eskf: Eskf, vn: float, ve: float, after_s: float
    ) -> Array:
        """Covariance of p + v delay, carried over the time since the filter's."""
        P = eskf.P
        H = np.zeros((2, N_ERRORS))
        H[:, POSITION] = np.eye(2, 3)
        H[:, VELOCITY] = after_s * np.eye(2, 3)
        if self._alignment.is_aligned:  # before, velocity itself follows the fixes
            H[:, DELAY] = (vn, ve)
        cov: Array = H @ P @ H.T + LONGER_SHARE * P[RECEIVER, RECEIVER]
        return cov

    def weights(self) -> dict[str, float]:
        """Hypotheses that are alive by their names, with their probabilities."""
        imu_weight, bank = self._fixes.comparison.odds.imu_weight, self._bank
        named = {"receiver_alone": 1.0 - imu_weight}
        names = [bank.main_name, *(rival.name for rival in bank.rivals)]
        for name, share in zip(names, bank.weights, strict=True):
            if share > 0.0:
                label = f"imu, {name}" if bank.has_headings and name else "imu"
                named[label] = named.get(label, 0.0) + imu_weight * share
        return named

    def speed(self) -> tuple[float, float]:
        """Horizontal speed in m/s and its standard deviation."""
        if not self._has_imu_lead:
            alone = self._alone_at(0.0)
            return math.hypot(*alone.v_ne_mps), math.sqrt(alone.velocity_var)
        vn, ve, _ = self._eskf.nominal.v_n
        return math.hypot(vn, ve), max(self._eskf.sigma(V_N), self._eskf.sigma(V_E))


def _position_after(eskf: Eskf, dt_s: float) -> Array:
    """North and east of a filter, carried on at its velocity."""
    (pn, pe, _), (vn, ve, _) = eskf.nominal.p_n, eskf.nominal.v_n
    return np.array([pn + vn * dt_s, pe + ve * dt_s])
