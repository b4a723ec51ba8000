"""What a filter says of itself to its history, if it is asked to keep one."""

from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.estimation.error_state.smoothing.entries import (
    Change,
    Correction,
    Entry,
    Forgetting,
    Loss,
    Stretch,
)
from imu_tracker.estimation.error_state.states import N_ERRORS, Array
from imu_tracker.samples import Quat, Vec3

LATE_S: Final = 0.3
"""A fix at which a filter begins anew describes a place some tenths of a second ago."""


class Kept:
    """A filter whose past can be kept for a smoother.

    Attributes
    ----------
    nominal : Nominal
    P : ndarray, shape (31, 31)
        The filter's solution and its covariance.
    keeps_history : bool
    past : Entry or None
        The newest entry.
    """

    nominal: Nominal
    P: Array
    keeps_history: bool = False
    past: Entry | None = None

    def transform(self, T: Array) -> None:
        """Let the errors e become T e."""
        self.P = T @ self.P @ T.T
        self.note_change(T)

    def note_prediction(
        self, q_nb: Quat, dt_s: float, dv_n: Vec3, turn_n_rad: Vec3, *, use_force: bool
    ) -> None:
        """Keep what the transition matrix was made from."""
        if self.keeps_history:
            self.past = Stretch(
                *(self.past, q_nb, dt_s, dv_n, turn_n_rad), use_force=use_force
            )

    def note_correction(self, P: Array, z: Array, H: Array, R: Array) -> None:
        """Keep a measurement, and the covariance before it."""
        if self.keeps_history:
            self.past = Correction(self.past, P, z, H, R)

    def note_loss(self, place_ne_m: tuple[float, float], sigma_m: float) -> None:
        """Keep how far off it was, before it begins anew at a place of the receiver."""
        if self.keeps_history:
            (pn, pe, _), (vn, ve, _) = self.nominal.p_n, self.nominal.v_n
            z = np.array([place_ne_m[0] - pn, place_ne_m[1] - pe])
            late_var = LATE_S**2 * (vn * vn + ve * ve)
            R = np.eye(2) * (sigma_m**2 + late_var)
            self.past = Loss(self.past, self.P, z, np.eye(2, N_ERRORS), R)

    def note_reset(self, where: slice) -> None:
        """Keep that some errors were begun anew."""
        if self.keeps_history:
            self.past = Forgetting(self.past, where)

    def note_change(self, T: Array) -> None:
        """Keep that the errors e became T e."""
        if self.keeps_history:
            self.past = Change(self.past, T)

    def note_scaling(self, where: slice, factor: float) -> None:
        """Keep that some errors were made smaller."""
        if self.keeps_history:
            scale = np.ones(N_ERRORS)
            scale[where] = factor
            self.past = Change(self.past, np.diag(scale))
