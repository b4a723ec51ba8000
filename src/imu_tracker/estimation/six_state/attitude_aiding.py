"""What keeps the attitude filter true: rest, the receiver's velocity, the course.

The attitude filter applies the corrections; this module makes the measurements of tilt
and yaw, and decides when they are valid.
"""

import math
from typing import Final, NamedTuple

from imu_tracker.estimation.six_state.attitude import AttitudeFilter
from imu_tracker.estimation.tuning import (
    COURSE_CORRELATION_S,
    COURSE_DELAY_SIGMA_S,
    COURSE_MAX_RATE_RADPS,
    COURSE_SPEED_MPS,
    DISTRUST_SHARE,
    GRAVITY_WINDOW_MPS2,
    LEVELLING_S,
    LEVELLING_SIGMA_MPS2,
    LEVELLING_SIGMA_RAD,
    MAX_DISTRUST,
    REST_RATE_SIGMA_RADPS,
    REVERSE_FIXES,
    REVERSE_MPS,
    SIX_COURSE_SIGMA_RAD,
    SIX_REVERSE_RAD,
    VELOCITY_BASE_S,
    VELOCITY_MODEL_MPS2,
    VELOCITY_MODEL_SHARE,
)
from imu_tracker.geometry.rotation import rotate, wrap_pi
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import Vec3

REST_LEVEL_SIGMA_MPS2: Final = 0.1
"""A resting vehicle still rocks: mean of a second."""

_REST_CORRELATION_FACTOR: Final = 5.0  # applied at 5 Hz, each the mean of a second


GRAVITY_BASE_S: Final = 1.0
"""Own acceleration of a body of which nothing is known, mean of a second. Only over
minutes does gravity win through this."""


COURSE_LEVER_M: Final = 1.5
"""Way between them: the course leads or lags by lever * rate / speed."""


class _Anchor(NamedTuple):
    t_ns: int
    vel_ne_mps: tuple[float, float]
    imu_velocity_mps: Vec3


class AttitudeAiding:
    """Corrects one `AttitudeFilter`; remembers what that takes.

    Attributes
    ----------
    accel_bias_mps2 : Vec3, body axes
        Only its part along gravity can be seen at rest; across it, bias and tilt
        are one.
    """

    def __init__(self, attitude: AttitudeFilter, profile: str) -> None:
        self._attitude = attitude
        self._profile = profile
        self._anchor: _Anchor | None = None
        self._distrust = 1.0
        self._n_backwards = 0
        # Of an instant: what a snapshot holds.
        self.accel_bias_mps2: Vec3 = (0.0, 0.0, 0.0)
        self._t_ns = 0
        self._imu_velocity_mps: Vec3 = (0.0, 0.0, 0.0)
        self._levelling: tuple[float, Vec3] = (0.0, (0.0, 0.0, 0.0))
        self._gravity_since: tuple[int, Vec3] = (0, (0.0, 0.0, 0.0))
        self._rate_down_radps = 0.0

    def snapshot(self) -> tuple[object, ...]:
        """All that changes with time."""
        return (
            self.accel_bias_mps2,
            self._t_ns,
            self._imu_velocity_mps,
            self._levelling,
            self._gravity_since,
            self._rate_down_radps,
        )

    def restore(self, saved: tuple[object, ...]) -> None:
        """Return to a snapshot."""
        (
            self.accel_bias_mps2,
            self._t_ns,
            self._imu_velocity_mps,
            self._levelling,
            self._gravity_since,
            self._rate_down_radps,
        ) = saved  # type: ignore[assignment]

    @property
    def rate_down_radps(self) -> float:
        """Yaw rate during the last step."""
        return self._rate_down_radps

    def propagate(self, step: ImuStep, a_n: Vec3) -> None:
        """Take a step and the acceleration that the attitude made of it."""
        self._t_ns = step.t_ns
        dt = step.dt_s
        if step.is_gap:
            self._anchor = None
            self._levelling = (0.0, (0.0, 0.0, 0.0))
            self._gravity_since = (step.t_ns, self._imu_velocity_mps)
            return
        vn, ve, vd = self._imu_velocity_mps
        self._imu_velocity_mps = (vn + a_n[0] * dt, ve + a_n[1] * dt, vd + a_n[2] * dt)
        tx, ty, tz = step.dtheta_b_rad
        bx, by, bz = self._attitude.gyro_bias_radps
        turn_b = (tx - bx * dt, ty - by * dt, tz - bz * dt)
        self._rate_down_radps = rotate(self._attitude.q_nb, turn_b)[2] / dt
        if not self._attitude.is_level:
            self._level(step)

    def _level(self, step: ImuStep) -> None:
        elapsed, (x, y, z) = self._levelling
        dx, dy, dz = step.dv_b_mps
        elapsed, total = elapsed + step.dt_s, (x + dx, y + dy, z + dz)
        self._levelling = (elapsed, total)
        if elapsed >= LEVELLING_S:
            self._levelling = (0.0, (0.0, 0.0, 0.0))
            self._attitude.start(total, LEVELLING_SIGMA_RAD)

    def update_from_rest(self, rest: Rest, gravity_mps2: float) -> None:
        """At rest the force is gravity, and the rate is the gyro's bias."""
        attitude = self._attitude
        factor = math.sqrt(_REST_CORRELATION_FACTOR)
        x, y, z = rest.accel_mps2
        excess = 1.0 - gravity_mps2 / math.hypot(x, y, z)
        self.accel_bias_mps2 = (x * excess, y * excess, z * excess)
        attitude.update_gyro_bias(rest.gyro_radps, REST_RATE_SIGMA_RADPS * factor)
        kept = 1.0 - excess
        f_n = rotate(attitude.q_nb, (x * kept, y * kept, z * kept))
        attitude.update_level(f_n, (0.0, 0.0), REST_LEVEL_SIGMA_MPS2 * factor)

    def update_from_velocity(
        self, vel_ne_mps: tuple[float, float], sigma_mps: float, gravity_mps2: float
    ) -> None:
        """Compare the receiver's change of velocity with the IMU's: the tilt."""
        t_ns, imu = self._t_ns, self._imu_velocity_mps
        if not self._attitude.is_yaw_usable:
            self._anchor = None
            return
        anchor = self._anchor
        dt = 0.0 if anchor is None else (t_ns - anchor.t_ns) * 1e-9
        if anchor is None or not 0.0 <= dt < 4.0 * VELOCITY_BASE_S:
            self._anchor = _Anchor(t_ns, vel_ne_mps, imu)
            return
        if dt < VELOCITY_BASE_S:
            return
        a_ne = (
            (vel_ne_mps[0] - anchor.vel_ne_mps[0]) / dt,
            (vel_ne_mps[1] - anchor.vel_ne_mps[1]) / dt,
        )
        f_n = tuple(
            (now - then) / dt
            for now, then in zip(imu, anchor.imu_velocity_mps, strict=True)
        )
        sigma = math.hypot(
            math.sqrt(2.0) * sigma_mps / dt,
            VELOCITY_MODEL_SHARE * math.hypot(*a_ne),
            VELOCITY_MODEL_MPS2,
        )
        nis = self._attitude.update_level(
            (f_n[0], f_n[1], f_n[2] - gravity_mps2), a_ne, sigma * self._distrust
        )
        square = self._distrust**2
        square += DISTRUST_SHARE * (0.5 * nis * square - square)
        self._distrust = min(max(math.sqrt(square), 1.0), MAX_DISTRUST)
        self._anchor = _Anchor(t_ns, vel_ne_mps, imu)

    def update_from_gravity(self, v_n: Vec3, gravity_mps2: float) -> None:
        """Correct the tilt by gravity, slowly: all there is without a receiver.

        Of the body's own acceleration only the part that turns it is known: rate
        times speed.
        """
        t_ns, then = self._gravity_since
        dt = (self._t_ns - t_ns) * 1e-9
        if dt < GRAVITY_BASE_S:
            return
        now = self._imu_velocity_mps
        self._gravity_since = (self._t_ns, now)
        if dt > 2.0 * GRAVITY_BASE_S or not self._attitude.is_level:
            return
        f_n = (
            (now[0] - then[0]) / dt,
            (now[1] - then[1]) / dt,
            (now[2] - then[2]) / dt - gravity_mps2,
        )
        if abs(math.hypot(*f_n) - gravity_mps2) > GRAVITY_WINDOW_MPS2:
            return
        rate = self._rate_down_radps if self._attitude.is_yaw_usable else 0.0
        centripetal = (-rate * v_n[1], rate * v_n[0])
        self._attitude.update_level(f_n, centripetal, LEVELLING_SIGMA_MPS2)

    def update_from_course(
        self, vel_ne_mps: tuple[float, float], sigma_mps: float, period_s: float
    ) -> None:
        """Take the course over ground for the heading, when fast enough."""
        speed = math.hypot(*vel_ne_mps)
        rate = abs(self._rate_down_radps)
        attitude = self._attitude
        if (
            not attitude.is_level
            or speed < max(COURSE_SPEED_MPS[self._profile], 3.0 * sigma_mps)
            or rate > COURSE_MAX_RATE_RADPS
        ):
            return
        course = math.atan2(vel_ne_mps[1], vel_ne_mps[0])
        sigma = math.hypot(
            SIX_COURSE_SIGMA_RAD,
            sigma_mps / speed,
            rate * (COURSE_DELAY_SIGMA_S + COURSE_LEVER_M / speed),
        )
        if self._profile == "vehicle" and attitude.is_yaw_usable:
            if abs(wrap_pi(course - attitude.yaw_rad)) > SIX_REVERSE_RAD:
                course += math.pi
                self._n_backwards += speed > REVERSE_MPS
                if self._n_backwards >= REVERSE_FIXES:
                    attitude.reset_yaw()
                    course -= math.pi
            else:
                self._n_backwards = 0
        factor = max(1.0, COURSE_CORRELATION_S / period_s)
        attitude.update_yaw(course, sigma * math.sqrt(factor))
