"""Standstill detection by the IMU.

The most useful measurement there is without GPS, and the most dangerous: a creeping
car that is taken to stand writes its turn into the gyro bias. So rest is claimed
only when the vibration of a second lies below a level learnt from this very vehicle,
the rate agrees with the bias, the force with gravity, and nothing that is known of
the speed contradicts it.
"""

import math
from typing import Final, NamedTuple

from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.vibration import Vibration
from imu_tracker.motion.window import StepWindow
from imu_tracker.samples import Vec3

CONFIRM_S: Final = 0.5
"""Rest must last so long beyond its first full window: a turning point is no stop."""

_LATEST_STEPS: Final = 5
LEAVING_RADPS: Final = math.radians(0.5)
LEAVING_MPS2: Final = 0.2
"""Mean of the latest fifth of a second against the window's."""

PULLING_MPS2: Final = 0.1
PULLING_AFTER_S: Final = 5.0
REFERENCE_S: Final = 30.0
"""The mean force of a rest so long does not change until it goes: a tram pulls off by
0.2 m/s^2 and shakes no more than before. A passenger who gets in tips a car by 0.05."""

MAX_BIAS_DEVIATION_RADPS: Final = math.radians(1.0)
"""A slow turn is no rest: a roundabout at walking pace turns 5 deg/s."""

GRAVITY_MPS2: Final = 9.81
MAX_GRAVITY_DEVIATION_MPS2: Final = 0.8
"""|f| at rest: accelerometer bias and scale (datasheet: 50 mg and 3 %), and gravity
itself, 9.78 to 9.83."""

MOVING_MPS: Final = 0.7
"""Speed of a receiver above which it contradicts rest; parked ones show up to this."""

SURELY_MOVING_MPS: Final = 1.4

GLIDE_FORCE_MPS2: Final = 0.1
GLIDE_TURN_RADPS: Final = math.radians(0.3)
STOPPED_SHARE: Final = 0.5
"""A boat or a train may glide as quietly as it rests. Without a receiver it has stopped
only if it was felt to brake: force that differs from the gliding body's by more than a
little tilt, summed to half of its speed. What is felt in a bend is none of it."""

STANDING_MPS: Final = 0.3
AGREED_FIXES: Final = 3
AGREED_FACTOR: Final = 4.0
UNKNOWN_FACTOR: Final = 12.0
UNKNOWN_BIAS_RADPS: Final = math.radians(0.1)
"""While fix after fix reports standstill, more vibration is allowed: an idling diesel,
a fan, wind; and a propeller, as long as the gyro's bias is known worse than this. Rate
and force must agree all the same. The velocity comes late: only an estimator that
confirms rest in hindsight may use it."""


LOUDER: Final = 2.0
MOVED_MPS2: Final = 0.15
MOVED_RADPS: Final = math.radians(0.5)
"""Signs of a start from rest, whatever a receiver reports: vibration twice that of
the rest, or a mean force or rate that differs from the rest's."""


class Rest(NamedTuple):
    """What the sensors read while at rest, means over the window in body axes."""

    gyro_radps: Vec3
    accel_mps2: Vec3
    duration_s: float
    gyro_std_radps: float = 0.0  # about their mean, all axes together
    accel_std_mps2: float = 0.0


class StandstillDetector:
    """Decides from steps whether the body rests.

    Notes
    -----
    A rest ends when its mean force changes, and with another force none is claimed
    until something has shaken. One sum is kept per quantity, so that a step costs the
    same at any window.

    Parameters
    ----------
    in_hindsight : bool
        Rest is used a second or more after it was detected.

    Attributes
    ----------
    vibration : Vibration
        How much this vehicle shakes, learnt from the receiver's speed.
    """

    def __init__(self, *, in_hindsight: bool = False) -> None:
        self._in_hindsight = in_hindsight
        self._window = StepWindow()
        self._rest_since_ns: int | None = None
        self._speed_mps: float | None = None
        self._speed_ns = 0
        self._vetoed_until_ns = 0
        self._n_slow = self._n_moving = 0
        self._force: tuple[Vec3, float] | None = None  # of a rest, and its duration
        self._accel: Vec3 = (0.0, 0.0, 0.0)
        self._is_shaking = True
        self._gliding: tuple[Vec3, float] | None = None  # its force, what is to brake
        self._gyro_std = self._accel_std = math.inf
        self._standing: Rest | None = None  # the last one, until the IMU shows its end
        self.vibration = Vibration()

    def add_speed(self, t_ns: int, speed_mps: float) -> None:
        """Hear the receiver's speed; learn the level of vibration that goes with it."""
        self._speed_mps, self._speed_ns = speed_mps, t_ns
        self._n_slow = self._n_slow + 1 if speed_mps <= STANDING_MPS else 0
        if not math.isfinite(self._gyro_std):
            return
        is_gliding = speed_mps > MOVING_MPS and not self._is_shaking
        to_brake_mps = STOPPED_SHARE * speed_mps
        self._gliding = (self._accel, to_brake_mps) if is_gliding else None
        # Of a car that pulls off the first window is half at rest.
        self._n_moving = self._n_moving + 1 if speed_mps > SURELY_MOVING_MPS else 0
        is_moving = self._n_moving > 1
        if not is_moving and speed_mps > STANDING_MPS:
            return  # neither surely at rest nor surely moving
        self.vibration.learn(self._gyro_std, self._accel_std, is_moving=is_moving)

    @property
    def is_standing(self) -> bool:
        """Whether by the IMU alone the last rest goes on."""
        return self._standing is not None

    def veto(self, until_ns: int) -> None:
        """Detect no rest until then: other evidence shows motion."""
        self._vetoed_until_ns = until_ns
        self._rest_since_ns = None

    def add_step(
        self,
        step: ImuStep,
        gyro_bias_radps: Vec3,
        gyro_bias_sigma_radps: float,
        speed_mps: float,
        speed_sigma_mps: float,
    ) -> Rest | None:
        """Take one step; return the rest that it confirms, or None.

        Parameters
        ----------
        step : ImuStep
        gyro_bias_radps, gyro_bias_sigma_radps : Vec3, float
            The attitude filter's estimate of the bias.
        speed_mps, speed_sigma_mps : float
            The filter's estimate of the horizontal speed.
        """
        if step.is_gap:
            self._window.clear()
            self._gyro_std = self._accel_std = math.inf
            self._rest_since_ns = self._force = self._gliding = self._standing = None
            return None
        self._window.add_step(step)
        if not self._window.is_full:
            self._rest_since_ns = None
            return None
        (gyro, self._gyro_std), (accel, self._accel_std) = self._window.statistics()
        if self._standing is not None and self._has_left(self._standing, gyro, accel):
            self._standing = None
        deviation = math.dist(gyro, gyro_bias_radps)
        agreed = 1.0
        if self._receiver_stands(step.t_ns):
            is_unknown = gyro_bias_sigma_radps > UNKNOWN_BIAS_RADPS
            agreed = UNKNOWN_FACTOR if is_unknown else AGREED_FACTOR
        stds = self._gyro_std, self._accel_std
        is_shaking = self.vibration.exceeds(*stds, factor=agreed)
        self._is_shaking, self._accel = self.vibration.exceeds(*stds), accel
        is_turning = deviation > GLIDE_TURN_RADPS + 3.0 * gyro_bias_sigma_radps
        self._integrate_braking(0.0 if is_turning else step.dt_s)
        if is_shaking or agreed > 1.0:
            self._force = None
        is_quiet = (
            not is_shaking
            and not self._is_pulling(accel)
            and deviation < MAX_BIAS_DEVIATION_RADPS + 3.0 * gyro_bias_sigma_radps
            and abs(math.hypot(*accel) - GRAVITY_MPS2) < MAX_GRAVITY_DEVIATION_MPS2
            and not self._is_leaving(gyro, accel)
        )
        if not is_quiet or self._is_contradicted(step.t_ns, speed_mps, speed_sigma_mps):
            self._rest_since_ns = None
            return None
        if self._rest_since_ns is None:
            self._rest_since_ns = step.t_ns
        duration_s = (step.t_ns - self._rest_since_ns) * 1e-9
        self._average_force(accel, step.dt_s)
        if duration_s < CONFIRM_S:
            return None
        rest = Rest(gyro, accel, duration_s, self._gyro_std, self._accel_std)
        self._standing = self._standing or rest
        return rest

    def _integrate_braking(self, dt_s: float) -> None:
        """Count down what a gliding body has still to brake; shaking ends the glide."""
        if self._is_shaking:
            self._gliding = None
        elif self._gliding is not None:
            force, to_brake_mps = self._gliding
            felt_mps2 = math.dist(self._accel, force) - GLIDE_FORCE_MPS2
            to_brake_mps -= max(felt_mps2, 0.0) * dt_s
            self._gliding = (force, to_brake_mps) if to_brake_mps > 0.0 else None

    def _has_left(self, rest: Rest, gyro: Vec3, accel: Vec3) -> bool:
        """Whether the window differs from a rest as no resting body does."""
        return (
            self._gyro_std > LOUDER * rest.gyro_std_radps
            or self._accel_std > LOUDER * rest.accel_std_mps2
            or math.dist(accel, rest.accel_mps2) > MOVED_MPS2
            or math.dist(gyro, rest.gyro_radps) > MOVED_RADPS
        )

    def _is_leaving(self, gyro: Vec3, accel: Vec3) -> bool:
        """Whether the latest steps differ from the window: a car pulls off.

        The window's deviations see it only when half a second of it was lost.
        """
        latest_gyro, latest_accel = self._window.latest_means(_LATEST_STEPS)
        return (
            math.dist(latest_gyro, gyro) > LEAVING_RADPS
            or math.dist(latest_accel, accel) > LEAVING_MPS2
        )

    def _is_pulling(self, accel: Vec3) -> bool:
        """Whether the force is no longer that of the rest before."""
        if self._force is None:
            return False
        force, lasted_s = self._force
        return lasted_s > PULLING_AFTER_S and math.dist(force, accel) > PULLING_MPS2

    def _average_force(self, accel: Vec3, dt_s: float) -> None:
        """Average the force of a rest."""
        (x, y, z), lasted_s = (accel, 0.0) if self._force is None else self._force
        lasted_s = min(lasted_s + dt_s, REFERENCE_S)
        share = dt_s / lasted_s
        ax, ay, az = accel
        mean = (x + share * (ax - x), y + share * (ay - y), z + share * (az - z))
        self._force = mean, lasted_s

    def _receiver_stands(self, t_ns: int) -> bool:
        """Whether the receiver has reported standstill for some time."""
        return (
            self._in_hindsight
            and t_ns - self._speed_ns < 3e9
            and self._n_slow >= AGREED_FIXES
        )

    def _is_contradicted(
        self, t_ns: int, speed_mps: float, speed_sigma_mps: float
    ) -> bool:
        if t_ns < self._vetoed_until_ns:
            return True
        if self._speed_mps is not None and t_ns - self._speed_ns < 3e9:
            return self._speed_mps > MOVING_MPS
        # In an outage, standstill after smooth coasting needs measured braking of half
        # the last known speed, and a filter that knows no other speed.
        return self._gliding is not None or speed_mps > 1.0 + 3.0 * speed_sigma_mps
