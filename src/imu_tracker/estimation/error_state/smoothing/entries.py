"""What happened to one filter, newest first, each entry with its way back.

The entries of a filter are a chain: a copy of the filter shares all that was before,
and what only a hypothesis that lost has seen is dropped with it. So the chain of the
filter that leads at the end is the history of the hypotheses that were right.

Each entry knows how the adjoint (l, L) of the errors passes it backwards. The fact that
a newcomer gets wrong: process noise needs no entry. The errors of an estimate with
covariance P are, in the light of all that came later, -P l, with covariance P - P L P.

Source: Bierman 1973, Fixed interval smoothing with discrete measurements, Int. J.
Control 18 (modified Bryson-Frazier form). It inverts no covariance, so that errors
which are known to be zero do no harm; and as its innovations are those of the filter,
a filter that puts its errors into the solution at once needs nothing more.
"""

import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from imu_tracker.estimation.error_state.states import (
    DELAY,
    N_ERRORS,
    RECEIVER,
    Array,
    Scene,
    transition,
)
from imu_tracker.samples import Quat, Vec3

SEEN: Final = (*range(9), *range(RECEIVER.start, RECEIVER.stop), DELAY)
"""Errors that rows are made of: position, velocity, attitude, the receiver's lasting
error, the delay of its positions."""
SEEN_RECEIVER: Final = slice(9, 11)
SEEN_DELAY: Final = 11
"""Where these stand among them; position, velocity and attitude keep their places."""


class Adjoint(NamedTuple):
    """What all that came later says of the errors.

    Attributes
    ----------
    vector : ndarray, shape (31,)
        l: the smoothed errors are -P l.
    matrix : ndarray, shape (31, 31)
        L: their covariance is P - P L P.
    """

    vector: Array
    matrix: Array


def nothing_later() -> Adjoint:
    """Return the adjoint at the newest entry."""
    return Adjoint(np.zeros(N_ERRORS), np.zeros((N_ERRORS, N_ERRORS)))


class Stretch:
    """A prediction: what its transition matrix is made from."""

    __slots__ = ("_dt_s", "_dv_n", "_q_nb", "_turn_n", "_use_force", "before")

    def __init__(
        self,
        before: "Entry | None",
        q_nb: Quat,
        dt_s: float,
        dv_n: Vec3,
        turn_n_rad: Vec3,
        *,
        use_force: bool,
    ) -> None:
        self.before = before
        self._q_nb, self._dt_s, self._dv_n = q_nb, dt_s, dv_n
        self._turn_n, self._use_force = turn_n_rad, use_force

    def back(self, later: Adjoint) -> Adjoint:
        """Return l' = F' l, L' = F' L F."""
        F = transition(self._q_nb, self._dt_s, self._dv_n, self._turn_n)
        if not self._use_force:
            F[0:6, 6:15] = 0.0
        return Adjoint(F.T @ later.vector, F.T @ later.matrix @ F)


class Correction:
    """A measurement that was folded in.

    Attributes
    ----------
    z : ndarray, shape (m,)
        The innovation.
    H : ndarray, shape (m, 31)
    S_inv : ndarray, shape (m, m)
        Inverse of its covariance.
    """

    __slots__ = ("H", "S_inv", "_K", "before", "z")

    def __init__(
        self, before: "Entry | None", P: Array, z: Array, H: Array, R: Array
    ) -> None:
        self.before = before
        PHT = P @ H.T
        self.S_inv = np.linalg.inv(H @ PHT + R)
        self._K = PHT @ self.S_inv
        self.z, self.H = z, H

    def back(self, later: Adjoint) -> Adjoint:
        """Return l' = l - H' (K' l + S^-1 z), and for L' Joseph's form.

        Notes
        -----
        L' = (I - K H)' L (I - K H) + H' S^-1 H.
        """
        H, K, S_inv = self.H, self._K, self.S_inv
        vector = later.vector - H.T @ (K.T @ later.vector + S_inv @ self.z)
        LK = later.matrix @ K
        half = (LK - 0.5 * (H.T @ (K.T @ LK + S_inv))) @ H
        return Adjoint(vector, later.matrix - half - half.T)


class Loss(Correction):
    """A fix that showed that the filter was lost, and at which it began anew.

    Attributes
    ----------
    widening : float
        By how much errors were larger than the filter took them to be.
    """

    __slots__ = ("widening",)

    def __init__(
        self, before: "Entry | None", P: Array, z: Array, H: Array, R: Array
    ) -> None:
        super().__init__(before, P, z, H, R)
        nis = float(z @ self.S_inv @ z)
        self.widening = math.sqrt(max(nis / len(z), 1.0))


class Change:
    """The errors were transformed, e' = T e, or grown by what nobody measured."""

    __slots__ = ("_T", "before")

    def __init__(self, before: "Entry | None", T: Array) -> None:
        self.before, self._T = before, T

    def back(self, later: Adjoint) -> Adjoint:
        """Return l' = T' l, L' = T' L T."""
        return Adjoint(self._T.T @ later.vector, self._T.T @ later.matrix @ self._T)


class Forgetting:
    """Some errors were begun anew: what comes later says nothing of the old ones."""

    __slots__ = ("_where", "before")

    def __init__(self, before: "Entry | None", where: slice) -> None:
        self.before, self._where = before, where

    def back(self, later: Adjoint) -> Adjoint:
        """Rows and columns of what was forgotten become zero."""
        vector, matrix = later.vector.copy(), later.matrix.copy()
        vector[self._where] = 0.0
        matrix[self._where, :] = 0.0
        matrix[:, self._where] = 0.0
        return Adjoint(vector, matrix)


class Mark:
    """The solution at an instant, and the rows of P that tell its errors.

    Attributes
    ----------
    t_ns : int
    p_n, v_n : Vec3
    q_nb : Quat
    delay_s : float
    rows : ndarray, shape (12, 31)
        P, the rows of `SEEN`.
    scene : Scene
    """

    __slots__ = ("before", "delay_s", "p_n", "q_nb", "rows", "scene", "t_ns", "v_n")

    def __init__(
        self,
        before: "Entry | None",
        nominal: tuple[int, Vec3, Vec3, Quat],
        delay_s: float,
        P: Array,
        scene: Scene,
    ) -> None:
        self.before = before
        self.t_ns, self.p_n, self.v_n, self.q_nb = nominal
        self.delay_s, self.scene = delay_s, scene
        self.rows = P[SEEN, :]

    def back(self, later: Adjoint) -> Adjoint:
        """Nothing happened."""
        return later

    def errors(self, later: Adjoint) -> tuple[Array, Array]:
        """Errors of `SEEN` in the light of what came later, and their covariance."""
        rows = self.rows
        cov = rows[:, SEEN] - rows @ later.matrix @ rows.T
        return -rows @ later.vector, 0.5 * (cov + cov.T)


Entry: TypeAlias = Stretch | Correction | Loss | Change | Forgetting | Mark
