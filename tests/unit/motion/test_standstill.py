"""Rest is claimed by what rests, and by nothing that only moves smoothly."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from imu_tracker.motion.preintegration import ImuStep, Preintegrator, gap_step
from imu_tracker.motion.standstill import Rest, StandstillDetector
from imu_tracker.motion.vibration import (
    CEILING_FACTOR,
    FLOOR_FACTOR,
    START_GYRO_STD_RADPS,
)
from imu_tracker.samples import ImuSample, Vec3
from support.body import DPS, SECOND_NS, Body, G, steps_of

UNKNOWN_BIAS = 3.0 * DPS
NO_BIAS: Vec3 = (0.0, 0.0, 0.0)


class Watch:
    """A detector with a body in front of it; remembers all that it claimed."""

    def __init__(self, body: Body | None = None) -> None:
        self.body = body or Body()
        self.detector = StandstillDetector()
        self.preintegrator = Preintegrator()
        self.bias, self.bias_sigma = NO_BIAS, UNKNOWN_BIAS
        self.speed, self.speed_sigma = 0.0, 1.0

    def see(self, steps: Iterable[ImuStep]) -> list[Rest | None]:
        return [
            self.detector.add_step(
                step, self.bias, self.bias_sigma, self.speed, self.speed_sigma
            )
            for step in steps
        ]

    def move(
        self, seconds: float, gyro: Vec3 = NO_BIAS, accel: Vec3 = NO_BIAS
    ) -> list[Rest | None]:
        return self.see(steps_of(self.body, self.preintegrator, seconds, gyro, accel))

    def play(self, samples: Iterable[ImuSample]) -> list[Rest | None]:
        add = self.preintegrator.add_sample
        return self.see(step for s in samples if (step := add(s)) is not None)

    def hear(self, speed_mps: float) -> None:
        self.detector.add_speed(self.body.t_ns, speed_mps)


def claims(found: list[Rest | None]) -> int:
    return sum(rest is not None for rest in found)


def rocking(
    body: Body, seconds: float, roll_rad: float, period_s: float
) -> Iterator[ImuSample]:
    """A boat: it rolls, and gravity swings through its axes."""
    omega = 2.0 * math.pi / period_s
    for s in body.samples(seconds):
        t = s.t_ns / SECOND_NS
        roll = roll_rad * math.sin(omega * t)
        rate = roll_rad * omega * math.cos(omega * t)
        ax, ay, az = s.accel_mps2
        turned = (ax, ay - G * math.sin(roll), az + G * (1.0 - math.cos(roll)))
        gx, gy, gz = s.gyro_radps
        yield s._replace(accel_mps2=turned, gyro_radps=(gx + rate, gy, gz))


def humming(
    body: Body, seconds: float, accel_mps2: float, hz: float
) -> Iterator[ImuSample]:
    """An engine that idles: it shakes the box up and down."""
    for s in body.samples(seconds):
        ax, ay, az = s.accel_mps2
        shake = accel_mps2 * math.sin(2.0 * math.pi * hz * s.t_ns / SECOND_NS)
        yield s._replace(accel_mps2=(ax, ay, az + shake))


def test_a_resting_body_is_found_within_two_seconds() -> None:
    watch = Watch()
    found = watch.move(4.0)
    first = next(k for k, rest in enumerate(found) if rest is not None)
    assert first * 0.04 < 2.0
    assert claims(found) == len(found) - first


def test_rest_tells_what_the_sensors_read() -> None:
    watch = Watch()
    watch.body.gyro_bias_radps = (1 * DPS, -2 * DPS, 3 * DPS)
    rest = watch.move(4.0)[-1]
    assert rest is not None
    assert rest.gyro_radps == pytest.approx(watch.body.gyro_bias_radps, abs=0.03 * DPS)
    assert rest.accel_mps2 == pytest.approx((0.0, 0.0, -G), abs=0.02)
    assert rest.duration_s > 2.0


def test_an_idling_engine_is_rest() -> None:
    watch = Watch()
    assert claims(watch.play(humming(watch.body, 6.0, 0.15, 27.0))) > 100


def test_a_car_that_pulls_off_is_moving_within_a_third_of_a_second() -> None:
    watch = Watch()
    watch.move(5.0)
    found = watch.move(1.0, accel=(1.0, 0.0, 0.0))
    assert claims(found[8:]) == 0
    # A steady push then feels like a tilt: what the filter made of it decides.
    watch.speed, watch.speed_sigma = 1.5, 0.1
    assert claims(watch.move(3.0, accel=(1.0, 0.0, 0.0))) == 0


def test_a_gentle_turn_away_is_motion_within_a_third_of_a_second() -> None:
    watch = Watch()
    watch.bias_sigma = 0.05 * DPS
    watch.move(5.0)
    assert claims(watch.move(3.0, gyro=(0.0, 0.0, 4.0 * DPS))[8:]) == 0


def test_a_creeping_turning_car_is_not_rest() -> None:
    # A roundabout at walking pace: as smooth as rest, but it turns. Believed, it
    # would write its turn into the gyro's bias.
    watch = Watch()
    watch.bias_sigma = 0.1 * DPS
    assert claims(watch.move(10.0, gyro=(0.0, 0.0, 5.0 * DPS))) == 0


def test_a_smooth_fast_train_is_not_rest_while_the_receiver_tells_its_speed() -> None:
    watch = Watch()
    for _ in range(20):
        watch.hear(40.0)
        assert claims(watch.move(1.0)) == 0


def test_a_train_in_a_tunnel_is_not_rest_as_long_as_its_speed_is_remembered() -> None:
    watch = Watch()
    watch.hear(40.0)
    watch.speed, watch.speed_sigma = 40.0, 5.0
    assert claims(watch.move(30.0)) == 0


def test_a_tram_that_pulls_off_without_a_shake_ends_its_rest() -> None:
    watch = Watch()
    assert claims(watch.move(20.0)) > 400
    found = watch.move(10.0, accel=(0.2, 0.0, 0.0))
    assert claims(found[50:]) == 0  # nor is one claimed while it goes on to speed up


def test_who_gets_in_does_not_end_a_rest_for_long() -> None:
    # A car tips by half a degree: its force changes, and then it rests as before.
    watch = Watch()
    watch.move(20.0)
    watch.play(humming(watch.body, 2.0, 3.0, 4.0))
    found = watch.move(5.0, accel=(0.15, 0.0, 0.0))
    assert claims(found[-50:]) == 50


def glide_into_a_tunnel(braking_mps2: float) -> int:
    """Go by smoothly at 10 m/s, lose the receiver, brake to a stop; claims after."""
    watch = Watch()
    for _ in range(20):
        watch.move(1.0)
        watch.hear(10.0)
    watch.speed_sigma = 5.0  # and soon the filter remembers no speed
    assert claims(watch.move(20.0)) == 0
    watch.move(10.0, accel=(-braking_mps2, 0.0, 0.0))
    return claims(watch.move(10.0))


def test_who_glides_through_the_dark_rests_once_it_was_felt_to_brake() -> None:
    assert glide_into_a_tunnel(0.0) == 0
    assert glide_into_a_tunnel(1.0) > 150


def test_what_is_felt_in_a_bend_is_no_braking() -> None:
    # A train at 40 m/s, in a bend so wide that it hardly turns.
    watch = Watch()
    watch.bias_sigma = 0.02 * DPS
    for _ in range(20):
        watch.move(1.0)
        watch.hear(40.0)
    watch.speed_sigma = 20.0
    there = [0.01 * k for k in range(61)]
    found = []
    for across in (*there, *[0.6] * 300, *reversed(there)):
        rate = across / 40.0
        found += watch.move(0.2, gyro=(0.0, 0.0, rate), accel=(0.0, across, 0.0))
    assert claims(found) == claims(watch.move(10.0)) == 0


def test_an_engine_that_idles_hard_is_a_rest_for_hindsight_alone() -> None:
    now, later = Watch(), Watch()
    later.detector = StandstillDetector(in_hindsight=True)
    for watch in (now, later):
        watch.bias_sigma = 0.05 * DPS
        for _ in range(6):
            watch.play(humming(watch.body, 1.0, 0.6, 27.0))
            watch.hear(0.1)
    shaken = [w.play(humming(w.body, 1.0, 0.6, 27.0)) for w in (now, later)]
    assert claims(shaken[0]) == 0
    assert claims(shaken[1]) > 20


def test_a_boat_that_rocks_is_not_rest() -> None:
    watch = Watch()
    for period_s in (3.0, 6.0):
        samples = rocking(watch.body, 20.0, math.radians(4.0), period_s)
        assert claims(watch.play(samples)) == 0


def test_a_lift_or_a_fall_is_not_rest() -> None:
    assert claims(Watch().move(4.0, accel=(0.0, 0.0, 1.0))) == 0


def test_road_vibration_is_not_rest() -> None:
    watch = Watch()
    watch.body.gyro_sigma_radps, watch.body.accel_sigma_mps2 = 1.0 * DPS, 0.4
    assert claims(watch.move(20.0)) == 0


def test_a_receiver_that_says_it_stands_does_not_make_a_rest() -> None:
    watch = Watch()
    watch.body.accel_sigma_mps2 = 1.0
    for _ in range(20):
        watch.hear(0.0)
        assert claims(watch.move(1.0)) == 0


def test_a_veto_ends_rest_for_its_time() -> None:
    watch = Watch()
    watch.move(5.0)
    watch.detector.veto(watch.body.t_ns + 5 * SECOND_NS)
    assert claims(watch.move(4.9)) == 0
    assert watch.move(1.0)[-1] is not None


def test_a_gap_ends_rest() -> None:
    watch = Watch()
    watch.move(5.0)
    assert watch.see([gap_step(watch.body.t_ns, 1.0)]) == [None]
    assert claims(watch.move(1.0)) == 0
    assert watch.move(2.0)[-1] is not None


def test_thresholds_are_learnt_from_this_vehicle() -> None:
    # A lorry that shakes at rest more than the start value allows.
    watch = Watch()
    watch.body.gyro_sigma_radps = 0.8 * DPS
    assert claims(watch.move(5.0)) == 0
    for _ in range(60):
        watch.hear(0.0)
        watch.move(0.5)
    watch.body.gyro_sigma_radps = 4.0 * DPS
    for _ in range(60):
        watch.hear(15.0)
        watch.move(0.5)
    watch.body.gyro_sigma_radps = 0.8 * DPS
    watch.hear(0.0)
    assert claims(watch.move(5.0)) > 20


@pytest.mark.parametrize(
    ("still_dps", "moving_dps", "factor"),
    [(0.01, 0.02, FLOOR_FACTOR), (5.0, 9.0, CEILING_FACTOR)],
)
def test_learning_moves_a_threshold_only_so_far(
    still_dps: float, moving_dps: float, factor: float
) -> None:
    watch = Watch()
    for sigma, speed in [(still_dps, 0.0), (moving_dps, 20.0)]:
        watch.body.gyro_sigma_radps = sigma * DPS
        for _ in range(40):
            watch.move(0.5)
            watch.hear(speed)
    assert watch.detector.vibration.gyro_threshold_radps == pytest.approx(
        factor * START_GYRO_STD_RADPS
    )


def test_nothing_is_learnt_while_the_imu_is_silent() -> None:
    # It died on a rough road; the receiver then says that the car stands. The last
    # vibration that was seen is not that of a standing car.
    watch = Watch()
    watch.body.gyro_sigma_radps, watch.body.accel_sigma_mps2 = 3.0 * DPS, 1.0
    for _ in range(20):
        watch.move(0.5)
        watch.hear(20.0)
    watch.see([gap_step(watch.body.t_ns, 1.0)])
    for _ in range(100):
        watch.hear(0.0)
    assert watch.detector.vibration.gyro_threshold_radps == START_GYRO_STD_RADPS


@pytest.mark.parametrize("rate_hz", [10.0, 25.0, 50.0, 200.0])
def test_any_rate_of_the_sensor_will_do(rate_hz: float) -> None:
    watch = Watch(Body(rate_hz=rate_hz))
    assert watch.move(5.0)[-1] is not None
    assert claims(watch.move(3.0, gyro=(0.0, 0.0, 20.0 * DPS))[-10:]) == 0


def test_hours_of_sums_lose_nothing() -> None:
    # Sums slide; rounding must not become vibration. A day in jumps of a second.
    watch = Watch()
    watch.move(3.0)
    rng = np.random.default_rng(3)
    steps = list(steps_of(watch.body, watch.preintegrator, 4.0))
    for _ in range(500):
        for step in rng.permutation(len(steps)):
            shifted = steps[step]._replace(t_ns=watch.body.t_ns)
            watch.body.t_ns += 40_000_000
            rest = watch.detector.add_step(shifted, NO_BIAS, UNKNOWN_BIAS, 0.0, 1.0)
    assert rest is not None
    assert rest.accel_mps2 == pytest.approx((0.0, 0.0, -G), abs=0.02)
