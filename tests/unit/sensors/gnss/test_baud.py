"""The search for the speed of the line."""

from itertools import groupby

from imu_tracker.sensors.gnss.baud import BAUDS, BaudSearch

S = 1_000_000_000


def hear(search: BaudSearch, start_s: float, seconds: float, sentences: int) -> int:
    """Let bytes come each 0.1 s, the sentences once a second; count changes."""
    changes = 0
    for step in range(round(seconds * 10)):
        now_ns = round((start_s + step / 10) * S)
        changes += search.add_bytes(now_ns, sentences if step % 10 == 5 else 0)
    return changes


def test_all_speeds_take_their_turn() -> None:
    search = BaudSearch(9600, 0)
    heard = []
    for second in range(20):
        hear(search, second, 1, 0)
        heard.append(search.baud)
    turns = [baud for baud, _ in groupby(heard)]
    assert turns[: len(BAUDS) + 1] == [*BAUDS, BAUDS[0]]


def test_two_sentences_settle_it() -> None:
    search = BaudSearch(38400, 0)
    assert hear(search, 0, 1, 1) == 0
    assert not search.is_found
    assert hear(search, 1, 60, 1) == 0
    assert (search.baud, search.is_found) == (38400, True)


def test_one_sentence_is_chance() -> None:
    search = BaudSearch(38400, 0)
    search.add_bytes(0, 1)
    assert hear(search, 0, 2.5, 0) == 1


def test_a_speed_that_was_right_gets_longer() -> None:
    search = BaudSearch(9600, 0)
    hear(search, 0, 3, 2)
    assert hear(search, 3, 6, 0) == 0
    assert hear(search, 9, 2, 0) == 1
    assert not search.is_found


def test_after_silence_the_patience_begins_anew() -> None:
    search = BaudSearch(9600, 0)
    hear(search, 0, 3, 2)
    assert search.add_bytes(600 * S, 0) is False
    assert search.is_found


def test_a_fixed_speed_stays() -> None:
    search = BaudSearch(12345, 0, is_fixed=True)
    assert hear(search, 0, 60, 0) == 0
    assert (search.baud, search.is_found) == (12345, True)


def test_a_speed_of_no_table_leads_into_it() -> None:
    search = BaudSearch(12345, 0)
    assert hear(search, 0, 2.5, 0) == 1
    assert search.baud == BAUDS[0]


def garbled(search: BaudSearch, start_s: float, seconds: int) -> list[int]:
    """Let a burst of garbage come each second, and a pause; list the speeds."""
    turns = []
    for second in range(seconds):
        now_ns = round((start_s + second) * S)
        assert not search.add_bytes(now_ns, 0), "in the midst of a burst"
        search.pause(now_ns + S // 2)
        turns.append(search.baud)
    return turns


def test_between_bursts_the_speed_that_was_right_gets_every_other_turn() -> None:
    search = BaudSearch(38400, 0)
    hear(search, 0, 3, 2)
    turns = garbled(search, 3, 25)
    changed = turns[turns.index(115200) :]
    assert 3 <= len(turns) - len(changed) <= 6
    assert set(changed[1::2]) == {38400}
    others = [115200, 4800, 57600, 19200, 230400, 460800, 921600, 9600]
    assert changed[: 2 * len(others) : 2] == others


def test_one_sentence_is_enough_to_stay_for_another() -> None:
    search = BaudSearch(9600, 0, known=9600)
    search.add_bytes(S, 1)
    assert not search.pause(S + S // 2)
    search.add_bytes(2 * S, 1)
    assert search.is_found


def test_a_pause_after_silence_changes_nothing() -> None:
    search = BaudSearch(9600, 0)
    hear(search, 0, 3, 2)
    assert not any(search.pause(second * S) for second in range(3, 60))
