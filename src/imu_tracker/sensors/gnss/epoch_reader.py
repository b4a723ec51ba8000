"""Lines of a receiver to fixes: one `GpsFix` for each instant that it describes.

Pure: time arrives with the lines. `lines` cuts the bytes, `sentences` reads one
sentence, `epoch` joins those of one instant, `calendar` knows the day; here is the
order of events. What a newcomer gets wrong: an epoch that waits for the next one makes
every fix a second late.
"""

from collections import Counter, deque
from typing import Final, TypeAlias

from imu_tracker.errors import NmeaError
from imu_tracker.samples import GpsFix, UtcTime
from imu_tracker.sensors.gnss.calendar import DAY_S, ROLLOVER_WEEKS, Calendar
from imu_tracker.sensors.gnss.epoch import EPOCH_NS, Epoch
from imu_tracker.sensors.gnss.lines import LineSplitter
from imu_tracker.sensors.gnss.sentences import (
    TOLD_AFTER,
    Report,
    Unread,
    read_sentence,
    why_unread,
)

__all__ = ["EpochReader", "LineSplitter"]

REMEMBERED_EPOCHS: Final = 4  # two sources on one wire lag each other by a second
MAX_REPORTS: Final = 100  # of one epoch; a wire at 460800 baud could carry 200
_PLACES: Final = frozenset({"RMC", "GGA", "GNS", "GLL"})
MAX_HEADS: Final = 40  # talkers times kinds
FOREIGN_S: Final = 60.0
"""A time without a date that is farther than this from what RMC or ZDA say is of
another zone or source (GLL in local time: signalk-to-nmea0183, issue 96)."""

_NOTICES: Final = {
    "fixes_without_date": "the receiver sends no date: set gps.date",
    "contradictory_epochs": "the receiver's sentences disagree about having a fix",
    "cut_times": (
        "the receiver's times are whole seconds though it sends more fixes: only the "
        "first of each second is used; let it send tenths, or one fix a second"
    ),
}
_DAMAGED: Final = {
    "bad_checksums": (
        "damaged lines (noise, a loose wire, or more sentences than gps.baud carries)"
    ),
    "missing_checksums": "lines without a checksum (cut off, or switched off)",
    "overlong_lines": "lines that are too long",
    "unparsable_lines": "lines that are no sentence",
}
"""Lines of which nothing is believed, by counter."""

Positions: TypeAlias = list[GpsFix | UtcTime]


class EpochReader:
    """Joins sentences to epochs by their time of day, whatever a receiver sends.

    An epoch closes with the kind of sentence that closed the one before, with
    another time of day, or 0.3 s after its first sentence.

    Parameters
    ----------
    reference_utc_s, earliest_utc_s : float, optional
    date : str
        What helps to find the day: see `calendar.Calendar`.

    Attributes
    ----------
    counters : Counter[str]
        `sentences` that are intact, `fixes`, and kinds of trouble: `bad_checksums`,
        `missing_checksums`, `overlong_lines`, `unparsable_lines`, `bad_positions`
        (a fix without a place on earth), `sentences_without_time`, `foreign_times`,
        `cut_times` (whole seconds, and more than one fix in each),
        `late_velocities` (after their epoch: the baud rate is low for so many
        sentences), `epochs_without_fix`, `contradictory_epochs`, `undecided_epochs`
        (among those without fix), `repeated_epochs`, `fixes_without_date`.
    unread, damaged : Unread
        Why sentences of a fix, and why lines, could not be used.
    """

    def __init__(
        self,
        *,
        reference_utc_s: float | None = None,
        date: str = "",
        earliest_utc_s: float | None = None,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self.unread, self.damaged = Unread(), Unread()
        self._calendar = Calendar(
            reference_utc_s=reference_utc_s, day=date, earliest_utc_s=earliest_utc_s
        )
        self._epoch: Epoch | None = None  # the last one, open or closed
        self._closer = ""  # the kind of sentence that closes an epoch
        self._ahead: dict[str, tuple[int, Report]] = {}  # came before their epoch
        self._given: deque[float] = deque(maxlen=REMEMBERED_EPOCHS)
        self._has_fix = False  # the last closed epoch's
        self._undecided_line = b""  # the last one with a position and no verdict
        self._said: tuple[int, float] | None = None  # by RMC or ZDA: t_ns, utc_s
        self._places: dict[bytes, Report] = {}  # the last of each head, like $GPRMC
        self._notices: dict[str, bool] = {}  # all that was said, and whether taken

    def feed(self, t_ns: int, line: bytes) -> Positions:
        """Take a line whose first byte arrived at `t_ns`; return what is complete."""
        positions = self.advance(t_ns)
        try:
            report = read_sentence(line)
        except NmeaError as error:
            self.counters[error.trouble] += 1
            self.damaged.add("", _DAMAGED[error.trouble], line)
            return positions
        self.counters["sentences"] += 1
        if report is not None and self._is_sound(t_ns, report, line):
            positions += self._take(t_ns, report)
        return positions

    def _is_sound(self, t_ns: int, report: Report, line: bytes) -> bool:
        """Count what is wrong with a sentence; return whether it is used at all."""
        if report.kind not in _PLACES:
            return True
        if report.has_fix and report.lat_lon_rad is None:
            self.counters["bad_positions"] += 1
            self.unread.add(*why_unread(line), line)
        elif report.has_fix and report.tod_s is None:
            self.unread.add(*why_unread(line), line)
        elif report.has_fix is None and report.lat_lon_rad is not None:
            self._undecided_line = line
        if report.tod_s is None:
            return True
        off_s = self._off_s(t_ns, report)
        if abs(off_s) > FOREIGN_S:
            self.counters["foreign_times"] += 1
            what = f"is {off_s:+.0f} s off that of RMC or ZDA: local time?"
            self.unread.add(f"{report.kind}: time", what, line)
            return False
        self._note_cut_times(report, line[line.rfind(b"$") :][:6])
        return True

    def _off_s(self, t_ns: int, report: Report) -> float:
        """Return how far a time without a date is from what the dated ones say."""
        if report.sent_utc_s is not None or self._said is None:
            return 0.0
        said_ns, utc_s = self._said
        assert report.tod_s is not None
        expected_s = utc_s + (t_ns - said_ns) * 1e-9
        return (report.tod_s - expected_s + DAY_S / 2) % DAY_S - DAY_S / 2

    def _note_cut_times(self, report: Report, head: bytes) -> None:
        """Count another place at the same whole second, by the same kind."""
        last = self._places.get(head)
        if (
            last is not None
            and last.tod_s == report.tod_s
            and last.tod_s is not None
            and last.tod_s % 1.0 == 0.0
            and report.lat_lon_rad not in (None, last.lat_lon_rad)
        ):
            self._count("cut_times")
        if len(self._places) >= MAX_HEADS:
            self._places.clear()
        self._places[head] = report

    def advance(self, t_ns: int) -> Positions:
        """Note that stream time moved on; return what is complete by that."""
        self._calendar.begin(t_ns)
        epoch = self._epoch
        if epoch is None or not epoch.is_open or epoch.is_young(t_ns):
            return []
        return self._close(epoch)

    @property
    def closes_ns(self) -> int | None:
        """When time alone completes something; None: `advance` can wait."""
        epoch = self._epoch
        return epoch.t_ns + EPOCH_NS if epoch is not None and epoch.is_open else None

    def take_notices(self) -> list[str]:
        """Return what a person should know; each is said once."""
        untold = [text for text, is_told in self._notices.items() if not is_told]
        self._notices.update(dict.fromkeys(untold, True))
        return untold + self.unread.take_notices() + self.damaged.take_notices()

    def _take(self, t_ns: int, report: Report) -> Positions:
        self._learn_date(t_ns, report)
        if report.kind in _PLACES and report.tod_s is None:
            self.counters["sentences_without_time"] += 1
            return []
        epoch = self._epoch
        if report.kind == "GSA":  # one for each constellation; it opens and closes none
            if epoch is not None and epoch.is_open:
                epoch.reports += [report][: MAX_REPORTS - len(epoch.reports)]
            return []
        if epoch is not None and epoch.owns(t_ns, report):
            return self._join(t_ns, epoch, report)
        if report.kind == "ZDA":
            return [] if self._has_fix else self._utc_time(t_ns, report.tod_s)
        if report.kind in _PLACES and report.tod_s is not None:
            return self._open(t_ns, report.tod_s, report)
        self._ahead[report.kind] = t_ns, report
        return []

    def _open(self, t_ns: int, tod_s: float, report: Report) -> Positions:
        """Begin the epoch of a sentence, with those that came just ahead of it."""
        positions = self._close(self._epoch) if self._epoch is not None else []
        ahead = [
            (early_t_ns, early)
            for early_t_ns, early in self._ahead.values()
            if early.tod_s in (None, tod_s) and t_ns - early_t_ns < EPOCH_NS
        ]
        self._ahead.clear()
        self._epoch = Epoch(
            min([t_ns, *(early_t_ns for early_t_ns, _ in ahead)]), tod_s
        )
        self._epoch.reports += (early for _, early in ahead)
        return positions + self._join(t_ns, self._epoch, report)

    def _join(self, t_ns: int, epoch: Epoch, report: Report) -> Positions:
        if report.kind == "ZDA":  # a date, which is learnt already, and no position
            return []
        if epoch.is_open:
            if len(epoch.reports) < MAX_REPORTS:
                epoch.reports.append(report)
            return self._close(epoch) if report.kind == self._closer else []
        if epoch.is_young(t_ns):
            self._closer = report.kind  # so the next one waits for it
        elif report.vel_ne_mps is not None and not epoch.has_velocity:
            self.counters["late_velocities"] += 1
        return []

    def _close(self, epoch: Epoch) -> Positions:
        if not epoch.is_open:
            return []
        epoch.is_open = False
        self._closer = [r.kind for r in epoch.reports if r.kind != "GSA"][-1]
        verdicts = epoch.verdicts()
        fix = epoch.fix() if verdicts == {True} else None
        self._has_fix = fix is not None
        if fix is None:
            kind = "contradictory_epochs" if len(verdicts) > 1 else "epochs_without_fix"
            self._count(kind)
            if not verdicts and epoch.fix() is not None:
                self.counters["undecided_epochs"] += 1
                self.unread.add(*why_unread(self._undecided_line), self._undecided_line)
            return self._utc_time(epoch.t_ns, epoch.tod_s)
        if epoch.tod_s in self._given:
            self.counters["repeated_epochs"] += 1
            return []
        self._given.append(epoch.tod_s)
        self.counters["fixes"] += 1
        return [self._dated(fix, epoch.tod_s)]

    def _dated(self, fix: GpsFix, tod_s: float) -> GpsFix:
        utc_s = self._calendar.utc_s(fix.t_ns, tod_s)
        if utc_s is None:
            self._count("fixes_without_date")
        return fix._replace(utc_s=utc_s)

    def _count(self, kind: str) -> None:
        """Count an epoch; when a kind that a person should know of persists, say so."""
        self.counters[kind] += 1
        if self.counters[kind] == TOLD_AFTER and kind in _NOTICES:
            self._notices[_NOTICES[kind]] = False

    def _utc_time(self, t_ns: int, tod_s: float | None) -> Positions:
        if tod_s is None or not self._calendar.is_known:
            return []
        utc_s = self._calendar.utc_s(t_ns, tod_s)
        return [] if utc_s is None else [UtcTime(t_ns, utc_s)]

    def _learn_date(self, t_ns: int, report: Report) -> None:
        if report.sent_utc_s is None:
            return
        self._said = t_ns, report.sent_utc_s
        self._calendar.learn(t_ns, report.sent_utc_s, is_sure=report.has_fix is True)
        if weeks := self._calendar.rollovers * ROLLOVER_WEEKS:
            self._notices.setdefault(
                f"the receiver's dates lie {weeks} weeks back; corrected", False
            )
