"""The filters through time: steps, growth of the errors, and what bodies cannot do."""

import math
from typing import Final

import numpy as np

from imu_tracker.estimation import vehicle
from imu_tracker.estimation.alignment import Alignment
from imu_tracker.estimation.carrier import Carrier
from imu_tracker.estimation.error_model import (
    ACCEL_BIAS,
    ATTITUDE,
    N_ERRORS,
    POSITION,
    RECEIVER,
    VELOCITY,
)
from imu_tracker.estimation.eskf import Eskf, Measurement, Nominal
from imu_tracker.estimation.geodesy import FRAME_RADIUS_M, LocalFrame, gravity_mps2
from imu_tracker.estimation.noise_bank import NoiseBank
from imu_tracker.estimation.preintegration import ImuStep
from imu_tracker.estimation.road import Road
from imu_tracker.estimation.rotation import matrix
from imu_tracker.estimation.standstill import Rest

STRETCH_S: Final = 0.1
"""Errors grow, and constraints are applied, in stretches of three steps: in 0.12 s a
car turns by 5 deg at most."""

DARK_AFTER_S: Final = 2.0
WEAK_PERIOD_S: Final = 1.0
LEVELLING_SIGMA_MPS2: Final = 3.0
"""Own acceleration of a body of which nothing is known, mean of a second."""

STEADY_MPS2: Final = 0.7
STEADY_SIGMA_MPS2: Final = 0.3
STEADY_LASTS_S: Final = 3.0
"""A body whose velocity changes by less is steady, so far as a second's fixes tell;
what is left of its own acceleration lasts. Who speeds up, or banks into a turn, does
not feel where down is."""

ANY_SPEED_VAR: Final = 20.0**2
ANY_HEIGHT_VAR: Final = 100.0**2

LOST_TURN_RADPS: Final = 0.1
UNKNOWN_ANGLE_VAR: Final = math.pi**2 / 3.0
"""In silence a body turns so fast; any angle at all has this variance."""


class Propagation:
    """Moves all filters on, side by side.

    Parameters
    ----------
    bank : NoiseBank
    alignment : Alignment
    carrier : Carrier

    Attributes
    ----------
    frame : LocalFrame
        Where the filters' positions are counted from; it goes along.
    rest : Rest or None
        At the end of the last step.
    dark_s : float
        Since the last fix that was used.
    own_accel_mps2 : float or None
        Change of the receiver's velocity, as long as that is fresh and there is one.
    """

    def __init__(self, bank: NoiseBank, alignment: Alignment, carrier: Carrier) -> None:
        self._bank, self._alignment, self._carrier = bank, alignment, carrier
        self._stretch_s = self._weak_s = 0.0
        self.frame = LocalFrame.at(0.0, 0.0)
        self.rest: Rest | None = None
        self.dark_s = 0.0
        self.own_accel_mps2: float | None = None
        self.road = Road()

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        self.frame = LocalFrame.at(lat_rad, lon_rad)
        for eskf in self._bank.filters:
            eskf.gravity_mps2 = gravity_mps2(lat_rad)
            eskf.predict(use_force=False)
            t_ns, _, _, q_nb = eskf.nominal
            eskf.nominal = Nominal(t_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), q_nb)
            eskf.set_variances(POSITION, [sigma_m**2, sigma_m**2, ANY_HEIGHT_VAR])
            eskf.set_variances(VELOCITY, [ANY_SPEED_VAR, ANY_SPEED_VAR, 1.0])
            eskf.receiver_ne_m = (0.0, 0.0)
            eskf.set_variances(RECEIVER, [eskf.receiver_var] * 2)
        self.dark_s = 0.0
        self._alignment.start()

    # ------------------------------------------------------------------------ steps

    def take(self, step: ImuStep, rest: Rest | None) -> None:
        """Take a step into the filters; `rest` when the body stands still."""
        alignment = self._alignment
        self.rest = rest
        if not alignment.is_level:
            alignment.level(step)
        use_force = alignment.can_use_force(rest)
        for eskf in self._bank.filters:
            eskf.propagate(step, use_force=use_force)
        if alignment.agnostic is not None:
            alignment.agnostic.propagate(step, use_force=rest is not None)
        self._stretch_s += step.dt_s
        if step.is_gap:
            sped_var = self._carrier.unknown_accel_psd * step.dt_s
            self._doubt(LOST_TURN_RADPS * step.dt_s, math.sqrt(sped_var))
        elif step.is_saturated:
            # A reading that was clipped may be off by as much as it says.
            self._doubt(math.hypot(*step.dtheta_b_rad), math.hypot(*step.dv_b_mps))
        if self._stretch_s >= STRETCH_S:
            self.predict()
            self._constrain(self._stretch_s)
            self._stretch_s = 0.0

    def predict(self) -> None:
        """Let the errors grow up to the end of the last step."""
        if self._stretch_s <= 0.0:
            return
        alignment, rest = self._alignment, self.rest
        alignment.observe_stretch()
        use_force = alignment.can_use_force(rest)
        unknown = 0.0 if use_force else self._carrier.unknown_accel_psd
        for eskf in self._bank.filters:
            eskf.predict(use_force=use_force, unknown_accel_psd=unknown)
        if alignment.agnostic is not None:
            rests = rest is not None
            unknown = 0.0 if rests else self._carrier.unknown_accel_psd
            alignment.agnostic.predict(use_force=rests, unknown_accel_psd=unknown)

    def _doubt(self, angle_rad: float, speed_mps: float) -> None:
        """Let the body have turned and sped up by so much more, in any direction."""
        agnostic = self._alignment.agnostic
        more = np.zeros(N_ERRORS)
        more[ATTITUDE], more[VELOCITY] = angle_rad**2, speed_mps**2
        for eskf in (*self._bank.filters, *([] if agnostic is None else [agnostic])):
            P = eskf.P + np.diag(more)
            # An angle has an end; its correlations shrink with it.
            scale = np.ones(N_ERRORS)
            scale[ATTITUDE] = np.sqrt(
                np.minimum(1.0, UNKNOWN_ANGLE_VAR / P.diagonal()[ATTITUDE])
            )
            eskf.P = P * np.outer(scale, scale)
        self._alignment.check_yaw()

    # ------------------------------------------------------------------ constraints

    def _constrain(self, period_s: float) -> None:
        """Apply what the body cannot do."""
        self.dark_s += period_s
        self._weak_s += period_s
        is_weak_due = self._weak_s >= WEAK_PERIOD_S
        if is_weak_due:
            self._weak_s = 0.0
            if math.hypot(*self._bank.main.nominal.p_n[:2]) > FRAME_RADIUS_M:
                self._move_frame()
        alignment, rest = self._alignment, self.rest
        if not alignment.is_level:
            return
        road = self.road
        if alignment.is_aligned and is_weak_due and self.dark_s < DARK_AFTER_S:
            road.observe(self._bank.main, WEAK_PERIOD_S)
        for eskf in self._bank.filters:
            if rest is not None:
                eskf.apply(vehicle.rest(eskf, rest, period_s))
            elif not alignment.is_aligned:
                if is_weak_due:
                    self._level(eskf)
            elif self._carrier.is_vehicle:
                eskf.apply(vehicle.no_side_slip(eskf, period_s))
                if is_weak_due and self.dark_s > DARK_AFTER_S:
                    slope, haste = road.slope_sigma_rad, road.forward_sigma_mps2
                    eskf.apply(vehicle.level_road(eskf, slope, WEAK_PERIOD_S))
                    eskf.apply(vehicle.unhurried(eskf, haste, WEAK_PERIOD_S))
        if alignment.agnostic is not None:
            if rest is not None:
                alignment.agnostic.apply(
                    vehicle.rest(alignment.agnostic, rest, period_s)
                )
            elif is_weak_due:
                self._level(alignment.agnostic)

    def _level(self, eskf: Eskf) -> None:
        """Take the mean force for gravity, as far as the body is steady."""
        own_mps2 = self.own_accel_mps2
        if own_mps2 is None or self.dark_s > DARK_AFTER_S:
            eskf.apply(gravity_is_down(eskf, LEVELLING_SIGMA_MPS2**2))
        elif own_mps2 < STEADY_MPS2:
            variance = STEADY_SIGMA_MPS2**2 + own_mps2**2
            eskf.apply(gravity_is_down(eskf, STEADY_LASTS_S * variance))

    def _move_frame(self) -> None:
        """Take the origin along when the way from it grows."""
        north, east, _ = self._bank.main.nominal.p_n
        lat, lon = self.frame.to_lat_lon(north, east)
        self.frame = LocalFrame.at(lat, lon)
        agnostic = self._alignment.agnostic
        self._alignment.moved(north, east)
        for eskf in self._bank.filters:
            _shift(eskf, -north, -east)
            eskf.gravity_mps2 = gravity_mps2(lat)
        if agnostic is not None:
            _shift(agnostic, -north, -east)


def gravity_is_down(eskf: Eskf, variance: float) -> Measurement:
    """Of a body of which nothing is known, the mean force is gravity.

    Notes
    -----
    0 = a_n, level axes: z = -f_n, H = [f_n x] theta's level part - C_nb db_a.
    """
    fn, fe, fd = (eskf.a_n[0], eskf.a_n[1], eskf.a_n[2] - eskf.gravity_mps2)
    H = np.zeros((2, N_ERRORS))
    H[0, 7], H[1, 6] = fd, -fd
    H[:, ACCEL_BIAS] = -matrix(eskf.nominal.q_nb)[:2]
    return Measurement(np.array([-fn, -fe]), H, np.eye(2) * variance)


def _shift(eskf: Eskf, north_m: float, east_m: float) -> None:
    pn, pe, pd = eskf.nominal.p_n
    eskf.nominal = eskf.nominal._replace(p_n=(pn + north_m, pe + east_m, pd))
