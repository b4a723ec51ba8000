"""Runs a cell of the table and judges it."""

import logging
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from faults import sentences
from faults.bench import Bench, Result
from faults.drives import FIRST_FIX_S, LENGTH_S, S, Said, clock_ns
from faults.table import AT_S, HIDDEN_S, Fault, Phase
from imu_tracker import pipeline
from imu_tracker.storage.latlong import read_log

INSIDE: Final = 0.95
LATEST_ROW_S: Final = 0.5
GAP_S: Final = 0.15
"""Samples come each 54 ms, so many at a time."""

UTC_TOLERANCE_S: Final = 0.3
"""The latency is configured and not what the receiver's is, and it jitters."""

MOST_LINES: Final = 30
"""Of the journal: one for each transition, none for each sample, fix or retry."""

EARLIER: Final = "2026-01-01"  # than the day of the simulation, which is no rollover


class Cell(NamedTuple):
    """What came out; `back_s` is how long it took to recover."""

    back_s: float | None
    inside: float
    complaints: list[str]


def run(fault: Fault, phase: Phase, *options: str) -> Cell:
    """Run the daemon through a fault in a phase."""
    with (
        pytest.MonkeyPatch.context() as patch,
        tempfile.TemporaryDirectory(prefix="faults-") as directory,
    ):
        patch.setattr(pipeline, "RELEASE_DATE", EARLIER)
        at_s = AT_S[phase]

        def say(lines: list[Said]) -> list[Said]:
            if phase is Phase.OUTAGE:
                lines = sentences.without(lines, *HIDDEN_S)
            return fault.say(lines, at_s) if fault.say else lines

        bench = Bench(Path(directory), patch, say=say, **fault.bench)
        if fault.strike is not None:
            fault.strike(bench, at_s)
        lasts_s = 0.0 if fault.lasts_s > LENGTH_S else fault.lasts_s
        end_s = at_s + lasts_s + fault.for_s
        end_s = max(end_s, HIDDEN_S[1] + 8) if phase is Phase.OUTAGE else end_s
        result = bench.run(min(end_s, LENGTH_S - 1), *options)
        patch.undo()
        return judge(fault, at_s, bench, result)


def judge(fault: Fault, at_s: float, bench: Bench, result: Result) -> Cell:
    """Compare what the daemon did with what it must do."""
    found: list[str] = []

    def expect(is_so: bool, complaint: str) -> None:
        if not is_so:
            found.append(complaint)

    expect(result.exit_code == 0, f"ended with {result.exit_code}")
    rows = result.rows
    if not rows:
        return Cell(None, 0.0, [*found, "no rows"])
    expect(rows[0].at_s < at_s + 16 + FIRST_FIX_S, f"rows begin at {rows[0].at_s}")
    steps = {round(new.state.utc_s - old.state.utc_s, 3) for old, new in pairwise(rows)}
    # A correction of UTC that lasts may leave one hole, or go back once.
    holes = [step for step in steps if step != 0.25]
    is_lasting = fault.moves_time and fault.lasts_s > LENGTH_S
    may_leap = is_lasting and len(holes) == 1 and not -60.0 <= holes[0] <= 5.0
    expect(not holes or may_leap, f"steps of the rows: {steps}")
    latest_s = max(row.at_s - (row.state.t_ns - clock_ns(0)) / S for row in rows)
    expect(fault.is_late or latest_s <= LATEST_ROW_S, f"a row is {latest_s} s late")
    if not fault.moves_time:
        error_s = max(abs(bench.utc_error_s(row.state)) for row in rows)
        expect(error_s <= UTC_TOLERANCE_S, f"UTC is {error_s} s off")
    later = result.between(at_s, LENGTH_S)
    inside = sum(row.is_true for row in later) / max(len(later), 1)
    expect(not fault.is_true or inside >= INSIDE, f"r95 holds {inside:.1%}")
    expect(len(result.journal) <= MOST_LINES, f"{len(result.journal)} lines told")
    expect(
        all(line.level < logging.ERROR for line in result.journal), "an error was told"
    )
    expect(not result.said("is not kept"), "what was learnt is not kept")
    fed_s = [b - a for a, b in pairwise(result.fed_s)]
    expect(max(fed_s) <= 1.1 + 1.2 * fault.is_late, f"fed after {max(fed_s)} s")
    for name in fault.counters:
        expect(result.counters.get(name, 0) > 0, f"{name} is not counted")
    if fault.says:
        times = len(result.said(fault.says, at_s))
        expect(times == 1, f"{fault.says!r} was told {times} times")
    if fault.mode:
        modes = {row.mode for row in later}
        expect(fault.mode in modes, f"modes are {modes}")
    found += _missing(fault, at_s, result)
    back_s = _back_s(fault, at_s, bench, result)
    if fault.back:
        expect(back_s is not None, f"{fault.back} is not back")
        expect(
            back_s is None or back_s <= fault.within_s,
            f"{fault.back} is back after {back_s} s, not {fault.within_s} s",
        )
    return Cell(back_s, inside, found)


def _missing(fault: Fault, at_s: float, result: Result) -> list[str]:
    """Look for the rows in the file; nothing of after `lost_s` may be missing."""
    aside = result.log.parent.glob(f"{result.log.stem}-*.csv*")
    logs = [read_log(path) for path in (result.log, *aside)]
    kept = {round(utc_s * 1000) for log in logs for utc_s in log.utc_s}
    spared_ns = clock_ns(at_s + fault.lost_s) if fault.lost_s else clock_ns(0)
    told = {
        round(row.state.utc_s * 1000)
        for row in result.rows
        if row.state.t_ns >= spared_ns
    }
    lost = len(told - kept)
    return [f"{lost} rows are lost"] if lost else []


def _back_s(fault: Fault, at_s: float, bench: Bench, result: Result) -> float | None:
    """Return how long after the end of the fault a sensor was of use again."""
    end_s = at_s + fault.lasts_s
    if fault.back == "gps":
        # From the last byte of the first epoch that is good again.
        first = next(e for e in bench.line.epochs_s if e[0] >= end_s)
        used = next((t_s for t_s in result.used_s if t_s >= first[0]), None)
        return None if used is None else max(0.0, used - first[1])
    if fault.back == "imu":
        samples_s = [*result.samples_s, result.rows[-1].at_s]
        gaps = [b for a, b in pairwise(samples_s) if b - a > GAP_S and b > at_s]
        told = [
            line.at_s
            for word in ("imu reset", "move again", "any more")
            for line in result.said(word, at_s)
        ]
        if gaps and gaps[-1] == samples_s[-1]:
            return None
        return max(0.0, max([end_s, *gaps, *told]) - end_s)
    return None
