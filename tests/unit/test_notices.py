"""What repeats is told less often, and what flaps counts as away."""

from imu_tracker.notices import BURST, Flapping, HoldOff

S = 1_000_000_000


def told(*moments: tuple[float, str], until_s: float = 0.0) -> list[tuple[float, str]]:
    """Return what is told and when, looked at each tenth of a second."""
    hold_off, said = HoldOff(), []
    end_s = max(until_s, moments[-1][0])
    for tick in range(round(end_s * 10) + 1):
        now = [text for at_s, text in moments if round(at_s * 10) == tick]
        lines = hold_off.pass_on(tick * S // 10, now)
        said += [(tick / 10, line) for line in lines]
    return said


def test_what_happens_now_and_then_is_told_at_once() -> None:
    moments = [(float(s), "GPS lost") for s in range(0, 600, 25)]
    assert told(*moments) == moments


def test_a_flood_is_told_three_times_and_then_once_a_minute_with_its_count() -> None:
    flood = [(k / 2, "imu lost") for k in range(360)]  # 2 Hz for 180 s
    said = told(*flood, until_s=300.0)
    assert said[:BURST] == flood[:BURST]
    counts = [text for _, text in said[BURST:]]
    assert counts[0] == "imu lost (120 times in the last minute)"
    assert len(said) == BURST + 3
    assert counts[-1].startswith("imu lost (11")


def test_after_a_calm_minute_it_is_told_at_once_again() -> None:
    flood = [(k / 2, "imu lost") for k in range(120)]
    later = [(200.0, "imu lost")]
    assert told(*flood, *later)[-1] == (200.0, "imu lost")


def test_of_a_pair_that_flaps_the_state_that_holds_is_told_last() -> None:
    flood = [(k / 2, ("lost", "back")[k % 2]) for k in range(100)]
    said = told(*flood, until_s=200.0)
    assert len(said) == 2 * BURST + 2
    assert said[-2][1].startswith("lost (")
    assert said[-1][1].startswith("back (")


def test_numbers_make_no_difference_and_the_newest_is_told() -> None:
    flood = [(float(k), f"jumped by {k * 0.5:+.1f} s") for k in range(40)]
    said = told(*flood, until_s=100.0)
    assert len(said) == BURST + 1
    assert said[-1][1].startswith("jumped by +19.5 s (37 times")


def test_at_the_end_what_was_held_off_is_told_once() -> None:
    hold_off = HoldOff()
    for k in range(BURST + 4):
        hold_off.pass_on(k * S, ["imu lost"])
    assert hold_off.take_held() == ["imu lost (4 times in the last minute)"]
    assert hold_off.take_held() == []


def test_other_notices_are_not_held_off_by_a_flood() -> None:
    flood = [(k / 10, "imu lost") for k in range(100)]
    assert (5.0, "GPS in use") in told(*flood, (5.0, "GPS in use"))


def test_what_flaps_counts_as_away_until_it_has_stayed() -> None:
    flapping = Flapping()
    seen = {}
    for tick in range(600):
        at_s = tick / 10
        is_there = not (10 <= at_s < 20 and tick % 5 == 0)  # lost twice a second
        seen[at_s] = (is_there, flapping.counts(tick * S // 10, is_there))
    assert all(counts == there for at, (there, counts) in seen.items() if at < 11.0)
    assert not any(counts for at, (_, counts) in seen.items() if 11.0 <= at < 24.4)
    assert all(counts for at, (_, counts) in seen.items() if at > 24.6)


def test_what_is_lost_now_and_then_counts_at_once_again() -> None:
    flapping = Flapping()
    for second in range(300):
        is_there = second % 31 != 30
        assert flapping.counts(second * S, is_there) is is_there
