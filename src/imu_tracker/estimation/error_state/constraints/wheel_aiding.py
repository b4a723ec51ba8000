"""The wheels' speed as a measurement of forward velocity and of the circumference.

A window of vibration ends at the filter's own instant, so the measurement describes
that instant and not now. What a newcomer gets wrong: an error of the circumference is
the same for a whole outage and does not average out. So it is a state of the filter,
which GPS shrinks, and the way without GPS carries its uncertainty.
"""

import math
from collections.abc import Callable
from typing import Final, final

import numpy as np

from imu_tracker.estimation.error_state.constraints.schedule import OUTAGE_AFTER_S
from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.propagation import Propagation
from imu_tracker.estimation.error_state.receiver_model import soft_gated_1d
from imu_tracker.estimation.error_state.states import (
    N_ERRORS,
    VELOCITY,
    WHEEL_SCALE,
    WHEEL_SCALE_SIGMA,
)
from imu_tracker.estimation.report import WheelReport
from imu_tracker.samples import ImuSample
from imu_tracker.wheels.orders import KeptWheels
from imu_tracker.wheels.posterior import SpeedError
from imu_tracker.wheels.speed import KNOWN_SIGMA_MPS, LEAST_SPEED_MPS, WheelSpeed

CHANGED_SHARE: Final = 0.03
CHANGED_CLARITY: Final = 1.15
"""Another circumference that is so far off and so much clearer is the true one: other
tyres differ by 1 to 4 %."""

MOST_SIGMA: Final = 0.03
"""Of a circumference that is known at all: wheels that fit the same car."""

HEARD_SHARE: Final = 0.5
"""Wheels that speak for less of the way are faint."""


@final
class WheelAiding:
    """Learns the wheels of a vehicle, and corrects its speed by them."""

    def __init__(self, notify: Callable[[str], None]) -> None:
        self._notify = notify
        self._wheels = WheelSpeed()
        self._main: Eskf | None = None
        self._circumference_m: float | None = None  # the filters' scale is of this

    def add_sample(self, sample: ImuSample) -> None:
        """Take a calibrated sample at the IMU's own rate."""
        self._wheels.add_sample(sample)

    def update(self, filters: tuple[Eskf, ...], propagation: Propagation) -> None:
        """Follow the speed of the first filter, and correct all by the wheels."""
        if not propagation.is_predicted or not propagation.is_aligned:
            return
        if propagation.is_imu_silent:
            return
        main = filters[0]
        if main is not self._main:
            self._wheels.reset_evidence()  # of another filter's speed
            self._main = main
        speed_mps, sigma_mps = along(main)
        if not self._wheels.add_motion(main.nominal.t_ns, speed_mps, main.rate_n[2]):
            return
        has_gps = propagation.outage_s < OUTAGE_AFTER_S
        is_known = has_gps and sigma_mps < KNOWN_SIGMA_MPS
        if not is_known and self._circumference_m is None:
            return
        found = self._wheels.spectrum()
        if found is None:
            return
        if is_known:
            self._wheels.learn(found)
            self._follow(filters)
        if self._circumference_m is None:
            return
        H = forward(main)
        answer = self._wheels.weigh(
            found,
            self._circumference_m * (1.0 + main.wheel_scale),
            math.sqrt(max(float((H @ main.P @ H.T)[0, 0]), 0.0)),
        )
        if answer is not None:
            scale = main.wheel_scale
            for eskf in filters:
                correct(eskf, answer, speed_mps, scale, has_gps=has_gps)
            self._wheels.shift(along(main)[0] - speed_mps)

    def _follow(self, filters: tuple[Eskf, ...]) -> None:
        """Let the filters' circumference begin where the learnt one is."""
        wheels, before_m = self._wheels.wheels, self._circumference_m
        if wheels is None:
            self._circumference_m = None
            return
        if before_m is not None:
            now_m = before_m * (1.0 + filters[0].wheel_scale)
            is_off = abs(wheels.circumference_m / now_m - 1.0) > CHANGED_SHARE
            if not is_off or not self._wheels.is_clearer_than(now_m, CHANGED_CLARITY):
                return
        self._begin(filters, wheels.circumference_m)

    def load(self, kept: KeptWheels, filters: tuple[Eskf, ...]) -> None:
        """Begin with the wheels of an earlier run, doubts grown already."""
        self._wheels.load(kept)
        self._circumference_m = kept.circumference_m
        _begin_scale(filters, kept.circumference_sigma_m / kept.circumference_m)

    def learnt(self) -> KeptWheels | None:
        """What a next run can begin with."""
        wheels, reference_m = self._wheels.wheels, self._circumference_m
        main = self._main
        if wheels is None or main is None or reference_m is None:
            return None
        sigma = min(main.sigma(WHEEL_SCALE), MOST_SIGMA)  # a car that stood for weeks
        return KeptWheels(
            reference_m * (1.0 + main.wheel_scale),
            reference_m * sigma,
            tuple(wheels.strength.ravel().tolist()),
        )

    def _begin(self, filters: tuple[Eskf, ...], circumference_m: float) -> None:
        if self._circumference_m is None:
            self._notify(f"wheels found: {circumference_m:.2f} m round")
        else:
            self._notify(f"other wheels: {circumference_m:.2f} m round")
        self._circumference_m = circumference_m
        _begin_scale(filters, WHEEL_SCALE_SIGMA)
        self._wheels.reset_evidence()

    def report(self) -> WheelReport:
        """What was learnt, for people."""
        wheels, asked = self._wheels.wheels, self._wheels.asked_windows
        share = self._wheels.heard_windows / asked if asked else None
        main, reference_m = self._main, self._circumference_m
        if wheels is None or main is None or reference_m is None:
            return {
                "state": "not heard",
                "circumference_m": None,
                "circumference_sigma_m": None,
                "clarity": None,
                "heard_share": share,
            }
        is_faint = share is None or share < HEARD_SHARE
        return {
            "state": "faint" if is_faint else "heard",
            "circumference_m": reference_m * (1.0 + main.wheel_scale),
            "circumference_sigma_m": reference_m * main.sigma(WHEEL_SCALE),
            "clarity": wheels.clarity,
            "heard_share": share,
        }


def _begin_scale(filters: tuple[Eskf, ...], sigma: float) -> None:
    for eskf in filters:
        eskf.wheel_scale = 0.0
        eskf.set_variances(WHEEL_SCALE, sigma**2)


def along(eskf: Eskf) -> tuple[float, float]:
    """Horizontal speed, m/s, and its standard deviation."""
    vn, ve, _ = eskf.nominal.v_n
    speed_mps = math.hypot(vn, ve)
    if speed_mps <= 0.0:
        return 0.0, math.inf
    u = np.array([vn, ve]) / speed_mps
    P_vv = eskf.P[VELOCITY, VELOCITY][:2, :2]
    return speed_mps, math.sqrt(max(float(u @ P_vv @ u), 0.0))


def forward(eskf: Eskf) -> np.ndarray:
    """Row H of the wheels' speed less the filter's, shape (1, errors).

    Notes
    -----
    Wheels turn v / C times a second, and C = C_0 (1 + kappa) is believed. With the true
    v + dv and kappa + dkappa, what is believed to be their speed is v + dv - v dkappa:
    H = v' / |v| (velocity), -|v| (scale).
    """
    vn, ve, _ = eskf.nominal.v_n
    speed_mps = math.hypot(vn, ve)
    H = np.zeros((1, N_ERRORS))
    H[0, VELOCITY] = (vn / speed_mps, ve / speed_mps, 0.0)
    H[0, WHEEL_SCALE] = -speed_mps
    return H


def correct(
    eskf: Eskf,
    found: SpeedError,
    asked_mps: float,
    asked_scale: float,
    *,
    has_gps: bool,
) -> None:
    """Fold in what was found for a speed and a scale, softly gated.

    Softly, since a line can be taken for its neighbour's or for the engine's. For the
    same reason the speed is left to the receiver while there is one: its error counts
    as noise, and only the circumference is learnt.
    """
    speed_mps, sigma_mps = along(eskf)
    if speed_mps < 0.5 * LEAST_SPEED_MPS:
        return
    own_mps = (asked_mps + found.error_mps) * (1.0 + eskf.wheel_scale - asked_scale)
    H, var = forward(eskf), found.var
    if has_gps:
        H[0, VELOCITY] = 0.0
        var += sigma_mps**2
    measured = Measurement(np.array([own_mps - speed_mps]), H, np.array([[var]]))
    eskf.update(soft_gated_1d(measured, eskf.innovation_covariance(measured)))
