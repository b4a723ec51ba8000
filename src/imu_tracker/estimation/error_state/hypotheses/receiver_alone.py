"""The hypothesis without an IMU: constant velocity, from the receiver's fixes alone.

Position and velocity, one covariance for north and east. It is alive as long as there
are fixes, so that the tracker is never worse than its receiver.

Easily got wrong: the receiver's lasting error is no state here. Doppler velocities
would average it away over some minutes, and the radius with it, but nothing that this
filter measures tells it apart from a position.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.estimation.error_state.states import Array
from imu_tracker.estimation.receiver.gate import NIS_LIMIT
from imu_tracker.estimation.tuning import ANY_SPEED_MPS, PAUSE_S
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import GpsFix

UNKNOWN_DELAY_S: Final = 0.3
"""Standard deviation of a receiver's delay that no IMU has measured."""


RESTART_FIXES: Final = 3
"""After so many outliers in a row it starts again from the last of them."""

SETTLING_NS: Final = 3_000_000_000
"""Until then after a start its predictions are not compared."""

SPEED_CORRELATION_S: Final = 30.0
"""Correlation time of the velocity's deviation: roads turn and lights change, so that
it does not grow without a limit."""


class FixNoise(NamedTuple):
    """What is new with each fix, per axis; the same for every hypothesis.

    Attributes
    ----------
    position_var, velocity_var : float, m^2 and (m/s)^2
    lasting_var : float, m^2
        Error that the next fixes share.
    late_var : float, (m/s)^2
        Of velocities that a receiver smooths and so reports late; added for every
        hypothesis alike.
    """

    position_var: float
    velocity_var: float
    lasting_var: float
    late_var: float = 0.0


class KeptFix(NamedTuple):
    """A fix as the hypothesis without an IMU takes it.

    Attributes
    ----------
    t_ns : int
        Instant that it describes, on the filters' time scale.
    lat_rad, lon_rad : float
    v_ne_mps : (float, float) or None
    position_var, velocity_var, lasting_var : float, m^2 and (m/s)^2, per axis
    accel_psd : float, (m/s^2)^2/Hz
        Of the body's own acceleration.
    """

    t_ns: int
    lat_rad: float
    lon_rad: float
    v_ne_mps: tuple[float, float] | None
    position_var: float
    velocity_var: float
    lasting_var: float
    accel_psd: float


class AloneEstimate(NamedTuple):
    """Position and velocity of the antenna, with variances per axis."""

    lat_rad: float
    lon_rad: float
    v_ne_mps: tuple[float, float]
    position_var_m2: float
    velocity_var: float


class ReceiverAlone:
    """Position and velocity by the fixes alone.

    Parameters
    ----------
    max_speed_mps : float
        What a platform of this profile can do.

    Notes
    -----
    p' = p + v dt, z = (p, v) + noise. Between fixes v deviates by an Ornstein-Uhlenbeck
    process, driven by white acceleration of density q: over seconds a random walk.
    """

    def __init__(self, max_speed_mps: float) -> None:
        self.max_speed_mps = max_speed_mps
        self._t_ns: int | None = None
        self._started_ns = 0
        self._place = (0.0, 0.0)  # latitude and longitude, rad
        self._v_ne = np.zeros(2)
        self._P: Array = np.eye(2)
        self._lasting_var = 0.0
        self._n_wild = 0

    @property
    def is_running(self) -> bool:
        """Whether there was a fix at all."""
        return self._t_ns is not None

    @property
    def is_settled(self) -> bool:
        """Whether its prediction can be compared with another hypothesis'."""
        return self._t_ns is not None and self._t_ns - self._started_ns > SETTLING_NS

    def start(self, fix: GpsFix, t_ns: int, noise: FixNoise) -> None:
        """Start at a fix that describes the instant `t_ns`."""
        self._t_ns = self._started_ns = t_ns
        self._place = (fix.lat_rad, fix.lon_rad)
        self._v_ne = np.array(fix.vel_ne_mps or (0.0, 0.0))
        speed_var = noise.velocity_var if fix.vel_ne_mps else ANY_SPEED_MPS**2
        self._P = np.diag([noise.position_var, speed_var])
        self._lasting_var = noise.lasting_var
        self._n_wild = 0

    def update(
        self, fix: GpsFix, t_ns: int, noise: FixNoise, accel_psd: float
    ) -> float | None:
        """Update with a fix that describes the instant `t_ns`.

        Returns
        -------
        float or None
            Log-likelihood of its position and velocity; None: an outlier, or there was
            no prediction.
        """
        if self._t_ns is None or not 0 <= t_ns - self._t_ns < PAUSE_S * 1e9:
            self.start(fix, t_ns, noise)
            return None
        dt_s = (t_ns - self._t_ns) * 1e-9
        P = self._grown(dt_s, accel_psd)
        here = LocalFrame.at(*self._place)
        place_ne = self._v_ne * dt_s
        z = np.array(here.to_ne(fix.lat_rad, fix.lon_rad)) - place_ne
        s = float(P[0, 0]) + noise.position_var
        nis = float(z @ z) / s
        if nis > NIS_LIMIT:
            self._n_wild += 1
            if self._n_wild >= RESTART_FIXES:
                self.start(fix, t_ns, noise)
            return None
        self._n_wild = 0
        likelihood = -0.5 * nis - math.log(2.0 * math.pi * s)
        place_ne, v_ne, P = _corrected(place_ne, self._v_ne, P, 0, z, s)
        if fix.vel_ne_mps is not None:
            z = np.array(fix.vel_ne_mps) - v_ne
            s = float(P[1, 1]) + noise.velocity_var
            late = s + noise.late_var
            nis = float(z @ z) / late
            likelihood -= 0.5 * nis + math.log(2.0 * math.pi * late)
            place_ne, v_ne, P = _corrected(place_ne, v_ne, P, 1, z, s)
        self._t_ns, self._P, self._v_ne = t_ns, P, v_ne
        self._place = here.to_lat_lon(*place_ne.tolist())
        self._lasting_var = noise.lasting_var
        return likelihood

    def estimate_at(self, t_ns: int, accel_psd: float) -> AloneEstimate:
        """Predict to an instant, bounded by the speed that the profile allows."""
        assert self._t_ns is not None
        dt_s = (t_ns - self._t_ns) * 1e-9
        P = self._grown(max(dt_s, 0.0), accel_psd)
        vn, ve = self._v_ne.tolist()
        lat, lon = LocalFrame.at(*self._place).to_lat_lon(vn * dt_s, ve * dt_s)
        most_var = 0.5 * (self.max_speed_mps**2)
        velocity_var = min(float(P[1, 1]), most_var)
        reach_var = float(self._P[0, 0]) + most_var * dt_s**2
        late_var = 0.5 * (UNKNOWN_DELAY_S**2) * (vn * vn + ve * ve)
        position_var = min(float(P[0, 0]), reach_var) + late_var + self._lasting_var
        return AloneEstimate(lat, lon, (vn, ve), position_var, velocity_var)

    def _grown(self, dt_s: float, accel_psd: float) -> Array:
        F = np.array([[1.0, dt_s], [0.0, 1.0]])
        tau = SPEED_CORRELATION_S
        once, twice = 1.0 - math.exp(-dt_s / tau), 1.0 - math.exp(-2.0 * dt_s / tau)
        q_pp = tau**2 * (dt_s - 2.0 * tau * once + 0.5 * tau * twice)
        q_pv, q_vv = 0.5 * (tau * once) ** 2, 0.5 * tau * twice
        Q = np.array([[q_pp, q_pv], [q_pv, q_vv]])
        grown: Array = F @ self._P @ F.T + accel_psd * Q
        return grown


def _corrected(
    place_ne: Array, v_ne: Array, P: Array, row: int, z: Array, s: float
) -> tuple[Array, Array, Array]:
    """Update with an innovation of position (row 0) or velocity (1), Joseph form."""
    gain = P[:, row] / s
    kept = np.eye(2)
    kept[:, row] -= gain
    noise_var = s - P[row, row]
    P = kept @ P @ kept.T + noise_var * np.outer(gain, gain)
    return place_ne + gain[0] * z, v_ne + gain[1] * z, P
