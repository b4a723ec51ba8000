"""Time: late fixes, the grid of rows, what a row is called, and dead sensors."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from imu_tracker.estimation.receiver.gate import FixOutcome
from imu_tracker.estimation.rewind import HISTORY_NS
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.estimation.tracker import Tracker
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import (
    GpsFix,
    ImuSample,
    Mode,
    NavState,
    UtcTime,
    Vec3,
)
from support.body import DPS, SECOND_NS, Body

UTC_S = 1_795_348_800.0
HOME = LocalFrame.at(math.radians(52.0), math.radians(4.37))
LATENCY_NS = 200_000_000
PLAIN = TrackerSettings("six-state", "free", LATENCY_NS * 1e-9)
MS = 1_000_000


class World:
    """A level body that goes north, its chip, its receiver, and a tracker.

    It stands for `still_s`, accelerates for five seconds, and goes on.
    """

    def __init__(
        self,
        *,
        speed: float = 0.0,
        still_s: float = 10.0,
        every_s: float = 1.0,
        latency_ns: int = LATENCY_NS,
        rate_hz: float = 100.0,
        has_velocity: bool = True,
        **settings: object,
    ) -> None:
        self.speed, self.still_s, self.every_s = speed, still_s, every_s
        self.latency_ns, self.has_velocity = latency_ns, has_velocity
        self.body = Body(rate_hz=rate_hz)
        self.tracker = Tracker(PLAIN._replace(**settings))  # type: ignore[arg-type]
        self.rows: list[NavState] = []
        self.outcomes: list[FixOutcome] = []
        self.imu_lives = self.gps_lives = True
        self.shake = 1.0  # of the road
        self.utc_off_s = 0.0  # of the receiver
        self.is_dated = True
        self._rng = np.random.default_rng(11)
        self._due_ns = 0
        self._waiting: list[GpsFix] = []

    def travelled(self, t_s: float) -> tuple[float, float, float]:
        """Way, speed and acceleration at an instant."""
        t = t_s - self.still_s
        a = self.speed / 5.0
        if t < 0.0:
            return 0.0, 0.0, 0.0
        if t < 5.0:
            return 0.5 * a * t * t, a * t, a
        return 12.5 * a + self.speed * (t - 5.0), self.speed, 0.0

    def fix_of(self, t_ns: int, north_off_m: float = 0.0) -> GpsFix:
        way, speed, _ = self.travelled(t_ns / SECOND_NS)
        lat, lon = HOME.to_lat_lon(way + north_off_m, 0.0)
        vel = (speed, 0.0) if self.has_velocity else None
        arrival_ns = t_ns + self.latency_ns
        utc_s = UTC_S + t_ns / SECOND_NS + self.utc_off_s if self.is_dated else None
        return GpsFix(arrival_ns, utc_s, lat, lon, 7.0, vel, 2.0, 1)

    def hear(self, fix: GpsFix) -> FixOutcome:
        self.rows += self.tracker.advance(fix.t_ns)
        outcome = self.tracker.on_fix(fix)
        self.outcomes.append(outcome)
        return outcome

    def go(self, seconds: float, samples: Iterable[ImuSample] | None = None) -> None:
        """Let time pass; samples other than the motion's may be given."""
        for sample in self._moved(seconds) if samples is None else samples:
            while self._due_ns <= sample.t_ns:
                if self.gps_lives:
                    self._waiting.append(self.fix_of(self._due_ns))
                self._due_ns += round(self.every_s * SECOND_NS)
            while self._waiting and self._waiting[0].t_ns <= sample.t_ns:
                self.hear(self._waiting.pop(0))
            if self.imu_lives:
                self.rows += self.tracker.on_imu(sample)
            elif sample.t_ns % (50 * MS) == 0:
                self.rows += self.tracker.advance(sample.t_ns)

    def _moved(self, seconds: float) -> Iterator[ImuSample]:
        for sample in self.body.samples(seconds):
            _, speed, push = self.travelled(sample.t_ns / SECOND_NS)
            shake = self.shake if speed > 0.0 else 0.0
            road = shake * self._rng.standard_normal(6) * ([0.3] * 3 + [0.7 * DPS] * 3)
            ax, ay, az = (road[:3] + sample.accel_mps2 + [push, 0.0, 0.0]).tolist()
            gx, gy, gz = (road[3:] + sample.gyro_radps).tolist()
            yield sample._replace(accel_mps2=(ax, ay, az), gyro_radps=(gx, gy, gz))

    def miss_m(self, row: NavState) -> float:
        way, _, _ = self.travelled(row.utc_s - UTC_S - self.utc_off_s)
        north, east = HOME.to_ne(row.lat_rad, row.lon_rad)
        return math.hypot(north - way, east)

    def modes(self, since_s: float, until_s: float = math.inf) -> set[Mode]:
        return {row.mode for row in self.rows if since_s <= row.utc_s - UTC_S < until_s}


def assert_no_hole(rows: list[NavState], rate_hz: int) -> None:
    """Rows lie on the grid of UTC, one after the other."""
    numbers = [row.utc_s * rate_hz for row in rows]
    assert all(abs(number - round(number)) < 1e-3 for number in numbers)
    assert np.array_equal(np.diff(np.round(numbers)), np.ones(len(rows) - 1))
    assert np.all(np.diff([row.t_ns for row in rows]) > 0)


# --------------------------------------------------------------------- the grid


@pytest.mark.parametrize("rate_hz", [1, 2, 4, 5, 8, 10])
def test_rows_lie_on_the_grid_of_utc_without_a_hole(rate_hz: int) -> None:
    world = World(rate_hz=100.0, speed=10.0)
    world.tracker = Tracker(TrackerSettings(rate_hz=rate_hz))
    world.go(30.0)
    assert len(world.rows) >= 29 * rate_hz
    assert_no_hole(world.rows, rate_hz)


def test_a_row_is_written_within_half_a_second_of_its_instant() -> None:
    world = World(speed=10.0)
    for living in (True, False, True):
        world.imu_lives = living
        for _ in range(500):
            n = len(world.rows)
            world.go(0.01)
            for row in world.rows[n:]:
                assert world.body.t_ns - row.t_ns <= 500 * MS


def test_nothing_is_written_before_utc_is_known() -> None:
    world = World()
    world.gps_lives = False
    for _ in range(5):
        world.go(1.0)
        world.hear(world.fix_of(world.body.t_ns)._replace(utc_s=None))
        assert world.rows == []
    world.hear(world.fix_of(world.body.t_ns))
    world.go(1.0)
    assert world.rows[0].utc_s - UTC_S < 6.0


def test_rows_begin_with_the_first_fix() -> None:
    world = World()
    world.gps_lives = False
    world.go(7.3)
    assert world.rows == []
    world.gps_lives = True
    world.go(3.0)
    assert 7.5 <= world.rows[0].utc_s - UTC_S <= 8.9


def test_the_time_of_a_row_is_the_instant_it_describes() -> None:
    world = World(speed=10.0)
    world.go(40.0)
    for row in world.rows:
        # The host's clock is at 0 at UTC_S; latency is as configured.
        assert row.t_ns / SECOND_NS == pytest.approx(row.utc_s - UTC_S, abs=1e-3)
    assert max(map(world.miss_m, world.rows[100:])) < 0.7


# ----------------------------------------------------------------------- modes


def test_modes_follow_what_happens() -> None:
    world = World(speed=10.0, still_s=15.0)
    world.go(14.0)
    world.go(16.0)
    world.gps_lives = False
    world.go(10.0)
    world.imu_lives = False
    world.go(5.0)
    world.gps_lives = True
    world.go(5.0)
    world.imu_lives = True
    world.go(5.0)
    assert world.modes(0, 1.5) == {Mode.GPS}
    assert world.modes(4, 15) == {Mode.STILL}
    assert world.modes(16, 30) == {Mode.GPS}
    assert world.modes(33, 40) == {Mode.DR}
    assert world.modes(40.5, 50) == {Mode.GPSONLY}
    assert world.modes(51) == {Mode.GPS}
    assert_no_hole(world.rows, 4)


def test_a_first_fix_counts_as_used() -> None:
    world = World(every_s=60.0, still_s=0.0, speed=5.0)
    world.go(1.5)
    assert world.modes(0) == {Mode.GPS}


def test_with_a_fix_a_minute_rows_say_gps_all_the_time() -> None:
    world = World(every_s=60.0, still_s=0.0, speed=5.0)
    world.go(400.0)
    assert world.modes(130.0) == {Mode.GPS}


def test_one_fix_after_an_outage_does_not_count_for_minutes() -> None:
    world = World(speed=10.0)
    world.go(30.0)
    world.gps_lives = False
    world.go(60.0)
    world.gps_lives = True
    world.go(1.0)
    world.gps_lives = False
    world.go(10.0)
    assert world.modes(94.0) == {Mode.DR}


def test_standing_still_without_gps_is_still() -> None:
    world = World()
    world.go(20.0)
    world.gps_lives = False
    world.go(60.0)
    assert world.modes(20.0) == {Mode.STILL}
    assert world.miss_m(world.rows[-1]) < 1.0


def test_transitions_are_told_once() -> None:
    world = World(speed=10.0)
    world.go(20.0)
    assert world.tracker.take_notices() == ["tracking begins", "GPS in use"]
    world.gps_lives = False
    world.go(10.0)
    world.imu_lives = False
    world.go(3.0)
    assert world.tracker.take_notices() == [
        "GPS lost: dead reckoning",
        "IMU unavailable, GPS lost",
    ]
    assert world.tracker.take_notices() == []


# -------------------------------------------------------------------- dead sensors


def test_an_imu_that_never_lived_leaves_the_receiver() -> None:
    world = World(speed=10.0)
    world.imu_lives = False
    world.go(60.0)
    assert world.modes(0) == {Mode.GPSONLY}
    assert_no_hole(world.rows, 4)
    assert max(map(world.miss_m, world.rows[120:])) < 3.0


def test_an_imu_that_comes_late_is_welcome() -> None:
    world = World(speed=10.0, still_s=30.0)
    world.imu_lives = False
    world.go(20.0)
    world.imu_lives = True
    world.go(30.0)
    assert world.modes(40) == {Mode.GPS}
    assert_no_hole(world.rows, 4)
    assert max(map(world.miss_m, world.rows[160:])) < 3.0


def test_a_frozen_sensor_is_an_unavailable_one() -> None:
    world = World(speed=10.0)
    world.go(30.0)
    stuck = next(iter(world.body.samples(0.01)))
    world.go(0.0, [stuck._replace(t_ns=stuck.t_ns + k * 10 * MS) for k in range(1500)])
    world.body.t_ns = stuck.t_ns + 15 * SECOND_NS
    assert world.modes(32.0) == {Mode.GPSONLY}
    assert_no_hole(world.rows, 4)
    world.go(10.0)
    assert world.modes(47.0) == {Mode.GPS}


def test_broken_samples_do_no_harm() -> None:
    world = World(speed=10.0)
    rng = np.random.default_rng(8)
    for _ in range(40):
        samples = list(world._moved(1.0))
        for k in rng.integers(0, 100, 5).tolist():
            samples[k] = samples[k]._replace(accel_mps2=(math.nan,) * 3)
        for k in rng.integers(0, 99, 3).tolist():
            samples[k], samples[k + 1] = samples[k + 1], samples[k]
        world.go(1.0, samples)
    assert max(map(world.miss_m, world.rows[100:])) < 1.0
    assert world.tracker.counters["invalid_samples"] > 100
    assert world.tracker.counters["repeated_samples"] > 50
    assert_no_hole(world.rows, 4)


def test_time_that_goes_back_for_good_does_not_stop_the_rows() -> None:
    # No header said so; the samples are of no use any more, the fixes are.
    world = World(speed=10.0)
    world.go(30.0)
    for k in range(30, 60):
        old = [s._replace(t_ns=s.t_ns - 10**11) for s in world._moved(1.0)]
        for sample in old:
            world.rows += world.tracker.on_imu(sample)
        world.hear(world.fix_of(k * SECOND_NS))
    assert world.modes(32.0) == {Mode.GPSONLY}
    assert_no_hole(world.rows, 4)


@pytest.mark.parametrize("rate_hz", [10.0, 25.0, 50.0, 200.0])
def test_any_rate_of_the_imu_will_do(rate_hz: float) -> None:
    world = World(speed=10.0, rate_hz=rate_hz)
    world.go(40.0)
    assert world.modes(17.0) == {Mode.GPS}
    assert max(map(world.miss_m, world.rows[60:])) < 1.0


# ----------------------------------------------------------------------- late fixes


@pytest.mark.parametrize("latency_s", [0.1, 0.5, 1.1, 2.0])
def test_a_late_fix_does_what_it_would_have_done_in_time(latency_s: float) -> None:
    ends = []
    for late_s in (0.0, latency_s):
        world = World(
            speed=12.0, latency_ns=round(late_s * SECOND_NS), latency_s=late_s
        )
        world.go(40.0)
        # The same fixes must have been heard: none in the last seconds.
        world.gps_lives = False
        world.go(3.0)
        ends.append(world.rows[-1])
    in_time, late = ends
    here = LocalFrame.at(in_time.lat_rad, in_time.lon_rad)
    assert math.hypot(*here.to_ne(late.lat_rad, late.lon_rad)) < 0.05
    assert late.v_n_mps == pytest.approx(in_time.v_n_mps, abs=0.01)
    assert late.r95_m == pytest.approx(in_time.r95_m, rel=0.02)


def test_the_latency_does_not_drag_the_track_back() -> None:
    # 30 m/s and a second of latency: taken as now, each fix would pull 30 m.
    world = World(speed=30.0, latency_ns=SECOND_NS, latency_s=1.0)
    world.go(60.0)
    assert max(map(world.miss_m, world.rows[200:])) < 1.5


def test_a_fix_without_a_date_counts_before_its_arrival() -> None:
    world = World(speed=30.0, latency_ns=SECOND_NS, latency_s=1.0)
    world.go(30.0)
    world.is_dated = False
    world.go(30.0)
    assert world.outcomes[-1] is FixOutcome.ACCEPTED
    assert max(map(world.miss_m, world.rows[200:])) < 1.5


def test_a_fix_older_than_the_history_is_too_late() -> None:
    world = World(speed=10.0)
    world.go(20.0)
    before = world.rows[-1]
    old = world.fix_of(world.body.t_ns - HISTORY_NS - SECOND_NS, north_off_m=5.0)
    assert world.hear(old._replace(t_ns=world.body.t_ns)) is FixOutcome.TOO_LATE
    world.go(0.3)
    assert world.rows[-1].r95_m == pytest.approx(before.r95_m, rel=0.1)
    assert world.tracker.counters["fixes_too_late"] == 1


@pytest.mark.parametrize("estimator", ["six-state", "error-state"])
@pytest.mark.parametrize("leap_s", [-1.0, 1.0])
def test_a_leap_second_costs_three_fixes_and_no_truth(
    leap_s: float, estimator: str
) -> None:
    # At 20 m/s a fix that is dated wrong by a second is 20 m off.
    world = World(speed=20.0, estimator=estimator)
    world.go(60.0)
    world.tracker.take_notices()
    world.utc_off_s = leap_s
    world.go(1.5)
    n_rows = len(world.rows)
    world.go(31.5)
    assert world.outcomes[-33:].count(FixOutcome.UNDATED) == 2
    assert set(world.outcomes[-30:]) == {FixOutcome.ACCEPTED}
    (told,) = (n for n in world.tracker.take_notices() if "jumped" in n)
    assert told == (
        f"the receiver's time jumped by {leap_s:+.1f} s; the rows' follows slowly"
    )
    # By the new time rows are up to a second off until they have followed; r95 says so.
    rows = world.rows[n_rows:]
    assert max(map(world.miss_m, rows)) > 15.0
    assert all(world.miss_m(row) <= row.r95_m for row in rows)
    assert rows[-1].r95_m == pytest.approx(world.rows[n_rows - 20].r95_m, rel=0.2)
    assert_no_hole(world.rows, 4)


def test_a_backlog_in_one_burst_does_not_become_now() -> None:
    # The port hung for 20 s; then all its fixes come at once.
    world = World(speed=10.0)
    world.go(30.0)
    world.gps_lives = False
    world.go(20.0)
    now_ns = world.body.t_ns
    for k in range(30, 50):
        fix = world.fix_of(k * SECOND_NS)
        world.hear(fix._replace(t_ns=now_ns + k * MS))
    world.gps_lives = True
    world.go(10.0)
    assert max(world.miss_m(row) for row in world.rows if row.t_ns > now_ns) < 3.0
    assert_no_hole(world.rows, 4)


def test_a_backlog_at_the_start_does_not_become_now() -> None:
    # The receiver ran before us: what waited in its buffer is of half a minute ago.
    world = World(speed=10.0, still_s=0.0)
    world.gps_lives = False
    world.go(40.0)
    for k in range(10, 40):
        world.hear(world.fix_of(k * SECOND_NS)._replace(t_ns=40 * SECOND_NS + k * MS))
    world.gps_lives = True
    world.go(15.0)
    assert_no_hole(world.rows, 4)
    # The freshest of them is a second old: so much the rows are off, and slew.
    assert max(map(world.miss_m, world.rows)) < 10.0
    assert all(world.miss_m(row) <= row.r95_m for row in world.rows)
    assert world.miss_m(world.rows[-1]) < 1.0


# ------------------------------------------------------------------------ wild fixes


@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_one_wild_fix_changes_no_row(speed: float) -> None:
    ends = []
    for is_wild in (False, True):
        world = World(speed=speed)
        world.go(40.5)
        if is_wild:
            wild = world.fix_of(40_300_000_000, north_off_m=900.0)
            wild = wild._replace(t_ns=world.body.t_ns, vel_ne_mps=(-30.0, 8.0))
            assert world.hear(wild) is FixOutcome.OUTLIER
        world.go(20.0)
        ends.append(world.rows)
    for plain, disturbed in zip(*ends, strict=True):
        here = LocalFrame.at(plain.lat_rad, plain.lon_rad)
        moved = math.hypot(*here.to_ne(disturbed.lat_rad, disturbed.lon_rad))
        assert moved < 0.02
        assert disturbed.mode is plain.mode


@pytest.mark.parametrize("every_s", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("has_velocity", [True, False])
def test_a_receiver_that_is_right_is_never_ignored_for_long(
    every_s: float, has_velocity: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = World(speed=10.0, every_s=every_s, has_velocity=has_velocity)
    world.go(40.0)
    n = len(world.outcomes)
    honest = world.fix_of
    monkeypatch.setattr(world, "fix_of", lambda t_ns: honest(t_ns, 700.0))
    world.go(25.0)
    ignored = next(
        k for k, outcome in enumerate(world.outcomes[n:]) if outcome != "outlier"
    )
    assert ignored <= 8
    assert ignored * every_s <= 10.0 + every_s


def test_a_parked_body_that_was_carried_away_is_found_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A train that starts so softly that the IMU calls it rest.
    world = World()
    world.go(30.0)
    honest = world.fix_of
    monkeypatch.setattr(world, "fix_of", lambda t_ns: honest(t_ns, 300.0))
    world.go(30.0)
    assert abs(world.miss_m(world.rows[-1]) - 300.0) < 10.0


@pytest.mark.parametrize(
    ("estimator", "profile", "still_s"),
    [
        ("error-state", "auto", 10.0),
        ("error-state", "vehicle", -100.0),
        ("error-state", "auto", -100.0),
        ("six-state", "free", 10.0),
    ],
)
def test_who_glides_into_a_tunnel_is_not_at_rest_there(
    estimator: str, profile: str, still_s: float
) -> None:
    # A boat or a train without a shake, that was seen to start, or has gone for long
    # when it is first seen.
    world = World(speed=10.0, still_s=still_s, estimator=estimator, profile=profile)
    world.shake = 0.0
    world.go(60.0)
    world.gps_lives = False
    n_rows = len(world.rows)
    world.go(20.0)
    rows = world.rows[n_rows:]
    inside = sum(world.miss_m(row) <= row.r95_m for row in rows)
    assert inside / len(rows) >= 0.95


# -------------------------------------------------------------- without a first fix


def test_a_configured_start_begins_rows_as_soon_as_utc_is_known() -> None:
    world = World(start=(HOME.lat_rad, HOME.lon_rad), start_radius_m=80.0)
    world.gps_lives = False
    world.go(5.0)
    assert world.rows == []
    world.tracker.on_time(UtcTime(world.body.t_ns, UTC_S + 4.8))
    world.go(10.0)
    assert_no_hole(world.rows, 4)
    first = world.rows[0]
    assert first.utc_s - UTC_S < 6.0
    assert "no GPS yet: dead reckoning" in world.tracker.take_notices()
    assert first.r95_m == pytest.approx(80.0, rel=0.03)
    assert world.miss_m(first) < 1.0
    assert first.alt_m is None


def test_the_first_fix_ends_the_guess() -> None:
    far = HOME.to_lat_lon(5000.0, 0.0)
    world = World(start=far, start_radius_m=50.0)
    world.gps_lives = False
    world.go(5.0)
    world.tracker.on_time(UtcTime(world.body.t_ns, UTC_S + 4.8))
    world.go(5.0)
    world.gps_lives = True
    world.go(5.0)
    assert world.miss_m(world.rows[-1]) < 2.0
    assert_no_hole(world.rows, 4)


def test_a_time_without_a_start_writes_nothing() -> None:
    world = World()
    world.gps_lives = False
    world.tracker.on_time(UtcTime(1, UTC_S))
    world.go(10.0)
    assert world.rows == []


# -------------------------------------------------------------------- long and odd


def test_a_receiver_without_velocity_will_do() -> None:
    world = World(speed=10.0, has_velocity=False)
    world.go(90.0)
    assert max(map(world.miss_m, world.rows[160:])) < 3.0


def test_a_smooth_ride_without_velocity_is_not_taken_for_rest_for_ever() -> None:
    # A boat that the IMU cannot tell from rest, and GGA alone: positions decide.
    world = World(speed=10.0, has_velocity=False)
    world.shake = 0.0
    world.go(90.0)
    late = world.rows[160:]
    assert all(world.miss_m(row) <= row.r95_m for row in late)
    assert max(map(world.miss_m, late)) < 8.0
    assert world.modes(45.0) == {Mode.GPS}


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_spin_beyond_the_range_is_survived(axis: int) -> None:
    # Thrown about at 1400 deg/s for half a second while the gyro shows 500.
    world = World(speed=10.0)
    world.go(40.0)
    spin = [0.0, 0.0, 0.0]
    spin[axis] = 500.0 * DPS
    rate: Vec3 = (spin[0], spin[1], spin[2])
    clipped = [s._replace(is_saturated=True) for s in world.body.samples(0.5, rate)]
    world.go(0.5, clipped)
    world.go(30.0)
    late = [world.miss_m(row) for row in world.rows if row.utc_s - UTC_S > 45.0]
    assert max(late) < 6.0
    assert world.tracker.counters["saturated_samples"] == 50


def test_what_was_learnt_can_be_told() -> None:
    world = World(speed=10.0)
    world.go(30.0)
    report = world.tracker.report()
    assert report["estimator"] == "six-state"
    assert report["utc_jumps"] == 0
    assert world.tracker.counters["fixes_accepted"] >= 28
