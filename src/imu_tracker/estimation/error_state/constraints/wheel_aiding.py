"""The wheels' speed as a measurement: forward velocity in an outage.

The window of vibration ends at the filter's own instant, so the measurement describes
that instant and not now. With GPS the wheels are only learnt.
"""

import math

import numpy as np

from imu_tracker.estimation.error_state.constraints.schedule import OUTAGE_AFTER_S
from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.propagation import Propagation
from imu_tracker.estimation.error_state.receiver_model import soft_gated_1d
from imu_tracker.estimation.error_state.states import N_ERRORS, VELOCITY
from imu_tracker.estimation.report import WheelReport
from imu_tracker.samples import ImuSample
from imu_tracker.wheels.speed import LEAST_SPEED_MPS, SpeedError, WheelSpeed


class WheelAiding:
    """Learns the wheels of a vehicle, and corrects its speed in outages."""

    def __init__(self) -> None:
        self._wheels = WheelSpeed()
        self._main: Eskf | None = None

    def add_sample(self, sample: ImuSample) -> None:
        """Take a calibrated sample at the IMU's own rate."""
        self._wheels.add_sample(sample)

    def update(self, filters: tuple[Eskf, ...], propagation: Propagation) -> None:
        """Follow the speed of the first filter; correct all by the wheels' speed."""
        if not propagation.is_predicted or propagation.is_imu_silent:
            return
        main = filters[0]
        if main is not self._main:
            self._wheels.reset_evidence()  # of another filter's speed
            self._main = main
        speed_mps, sigma_mps = along(main)
        found = self._wheels.add_speed(
            main.nominal.t_ns,
            speed_mps,
            sigma_mps,
            has_gps=propagation.outage_s < OUTAGE_AFTER_S,
        )
        if found is not None:
            for eskf in filters:
                own_mps, _ = along(eskf)
                if own_mps > 0.5 * LEAST_SPEED_MPS:
                    eskf.update(forward(eskf, found, speed_mps - own_mps))

    def report(self) -> WheelReport:
        """What was learnt, for people."""
        wheels = self._wheels.wheels
        asked = self._wheels.asked_windows
        share = self._wheels.heard_windows / asked if asked else None
        return {
            "circumference_m": None if wheels is None else wheels.circumference_m,
            "clarity": None if wheels is None else wheels.clarity,
            "heard_share": share,
        }


def along(eskf: Eskf) -> tuple[float, float]:
    """Horizontal speed, m/s, and its standard deviation."""
    vn, ve, _ = eskf.nominal.v_n
    speed_mps = math.hypot(vn, ve)
    if speed_mps <= 0.0:
        return 0.0, math.inf
    u = np.array([vn, ve]) / speed_mps
    P_vv = eskf.P[VELOCITY, VELOCITY][:2, :2]
    return speed_mps, math.sqrt(max(float(u @ P_vv @ u), 0.0))


def forward(eskf: Eskf, found: SpeedError, lag_mps: float) -> Measurement:
    """Speed along the track; `lag_mps` is how much slower than the one asked it is.

    Notes
    -----
    z = error, H = v / |v| at the velocity; softly gated, since a line can be taken for
    its neighbour's or the engine's.
    """
    vn, ve, _ = eskf.nominal.v_n
    speed_mps = math.hypot(vn, ve)
    H = np.zeros((1, N_ERRORS))
    H[0, VELOCITY] = (vn / speed_mps, ve / speed_mps, 0.0)
    z = np.array([found.error_mps + lag_mps])
    measured = Measurement(z, H, np.array([[found.var]]))
    return soft_gated_1d(measured, eskf.innovation_covariance(measured))
