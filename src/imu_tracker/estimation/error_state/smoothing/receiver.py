"""The track by the receiver alone, smoothed: for when the IMU was out.

Constant velocity, as in `hypotheses/receiver_alone`, north and east alike, forward and
back. Source: Rauch, Tung, Striebel 1965, Maximum likelihood estimates of linear dynamic
systems, AIAA Journal 3(8).
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.estimation.error_state.hypotheses.receiver_alone import (
    SPEED_CORRELATION_S,
    UNKNOWN_DELAY_S,
    KeptFix,
)
from imu_tracker.estimation.error_state.states import Array
from imu_tracker.estimation.estimate import R95_PER_SIGMA
from imu_tracker.estimation.tuning import ANY_SPEED_MPS
from imu_tracker.geometry.geodesy import LocalFrame

WILD_NIS: Final = 14.0
"""A fix beyond (one in a thousand) is left out, unless the next ones agree."""

MOST_WILD: Final = 2


class AlonePlace(NamedTuple):
    """A place by the receiver alone."""

    lat_rad: float
    lon_rad: float
    v_ne_mps: tuple[float, float]
    r95_m: float


class _State(NamedTuple):
    x: Array  # position and velocity, north and east, shape (2, 2)
    P: Array  # shape (2, 2), of each axis


class AloneTrack:
    """Smoothed places between the fixes of a piece.

    Parameters
    ----------
    fixes : sequence of KeptFix
        With growing instants; others are left out.
    """

    def __init__(self, fixes: Sequence[KeptFix]) -> None:
        self._fixes: list[KeptFix] = []
        self._frame = LocalFrame.at(0.0, 0.0)
        self._states: list[_State] = []
        ahead: list[_State] = []
        n_wild = 0
        for fix in fixes:
            if self._fixes and fix.t_ns <= self._fixes[-1].t_ns:
                continue
            if not self._fixes:
                self._frame = LocalFrame.at(fix.lat_rad, fix.lon_rad)
                predicted = _State(
                    np.zeros((2, 2)),
                    np.diag([fix.position_var * 1e4, ANY_SPEED_MPS**2]),
                )
            else:
                dt_s = (fix.t_ns - self._fixes[-1].t_ns) * 1e-9
                predicted = _predicted(self._states[-1], dt_s, fix.accel_psd)
            found, nis = self._corrected(predicted, fix)
            if nis > WILD_NIS and n_wild < MOST_WILD:
                n_wild += 1
                continue
            n_wild = 0
            ahead.append(predicted)
            self._states.append(found)
            self._fixes.append(fix)
        self._times = [fix.t_ns for fix in self._fixes]
        self._smooth(ahead)

    def _corrected(self, state: _State, fix: KeptFix) -> tuple[_State, float]:
        x, P = state
        north, east = self._frame.to_ne(fix.lat_rad, fix.lon_rad)
        z = np.array([north, east]) - x[0]
        s = float(P[0, 0]) + fix.position_var
        nis = float(z @ z) / (s + fix.lasting_var)
        gain = P[:, 0] / s
        x, P = x + np.outer(gain, z), P - np.outer(gain, P[0])
        if fix.v_ne_mps is not None:
            gain = P[:, 1] / (float(P[1, 1]) + fix.velocity_var)
            x = x + np.outer(gain, np.array(fix.v_ne_mps) - x[1])
            P = P - np.outer(gain, P[1])
        return _State(x, 0.5 * (P + P.T)), nis

    def _smooth(self, ahead: list[_State]) -> None:
        """x_k += G (x_k+1 - x_k+1|k), G = P F' P_k+1|k^-1; P likewise."""
        for k in range(len(self._states) - 2, -1, -1):
            dt_s = (self._times[k + 1] - self._times[k]) * 1e-9
            self._states[k] = _smoothed(
                self._states[k], ahead[k + 1], self._states[k + 1], dt_s
            )

    def at(self, t_ns: int) -> AlonePlace | None:
        """Place at an instant of the filters' time; None: there was no fix at all."""
        if not self._fixes:
            return None
        i = bisect_right(self._times, t_ns)
        fix = self._fixes[max(i - 1, 0)]
        x, P = self._states[max(i - 1, 0)]
        dt_s = (t_ns - fix.t_ns) * 1e-9
        if i == 0:
            # Backwards in time the velocity, and its covariances, change their signs.
            mirror = np.diag([1.0, -1.0])
            mirrored = _State(mirror @ x, mirror @ P @ mirror)
            x, P = _predicted(mirrored, -dt_s, fix.accel_psd)
            x = mirror @ x
        elif i == len(self._fixes):
            x, P = _predicted(_State(x, P), dt_s, fix.accel_psd)
        else:
            x, P = self._bridged(i, dt_s)
        (north, east), (vn, ve) = x.tolist()
        late_var = 0.5 * (UNKNOWN_DELAY_S**2) * (vn * vn + ve * ve)
        var = float(P[0, 0]) + late_var + fix.lasting_var
        lat, lon = self._frame.to_lat_lon(north, east)
        return AlonePlace(lat, lon, (vn, ve), R95_PER_SIGMA * math.sqrt(max(var, 0.0)))

    def _bridged(self, i: int, dt_s: float) -> tuple[Array, Array]:
        """Between two fixes: the cubic between both, as far off as a bridge may be.

        Notes
        -----
        Both ends known, white acceleration of density q leaves amid a gap of length T
        the variance q (s (1 - s))^3 T^3 / 3, s in 0 to 1.
        """
        (x0, P0), (x1, P1) = self._states[i - 1], self._states[i]
        gap_s = (self._times[i] - self._times[i - 1]) * 1e-9
        s = dt_s / gap_s
        h01 = s * s * (3.0 - 2.0 * s)
        h10, h11 = gap_s * s * (1.0 - s) ** 2, gap_s * s * s * (s - 1.0)
        place = (1.0 - h01) * x0[0] + h01 * x1[0] + h10 * x0[1] + h11 * x1[1]
        speed = (1.0 - s) * x0[1] + s * x1[1]
        q = self._fixes[i].accel_psd
        bridge_var = q * (s * (1.0 - s) * gap_s) ** 3 / 3.0
        ends = np.array([1.0 - h01, h10]), np.array([h01, h11])
        ends_var = float(ends[0] @ P0 @ ends[0]) + float(ends[1] @ P1 @ ends[1])
        return np.array([place, speed]), np.diag([ends_var + bridge_var, P1[1, 1]])


def _predicted(state: _State, dt_s: float, accel_psd: float) -> _State:
    F, Q = _model(dt_s, accel_psd)
    return _State(F @ state.x, F @ state.P @ F.T + Q)


def _model(dt_s: float, accel_psd: float) -> tuple[Array, Array]:
    """Random walk of the velocity, that ends at what roads and lights allow."""
    tau = SPEED_CORRELATION_S
    once, twice = 1.0 - math.exp(-dt_s / tau), 1.0 - math.exp(-2.0 * dt_s / tau)
    q_pp = tau**2 * (dt_s - 2.0 * tau * once + 0.5 * tau * twice)
    q_pv, q_vv = 0.5 * (tau * once) ** 2, 0.5 * tau * twice
    F = np.array([[1.0, dt_s], [0.0, 1.0]])
    return F, accel_psd * np.array([[q_pp, q_pv], [q_pv, q_vv]])


def _smoothed(at: _State, ahead: _State, later: _State, dt_s: float) -> _State:
    F, _ = _model(dt_s, 0.0)
    G = np.linalg.solve(ahead.P, F @ at.P).T
    P = at.P + G @ (later.P - ahead.P) @ G.T
    return _State(at.x + G @ (later.x - ahead.x), 0.5 * (P + P.T))
