"""Which rows are sent, and that their line follows the log."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imu_tracker.publish.thinning import LINE_M, Placed, Rules, Thinner
from imu_tracker.storage.latlong import LogRow
from imu_tracker.storage.log_tail import TailPosition
from support.published import drive, row

NOWHERE = TailPosition()
USUAL = Rules()


def thinned(
    rows: list[LogRow], rules: Rules = USUAL, last: LogRow | None = None
) -> list[LogRow]:
    thinner = Thinner(rules, last)
    return [due.row for each in rows for due in thinner.feed(Placed(each, NOWHERE))]


def seconds(rows: list[LogRow]) -> list[float]:
    return [each.utc_s - row(0).utc_s for each in rows]


def test_a_straight_drive_is_a_row_in_ten_seconds() -> None:
    assert seconds(thinned(drive(121))) == [0, 10, 20, 30]


def test_at_rest_it_is_one_in_five_minutes() -> None:
    rows = [row(s / 4, speed_mps=0, mode="still") for s in range(2401)]
    assert seconds(thinned(rows)) == [0, 300, 600]


def test_without_an_imu_a_place_that_does_not_move_counts_as_rest() -> None:
    rows = [
        row(s, speed_mps=0.1, course_deg=math.nan, mode="gpsonly") for s in range(601)
    ]
    assert seconds(thinned(rows)) == [0, 300, 600]


def test_nothing_is_left_out_when_every_row_is_wanted() -> None:
    assert thinned(drive(99), Rules(moving_s=0)) == drive(99)


def test_a_change_of_mode_is_sent_at_once() -> None:
    rows = [row(0), row(0.25), row(0.5, mode="dr"), row(0.75, mode="dr")]
    assert seconds(thinned(rows)) == [0, 0.5]


@pytest.mark.parametrize(
    ("before", "after", "is_sent"),
    [(40.0, 55.0, False), (40.0, 55.1, True), (352.0, 8.0, True), (355.0, 9.0, False)],
)
def test_a_turn_is_sent(before: float, after: float, is_sent: bool) -> None:
    rows = [row(0, course_deg=before), row(1, course_deg=after)]
    assert (len(thinned(rows)) == 2) is is_sent


@pytest.mark.parametrize(
    ("r95_m", "is_sent"), [(2.0, False), (1.99, True), (8.0, False), (8.01, True)]
)
def test_a_radius_that_halved_or_doubled_is_sent(r95_m: float, is_sent: bool) -> None:
    rows = [row(0, r95_m=4.0), row(1, r95_m=r95_m)]
    assert (len(thinned(rows)) == 2) is is_sent


def test_a_corner_is_sent_where_it_is_though_it_has_no_course() -> None:
    # 30 m north, then 30 m east, too slowly for a course: the row before the one whose
    # line would cut the corner by more than 10 m.
    metre = 1 / 111_195.0
    places = [(n, 0) for n in range(31)] + [(30, e) for e in range(1, 31)]
    rows = [
        row(s, lat_deg=n * metre, lon_deg=e * metre, course_deg=math.nan)
        for s, (n, e) in enumerate(places)
    ]
    sent = thinned(rows, Rules(moving_s=1000))
    assert len(sent) == 2
    assert farthest_m(rows, [*sent, rows[-1]]) <= LINE_M + 0.01


def farthest_m(rows: list[LogRow], sent: list[LogRow]) -> float:
    """Return how far rows lie beside the line, beyond their r95, by numpy."""
    scale = 111_195.0 * math.cos(math.radians(rows[0].lat_deg))

    def place(each: LogRow) -> np.ndarray:
        lon_deg = (each.lon_deg - rows[0].lon_deg + 180) % 360 - 180
        return np.array([lon_deg * scale, each.lat_deg * 111_195.0])

    worst = 0.0
    for one, other in pairwise(sent):
        a, b = place(one), place(other)
        length = float(np.linalg.norm(b - a))
        for each in rows:
            if one.utc_s < each.utc_s < other.utc_s:
                along = np.linspace(a, b, max(2, int(length) + 2))
                apart = float(np.linalg.norm(along - place(each), axis=1).min())
                worst = max(worst, apart - max(each.r95_m, LINE_M))
    return worst + LINE_M


steps = st.lists(
    st.tuples(
        st.floats(-6, 6),  # east [m]
        st.floats(-6, 6),  # north [m]
        st.sampled_from([2.0, 3.0, 30.0]),  # r95 [m]
        st.sampled_from([math.nan, 10.0, 50.0]),  # course
    ),
    min_size=2,
    max_size=80,
)


def walk(moves: list[tuple[float, float, float, float]]) -> list[LogRow]:
    rows, east_m, north_m = [], 0.0, 0.0
    for number, (east, north, r95_m, course_deg) in enumerate(moves):
        east_m, north_m = east_m + east, north_m + north
        rows.append(
            row(
                number / 4,
                lat_deg=north_m / 111_195.0,
                lon_deg=(180.0 + east_m / 111_195.0 + 180.0) % 360.0 - 180.0,
                r95_m=r95_m,
                course_deg=course_deg,
            )
        )
    return rows


@settings(max_examples=60)
@given(moves=steps)
def test_each_row_lies_within_its_radius_or_ten_metres_of_what_is_sent(
    moves: list[tuple[float, float, float, float]],
) -> None:
    rows = walk(moves)
    sent = thinned(rows, Rules(moving_s=30, turn_deg=45))
    # The half metre is the step of the comparison, not of the rule.
    assert farthest_m(rows, sent) <= LINE_M + 0.5


@given(moves=steps, cut=st.integers(0, 10_000))
def test_whoever_goes_on_from_a_row_that_was_sent_chooses_the_same_rows(
    moves: list[tuple[float, float, float, float]], cut: int
) -> None:
    rows = walk(moves)
    sent = thinned(rows)
    last = sent[cut % len(sent)]
    rest = [each for each in rows if each.utc_s > last.utc_s]
    assert thinned(rest, last=last) == [s for s in sent if s.utc_s > last.utc_s]
