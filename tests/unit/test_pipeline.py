"""Whole sessions through the pipeline: what the log promises, whatever happens."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
import pytest

from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.pipeline import Pipeline
from imu_tracker.samples import Frame, Mode, NavState, SessionHeader, Source
from imu_tracker.simulation import simulate
from imu_tracker.simulation.receiver.receiver import IDEAL_RECEIVER, TYPICAL_RECEIVER
from imu_tracker.simulation.simulator import START_NS, START_UTC_S
from imu_tracker.storage.latlong import format_row
from support.nmea_text import sentence
from support.simulated import compare, run, without

SECOND_NS = 1_000_000_000


@dataclass
class Recorded:
    """A simulated session, kept in memory."""

    header: SessionHeader
    frames: list[Frame]
    rows: list[NavState] = field(default_factory=list)


def record(scenario: str = "drive", duration_s: float = 60.0, **kw: object) -> Recorded:
    simulated = simulate(scenario, duration_s=duration_s, **kw)  # type: ignore[arg-type]
    return Recorded(simulated.header, list(simulated.frames))


@pytest.fixture(scope="module")
def drive() -> Recorded:
    """A minute of a drive, 20 s of it standing, and the rows that it makes."""
    recorded = record(duration_s=60.0, seed=3)
    recorded.rows = run(recorded.header, recorded.frames)[0]
    return recorded


def text(rows: Iterable[NavState]) -> list[str]:
    return [format_row(row) for row in rows]


def gga_only(frames: Iterable[Frame]) -> Iterator[Frame]:
    for frame in frames:
        if frame.source is not Source.GPS or b"GGA" in frame.data:
            yield frame


def assert_no_hole(rows: list[NavState], rate_hz: int = 4) -> None:
    numbers = np.array([row.utc_s * rate_hz for row in rows])
    assert np.abs(numbers - np.round(numbers)).max() < 1e-3
    assert np.array_equal(np.diff(np.round(numbers)), np.ones(len(rows) - 1))


# ----------------------------------------------------------- the same, every time


def test_the_same_frames_make_the_same_rows(drive: Recorded) -> None:
    assert run(drive.header, drive.frames)[0] == drive.rows
    assert len(drive.rows) > 200


@pytest.mark.parametrize("share", [0.31, 0.5, 0.77, 0.999])
def test_a_recording_that_is_cut_makes_a_prefix(drive: Recorded, share: float) -> None:
    cut = int(share * len(drive.frames))
    rows, _ = run(drive.header, drive.frames[:cut])
    assert text(rows) == text(drive.rows[: len(rows)])
    # And a long one: a row uses what came half a second after it at most.
    assert rows[-1].t_ns >= drive.frames[cut - 1].t_ns - SECOND_NS // 2


@pytest.mark.parametrize("dead", [None, Source.IMU, Source.GPS])
def test_extra_ticks_change_no_row(drive: Recorded, dead: Source | None) -> None:
    # Live, time is told while nothing arrives; in a replay it is not.
    frames = list(drive.frames)
    if dead is not None:
        frames = list(without(frames, dead, 25.0, 45.0))
    rng = np.random.default_rng(9)
    pipeline = Pipeline(drive.header, TrackerSettings(profile="vehicle"))
    rows, now_ns = [], 0
    for frame in frames:
        span_ns = max(frame.t_ns - max(now_ns, START_NS), 0)
        for t_ns in sorted(rng.integers(0, span_ns + 1, 2).tolist()):
            rows += pipeline.advance(frame.t_ns - span_ns + t_ns)
        now_ns = max(now_ns, frame.t_ns)
        rows += pipeline.feed(frame)
    assert rows == run(drive.header, frames)[0]


def test_rows_come_while_nothing_arrives(drive: Recorded) -> None:
    pipeline = Pipeline(drive.header, TrackerSettings(profile="vehicle"))
    rows = [row for frame in drive.frames for row in pipeline.feed(frame)]
    last_ns = drive.frames[-1].t_ns
    for k in range(1, 101):  # every wire is cut
        now_ns = last_ns + k * SECOND_NS // 20
        rows += pipeline.advance(now_ns)
        assert now_ns - rows[-1].t_ns <= SECOND_NS // 4 + SECOND_NS // 2
    assert_no_hole(rows)
    assert rows[-1].mode is Mode.GPSONLY


# ------------------------------------------------------------------------- the rows


@pytest.mark.parametrize("rate_hz", [1, 2, 4, 5, 8, 10])
def test_rows_come_at_the_rate_that_was_asked_for(
    drive: Recorded, rate_hz: int
) -> None:
    settings = TrackerSettings(profile="vehicle", rate_hz=rate_hz)
    rows, _ = run(drive.header, drive.frames, settings)
    assert_no_hole(rows, rate_hz)
    assert rows[0].utc_s - START_UTC_S < 9.6  # the receiver finds its place after 8 s
    assert rows[-1].utc_s - START_UTC_S >= 59.0


def test_the_rate_of_rows_does_not_change_the_track(drive: Recorded) -> None:
    often, _ = run(
        drive.header, drive.frames, TrackerSettings(profile="vehicle", rate_hz=8)
    )
    told = {row.utc_s: row for row in often}
    for row in drive.rows:
        other = told[row.utc_s]  # UTC is slewed in by the row: some milliseconds
        assert other.t_ns == pytest.approx(row.t_ns, abs=20_000_000)
        assert other.lat_rad == pytest.approx(row.lat_rad, abs=0.3 / 6.37e6)
        assert other.r95_m == pytest.approx(row.r95_m, rel=0.05)


def test_modes_follow_the_story_of_a_drive(drive: Recorded) -> None:
    modes = [row.mode for row in drive.rows]
    standing = [row.mode for row in drive.rows if row.utc_s - START_UTC_S < 20]
    assert set(standing) <= {Mode.GPS, Mode.STILL}
    assert standing.count(Mode.STILL) > 20
    assert set(modes[-80:]) <= {Mode.GPS, Mode.STILL}


def test_an_imu_that_dies_and_comes_back(drive: Recorded) -> None:
    frames = without(drive.frames, Source.IMU, 30.0, 40.0)
    rows, pipeline = run(drive.header, frames)
    assert_no_hole(rows)
    modes = {row.mode for row in rows if 31.0 < row.utc_s - START_UTC_S < 39.5}
    assert modes == {Mode.GPSONLY}
    assert rows[-1].mode in (Mode.GPS, Mode.STILL)
    notices = pipeline.take_notices()
    assert "IMU unavailable: GPS alone" in notices
    figures = compare(rows, simulate("drive", seed=3, duration_s=60.0).truth, 20.0)
    assert figures.error_m.max() < 12.0


def test_a_session_without_an_imu_is_the_receivers(drive: Recorded) -> None:
    rows, _ = run(drive.header, without(drive.frames, Source.IMU, 0.0, 1e9))
    assert {row.mode for row in rows} == {Mode.GPSONLY}
    assert_no_hole(rows)
    figures = compare(rows, simulate("drive", seed=3, duration_s=60.0).truth, 20.0)
    assert figures.rms < 6.0


def test_a_session_without_any_fix_has_no_row(drive: Recorded) -> None:
    rows, pipeline = run(drive.header, without(drive.frames, Source.GPS, 0.0, 1e9))
    assert rows == []
    assert pipeline.report()["counters"] == {}


def test_event_frames_only_pass_time(drive: Recorded) -> None:
    frames = list(drive.frames)
    for k in range(1000, 6000, 500):
        frames.insert(k, Frame(frames[k].t_ns, Source.EVENT, b"imu_lost bus error"))
    assert run(drive.header, frames)[0] == drive.rows


# ------------------------------------------------------------- kinds of receivers


def test_gga_alone_is_dated_by_the_header(drive: Recorded) -> None:
    rows, pipeline = run(drive.header, gga_only(drive.frames))
    assert rows[0].utc_s == pytest.approx(START_UTC_S + 9.0, abs=1.0)
    assert_no_hole(rows)
    assert pipeline.counters["fixes"] == 52
    figures = compare(rows, simulate("drive", seed=3, duration_s=60.0).truth, 30.0)
    assert figures.rms < 8.0


def test_gga_alone_is_dated_by_the_configuration(drive: Recorded) -> None:
    header = drive.header._replace(start_utc_s=None)
    settings = TrackerSettings(profile="vehicle", gps_date="2026-11-22")
    rows, _ = run(header, gga_only(drive.frames), settings)
    assert text(rows) == text(run(drive.header, gga_only(drive.frames))[0])


def test_gga_alone_without_any_date_writes_nothing_and_says_so(
    drive: Recorded,
) -> None:
    header = drive.header._replace(start_utc_s=None)
    rows, pipeline = run(header, gga_only(drive.frames))
    assert rows == []
    assert any("gps.date" in notice for notice in pipeline.take_notices())


def test_a_configured_start_begins_before_the_first_fix(drive: Recorded) -> None:
    lat, lon = math.radians(52.0), math.radians(4.37)
    settings = TrackerSettings(profile="vehicle", start=(lat, lon))
    rows, _ = run(drive.header, drive.frames, settings)
    # This receiver knows the time after three seconds and the place after eight.
    assert rows[0].utc_s - START_UTC_S < 4.5
    assert 49.0 < rows[0].r95_m < 100.0  # it may have driven off since
    assert_no_hole(rows)
    assert rows[-1].r95_m < 10.0


@pytest.mark.parametrize("estimator", ["six-state", "error-state"])
def test_a_configured_start_needs_no_receiver_where_the_header_knows_the_time(
    drive: Recorded, estimator: str
) -> None:
    start = (math.radians(52.0), math.radians(4.37))
    settings = TrackerSettings(estimator, "vehicle", start=start)
    silent = [frame for frame in drive.frames[:2000] if frame.source is Source.IMU]
    rows, _ = run(drive.header, silent, settings)
    assert 0.0 <= rows[0].utc_s - START_UTC_S < 1.5
    assert 49.0 < rows[0].r95_m < 100.0  # it may have driven off since
    assert_no_hole(rows)
    assert run(drive.header._replace(start_utc_s=None), silent, settings)[0] == []


@pytest.mark.parametrize("gps_every_s", [0.1, 0.2, 5.0])
def test_fixes_may_come_often_or_seldom(gps_every_s: float) -> None:
    quick = TYPICAL_RECEIVER._replace(baud=115200)
    kw = {"duration_s": 90.0, "gps_every_s": gps_every_s, "receiver": quick}
    simulated = simulate("drive", seed=5, **kw)  # type: ignore[arg-type]
    rows, _ = run(simulated.header, simulated.frames)
    figures = compare(rows, simulated.truth)
    assert figures.rms < 5.0
    assert figures.inside > 0.9
    assert {row.mode for row in rows} <= {Mode.GPS, Mode.STILL}


def test_a_fix_a_minute_is_honest() -> None:
    inside = []
    for seed in (2, 3):
        simulated = simulate("drive", seed=seed, duration_s=400.0, gps_every_s=60.0)
        rows, _ = run(simulated.header, simulated.frames)
        assert_no_hole(rows)
        inside.append(compare(rows, simulated.truth, warm_up_s=61.0).inside)
    assert np.mean(inside) > 0.8


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 200.0])
def test_the_imu_may_be_slow_or_fast(rate_hz: float) -> None:
    recorded = record(seed=4, duration_s=90.0, rate_hz=rate_hz)
    rows, _ = run(recorded.header, recorded.frames)
    truth = simulate("drive", seed=4, duration_s=90.0, rate_hz=rate_hz).truth
    figures = compare(rows, truth)
    assert figures.rms < 5.0
    assert figures.inside > 0.9
    assert Mode.GPSONLY not in {row.mode for row in rows}


def test_the_mount_of_the_settings_goes_before_the_headers() -> None:
    recorded = record(seed=1, duration_s=40.0, mount=("+y", "+x", "-z"))
    right, _ = run(recorded.header, recorded.frames)
    headless = recorded.header._replace(mount=None)
    settings = TrackerSettings(profile="vehicle", mount=("+y", "+x", "-z"))
    assert run(headless, recorded.frames, settings)[0] == right


def told_in(day: str, frame: Frame) -> Frame:
    """Let an RMC tell another day."""
    if not frame.data.startswith(b"$GNRMC"):
        return frame
    body = frame.data.decode()[1:].partition("*")[0].replace(",221126,", f",{day},")
    return frame._replace(data=sentence(body))


@pytest.mark.parametrize(
    ("day", "weeks"), [("221126", 0), ("080407", 1024), ("230887", 2048)]
)
def test_live_dates_some_1024_weeks_before_the_release_are_rolled_over(
    day: str, weeks: int
) -> None:
    # The simulation is of the day before the release; so are all three days, by weeks
    # that a receiver may have lost.
    recorded = record("still", 20.0, receiver=IDEAL_RECEIVER)
    header = recorded.header._replace(start_utc_s=None)
    live = Pipeline(header, TrackerSettings(), live=True)
    frames = [told_in(day, frame) for frame in recorded.frames]
    rows = [row for frame in frames for row in live.feed(frame)]
    assert rows[0].utc_s == pytest.approx(START_UTC_S, abs=2.0)
    said = any(f"{weeks} weeks" in notice for notice in live.take_notices())
    assert said == (weeks > 0)


# -------------------------------------------------------------- stillness and walks


def test_a_parked_tracker_does_not_wander() -> None:
    simulated = simulate("still", seed=6, duration_s=900.0, rate_hz=25.0)
    rows, _ = run(simulated.header, simulated.frames)
    late = [row for row in rows if row.utc_s - START_UTC_S > 120.0]
    assert {row.mode for row in late} == {Mode.STILL}
    north = np.array([row.lat_rad for row in late]) * 6.37e6
    east = np.array([row.lon_rad for row in late]) * 6.37e6 * math.cos(late[0].lat_rad)
    # The receiver's own fixes wander by eight metres in this time.
    assert np.ptp(north) < 4.0
    assert np.ptp(east) < 4.0
    steps_m = np.hypot(np.diff(north), np.diff(east))
    assert steps_m.max() < 0.1
    assert steps_m.sum() < 20.0  # its fixes go hundreds of metres
    figures = compare(rows, simulate("still", seed=6, duration_s=900.0).truth, 120.0)
    assert figures.inside > 0.95


@pytest.mark.parametrize("gps_every_s", [1.0, 3.0, 5.0])
@pytest.mark.parametrize("scenario", ["walk-line", "walk-square", "roundabout"])
def test_the_walks_stay_within_five_metres(scenario: str, gps_every_s: float) -> None:
    assert_walk(scenario, gps_every_s, seed=0)


@pytest.mark.acceptance
@pytest.mark.parametrize("seed", range(1, 11))
@pytest.mark.parametrize("gps_every_s", [1.0, 3.0, 5.0])
@pytest.mark.parametrize("scenario", ["walk-line", "walk-square", "roundabout"])
def test_the_walks_stay_within_five_metres_whatever_the_seed(
    scenario: str, gps_every_s: float, seed: int
) -> None:
    assert_walk(scenario, gps_every_s, seed)


def assert_walk(scenario: str, gps_every_s: float, seed: int) -> None:
    simulated = simulate(scenario, seed=seed, gps_every_s=gps_every_s)
    rows, _ = run(simulated.header, simulated.frames)
    assert_no_hole(rows)
    figures = compare(rows, simulated.truth, warm_up_s=0.0)
    assert figures.rms < 5.0
    assert figures.inside > 0.75  # one walk is hardly more than one error of a receiver


@pytest.mark.acceptance
def test_hours_of_parking_do_not_wander() -> None:
    simulated = simulate(
        "still", seed=2, duration_s=6 * 3600.0, rate_hz=10.0, gps_every_s=10.0
    )
    rows = run(simulated.header, simulated.frames)[0][4 * 1800 :]
    assert {row.mode for row in rows} == {Mode.STILL}
    east = math.cos(rows[0].lat_rad)
    assert np.ptp([row.lat_rad for row in rows]) * 6.37e6 < 4.0
    assert np.ptp([row.lon_rad for row in rows]) * 6.37e6 * east < 4.0
    assert rows[-1].r95_m < 6.0


def test_pipelines_need_only_a_few_frames_to_say_nothing(drive: Recorded) -> None:
    pipeline = Pipeline(drive.header, TrackerSettings())
    for frame in islice(drive.frames, 50):
        assert pipeline.feed(frame) == []
