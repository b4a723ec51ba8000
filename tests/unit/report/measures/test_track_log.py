"""Rows against later fixes, on tracks whose errors are known beforehand."""

import math

import pytest

from imu_tracker.report.measures.track_log import TrackLog
from imu_tracker.samples import GpsFix
from imu_tracker.storage.latlong import LogRow

START_S = 1_800_000_000.0
METRE_RAD = 1.0 / 6_378_137.0  # of longitude on the equator
SPEED_MPS = 10.0


def row(t_s: float, mode: str = "gps", r95_m: float = 5.0) -> LogRow:
    """Drive east along the equator."""
    lon_deg = math.degrees(SPEED_MPS * t_s * METRE_RAD)
    return LogRow(START_S + t_s, 0.0, lon_deg, math.nan, SPEED_MPS, 90.0, r95_m, mode)


def fix(t_s: float, off_m: float = 0.0, sigma_m: float = 3.0) -> GpsFix:
    """A fix so far east of where the drive is at this instant."""
    lon_rad = (SPEED_MPS * t_s + off_m) * METRE_RAD
    utc_s = START_S + t_s
    return GpsFix(round(t_s * 1e9), utc_s, 0.0, lon_rad, None, None, sigma_m, 1)


def drive(log: TrackLog, begin_s: float, end_s: float, off_m: float = 0.0) -> None:
    """Four rows a second, and a fix each second just before its row."""
    for i in range(round(begin_s * 4), round(end_s * 4)):
        if i % 4 == 0:
            log.add_fix(fix(i / 4, off_m))
        log.add_row(row(i / 4))


def test_a_fix_is_compared_with_the_row_before_it_carried_on_by_its_speed() -> None:
    log = TrackLog("a")
    drive(log, 0.0, 100.0, off_m=4.0)
    overall = log.overall()
    assert overall is not None
    assert overall.fixes == 99  # the first has no row before it
    assert overall.miss_m == pytest.approx(4.0, abs=1e-3)
    assert overall.nis == pytest.approx(16.0 / ((5.0 / 2.4477) ** 2 + 9.0), rel=1e-3)
    assert overall.inside == 1.0


def test_an_outage_is_told_with_its_way_and_how_far_off_it_ended() -> None:
    log = TrackLog("a")
    drive(log, 0.0, 30.0)
    for i in range(120, 280):
        log.add_row(row(i / 4, "dr", r95_m=20.0))
    log.add_fix(fix(70.0, off_m=15.0))
    log.end()
    (outage,) = log.outages
    assert outage.begin_utc_s == START_S + 29.0
    assert outage.length_s == pytest.approx(41.0)
    assert outage.way_m == pytest.approx(410.0, abs=6.0)
    assert outage.miss_m == pytest.approx(15.0, abs=1e-3)
    assert outage.r95_m == 20.0
    assert outage.is_true


@pytest.mark.parametrize(("off_m", "is_true"), [(21.0, True), (23.0, False)])
def test_an_outage_fits_within_radius_and_fix_together(
    off_m: float, *, is_true: bool
) -> None:
    # hypot(20, 2.4477 * 4) = 22.3
    log = TrackLog("a")
    drive(log, 0.0, 30.0)
    for i in range(120, 280):
        log.add_row(row(i / 4, "dr", r95_m=20.0))
    log.add_fix(fix(70.0, off_m, sigma_m=4.0))
    assert log.outages[0].is_true is is_true


def test_an_outage_at_the_end_has_no_miss() -> None:
    log = TrackLog("a")
    drive(log, 0.0, 30.0)
    for i in range(120, 280):
        log.add_row(row(i / 4, "dr"))
    log.end()
    (outage,) = log.outages
    assert math.isnan(outage.miss_m)
    assert not outage.is_true


def test_a_slow_receiver_is_no_outage() -> None:
    log = TrackLog("a")
    for i in range(400):
        if i % 16 == 0:
            log.add_fix(fix(i / 4))
        log.add_row(row(i / 4))
    log.end()
    assert log.outages == []


def test_periods_are_hours_on_a_long_drive_and_minutes_on_a_short_one() -> None:
    short = TrackLog("a")
    drive(short, 0.0, 180.0)
    begins = [p.begin_utc_s for p in short.periods()]
    assert begins == [START_S, START_S + 60.0, START_S + 120.0]
    assert sum(p.fixes for p in short.periods()) == 179
    long = TrackLog("a")
    for hour in range(5):
        drive(long, hour * 3600.0, hour * 3600.0 + 20.0)
    assert len(long.periods()) == 5


def test_the_noisiest_place_comes_first() -> None:
    log = TrackLog("a")
    drive(log, 0.0, 60.0)
    drive(log, 60.0, 120.0, off_m=9.0)
    noisiest, *_, best = log.places()
    assert noisiest.miss_m > best.miss_m
    assert noisiest.lon_deg > best.lon_deg


def test_logs_tell_outages_by_their_mode() -> None:
    log = TrackLog("a")
    for i in range(400):
        one = row(i / 4, "dr" if 100 <= i < 200 else "gps")
        log.add_row(one)
        log.add_mode(one)
    (outage,) = log.outages
    assert outage.begin_utc_s == START_S + 25.0
    assert outage.length_s == 25.0
    assert outage.way_m == pytest.approx(250.0, abs=3.0)
    assert math.isnan(outage.miss_m)


def test_kilometres_and_modes_add_up_without_the_holes() -> None:
    log = TrackLog("a")
    for i in range(41):
        log.add_row(row(i / 4))
    for i in range(41):
        log.add_row(row(100.0 + i / 4, "dr"))
    assert log.way_m == pytest.approx(200.0, abs=1e-6)
    assert log.modes_s == {"gps": 10.0, "dr": 10.0}
