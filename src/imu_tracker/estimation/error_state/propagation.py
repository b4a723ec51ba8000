"""The filters through time: steps, growth of their errors, and silence of the IMU."""

import math
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.constraints.schedule import MotionConstraints
from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.hypotheses.alignment import Alignment
from imu_tracker.estimation.error_state.hypotheses.noise_bank import NoiseBank
from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.states import (
    ATTITUDE,
    N_ERRORS,
    POSITION,
    RECEIVER,
    VELOCITY,
)
from imu_tracker.estimation.tuning import (
    ANY_HEIGHT_VAR,
    ANY_SPEED_MPS,
    SILENT_SLOPE_RAD,
    SILENT_TURN_CORRELATION_S,
    UNKNOWN_ANGLE_VAR,
    UNOBSERVED_TURN_RADPS,
)
from imu_tracker.geometry.geodesy import FRAME_RADIUS_M, LocalFrame, gravity_mps2
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest

STRETCH_S: Final = 0.1
"""Errors grow, and constraints are applied, in stretches of three steps: in 0.12 s a
car turns by 5 deg at most."""

ANY_SPEED_VAR: Final = ANY_SPEED_MPS**2


class Propagation:
    """Moves all filters on, side by side.

    Parameters
    ----------
    bank : NoiseBank
    alignment : Alignment
    platform : Platform

    Attributes
    ----------
    frame : LocalFrame
        Where the filters' positions are counted from; it goes along.
    rest : Rest or None
        At the end of the last step.
    outage_s : float
        Since the last fix that was used.
    """

    def __init__(
        self, bank: NoiseBank, alignment: Alignment, platform: Platform
    ) -> None:
        self._bank, self._alignment, self._platform = bank, alignment, platform
        self._constraints = MotionConstraints(bank, alignment, platform)
        self._stretch_s = self._silent_s = 0.0
        self.frame = LocalFrame.at(0.0, 0.0)
        self.rest: Rest | None = None
        self.outage_s = 0.0

    @property
    def is_predicted(self) -> bool:
        """Whether the covariance is that of the last step's end."""
        return self._stretch_s == 0.0

    @property
    def is_imu_silent(self) -> bool:
        """Whether the IMU has delivered nothing for seconds."""
        return self._silent_s > SILENT_TURN_CORRELATION_S

    @property
    def constraints(self) -> MotionConstraints:
        """What the body is known to do."""
        return self._constraints

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        place_ne = self.frame.to_ne(lat_rad, lon_rad)
        self.frame = LocalFrame.at(lat_rad, lon_rad)
        for eskf in self._bank.filters:
            eskf.gravity_mps2 = gravity_mps2(lat_rad)
            eskf.predict(use_force=False)
            eskf.note_loss(place_ne, sigma_m)
            t_ns, _, _, q_nb = eskf.nominal
            eskf.nominal = Nominal(t_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), q_nb)
            eskf.set_variances(POSITION, [sigma_m**2, sigma_m**2, ANY_HEIGHT_VAR])
            eskf.set_variances(VELOCITY, [ANY_SPEED_VAR, ANY_SPEED_VAR, 1.0])
            eskf.receiver_ne_m = (0.0, 0.0)
            eskf.set_variances(RECEIVER, [eskf.receiver_var] * 2)
        self.outage_s = 0.0
        self._alignment.start()

    # ------------------------------------------------------------------------ steps

    def add_step(self, step: ImuStep, rest: Rest | None) -> None:
        """Take a step into the filters; `rest` when the body stands still."""
        alignment = self._alignment
        self.rest = rest
        self._platform.step_detector.add_step(step)
        if not alignment.is_level:
            alignment.add_levelling_step(step)
        use_force = alignment.can_use_force(rest)
        for eskf in self._bank.filters:
            eskf.propagate(step, use_force=use_force)
        self._stretch_s += step.dt_s
        self._silent_s = self._silent_s + step.dt_s if step.is_gap else 0.0
        if step.is_gap:
            self._inflate_over_imu_gap(step.dt_s)
        elif step.is_saturated:
            # The error of a clipped reading may be as large as the reading.
            turned_var = sum(x * x for x in step.dtheta_b_rad)
            self._inflate(turned_var, sum(x * x for x in step.dv_b_mps))
        if self._stretch_s >= STRETCH_S:
            self.predict()
            self.outage_s += self._stretch_s
            if not step.is_gap:
                self._constraints.apply(rest, self._stretch_s, self.outage_s)
            if math.hypot(*self._bank.main.nominal.p_n[:2]) > FRAME_RADIUS_M:
                self._move_frame()
            self._stretch_s = 0.0

    def predict(self) -> None:
        """Let the errors grow up to the end of the last step."""
        if self._stretch_s <= 0.0:
            return
        alignment, rest = self._alignment, self.rest
        alignment.add_stretch()
        _, stretch_s = self._bank.main.stretch
        use_force = alignment.can_use_force(rest)
        unknown = 0.0 if use_force else self._platform.unknown_accel_psd
        for eskf in self._bank.filters:
            eskf.predict(use_force=use_force, unknown_accel_psd=unknown)
        self._platform.turned_rad += self._bank.main.rate_n[2] * stretch_s

    def _inflate_over_imu_gap(self, dt_s: float) -> None:
        """Grow attitude and velocity covariance over an IMU gap.

        Notes
        -----
        A rate that lasts: the angle's variance is (r t)^2 at first, and grows by
        2 r^2 T a second once t > T. Without the forces `predict` has let it speed up.
        """
        platform = self._platform
        lasted_s = min(self._silent_s, SILENT_TURN_CORRELATION_S)
        turned_var = 2.0 * UNOBSERVED_TURN_RADPS**2 * lasted_s * dt_s
        needs_inflation = self._alignment.can_use_force(None)
        sped_var = platform.unknown_accel_psd * dt_s if needs_inflation else 0.0
        if self._silent_s > SILENT_TURN_CORRELATION_S:
            self._constraints.reset_gait()
        most = SILENT_SLOPE_RAD**2 if platform.is_vehicle else UNKNOWN_ANGLE_VAR
        self._inflate(turned_var, sped_var, most)

    def _inflate(
        self,
        angle_var: float,
        speed_var: float,
        most_tilt_var: float = UNKNOWN_ANGLE_VAR,
    ) -> None:
        """Let the body have turned and sped up by so much more, in any direction."""
        more = np.zeros(N_ERRORS)
        more[ATTITUDE], more[VELOCITY] = angle_var, speed_var
        most = np.array([most_tilt_var, most_tilt_var, UNKNOWN_ANGLE_VAR])
        for eskf in self._bank.filters:
            before = eskf.P.diagonal()[ATTITUDE]
            P = eskf.P + np.diag(more)
            # An angle has an end; its correlations shrink with it.
            ends = np.maximum(most, before)
            scale = np.ones(N_ERRORS)
            scale[ATTITUDE] = np.sqrt(np.minimum(1.0, ends / P.diagonal()[ATTITUDE]))
            eskf.P = P * np.outer(scale, scale)
            if scale.min() < 1.0:
                eskf.note_change(np.diag(scale))
        self._alignment.check_orientation()

    def _move_frame(self) -> None:
        """Take the origin along when the way from it grows."""
        north, east, _ = self._bank.main.nominal.p_n
        lat, lon = self.frame.to_lat_lon(north, east)
        self.frame = LocalFrame.at(lat, lon)
        self._alignment.shift_origin(north, east)
        for eskf in self._bank.filters:
            _shift(eskf, -north, -east)
            eskf.gravity_mps2 = gravity_mps2(lat)


def _shift(eskf: Eskf, north_m: float, east_m: float) -> None:
    pn, pe, pd = eskf.nominal.p_n
    eskf.nominal = eskf.nominal._replace(p_n=(pn + north_m, pe + east_m, pd))
