"""What the lines of the receiver say of it: sentences, wire, delays, satellites."""

import itertools
import math
from collections import Counter
from statistics import median
from typing import Final, NamedTuple

from imu_tracker.errors import NmeaError
from imu_tracker.report.measures.series import Series
from imu_tracker.samples import GpsFix, SessionHeader, UtcTime
from imu_tracker.sensors.gnss.epoch_reader import EpochReader
from imu_tracker.sensors.gnss.lines import checked_text

BAUDS: Final = (4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
BITS: Final = 10  # of a character, with start and stop
CR_LF: Final = 2
BEST: Final = 4
"""So many satellites make a fix: the signal of the strongest ones counts."""

SLOWEST_FIX_S: Final = 5.0
JUMP_MPS2: Final = 15.0
"""A place that asks for more acceleration from fix to fix is a jump of the receiver."""
JUMP_SIGMAS: Final = 6.0
METRES_PER_RAD: Final = 6.37e6


class ReceiverFigures(NamedTuple):
    """What was measured; NaN where there was nothing to measure it on."""

    lines: int
    kinds: dict[str, int]
    counters: Counter[str]
    unread: str  # why sentences of a fix could not be used
    fixes: int
    epochs: int
    interval_s: float
    longest_gap_s: float
    short_losses: int  # shorter than a tunnel
    first_fix_s: float
    lateness_s: float  # how far the delay spreads: 95th percentile above the least
    lateness_growth_s: float  # from the first to the last tenth
    baud: int | None
    busy_share: float  # of the wire's time
    missed_share: float  # of the epochs that its own rhythm promises
    satellites: float
    hdop: float
    signal_dbhz: float
    has_velocity: bool
    jumps: int
    sigma_m: float


class ReceiverLog:
    """Takes lines as they come.

    Attributes
    ----------
    satellites, signal : Series
        For charts: number used, dB-Hz of the strongest four.
    speeds : list of (t_s, m/s)
        Of the fixes that have one.
    """

    def __init__(self) -> None:
        self.satellites, self.signal = Series(), Series()
        self.speeds: list[tuple[float, float]] = []
        self._reader = EpochReader()
        self._counters: Counter[str] = Counter()
        self._unread = ""
        self._kinds: Counter[str] = Counter()
        self._n_lines = self._bytes = self._jumps = 0
        self._first_s = self._last_s = math.nan
        self._line: tuple[int, int] | None = None
        self._bauds: list[float] = []
        self._used: list[int] = []
        self._hdops: list[float] = []
        self._view: dict[str, list[int]] = {}
        self._signals: list[float] = []
        self._last: GpsFix | None = None
        self._fix_s: list[float] = []
        self._steps_s: list[float] = []
        self._offsets_s: list[float] = []  # of this session's clock
        self._late_s: list[float] = []  # of the sessions that are over
        self._sigmas_m: list[float] = []
        self._velocities = 0

    def begin(self, header: SessionHeader) -> None:
        """Begin a session."""
        self._end_session()
        self._reader = EpochReader(reference_utc_s=header.start_utc_s)
        self._line = self._last = None

    def add(self, t_s: float, t_ns: int, line: bytes) -> list[GpsFix]:
        """Take a line; return the fixes that it completes."""
        fixes = self._fixes(t_s, self._reader.feed(t_ns, line))
        self._measure_wire(t_s, t_ns, line)
        try:
            text = checked_text(line)
        except NmeaError:
            return fixes
        kind, *fields = text.split(",")
        self._kinds[kind[2:]] += 1
        if kind.endswith("GGA") and len(fields) > 7:
            self._add_geometry(t_s, fields[5], fields[6], fields[7])
        elif kind.endswith("GSV"):
            self._add_view(t_s, kind, fields)
        return fixes

    def advance(self, t_s: float, t_ns: int) -> list[GpsFix]:
        """Let time pass; return the fixes that it completes."""
        closes_ns = self._reader.closes_ns
        if closes_ns is None or closes_ns > t_ns:
            return []
        return self._fixes(t_s, self._reader.advance(t_ns))

    def figures(self) -> ReceiverFigures:
        """Measure."""
        self._end_session()
        period_s = median(self._steps_s) if self._steps_s else math.nan
        baud = self._baud()
        heard_s = max(self._last_s - self._first_s, 1.0) if self._n_lines else 1.0
        epochs = self._counters["fixes"] + self._counters["epochs_without_fix"]
        in_order, late_s = self._late_s, sorted(self._late_s)
        tenth = max(1, len(late_s) // 10)
        return ReceiverFigures(
            lines=self._n_lines,
            kinds=dict(self._kinds.most_common()),
            counters=self._counters,
            unread=self._unread,
            fixes=len(self._fix_s),
            epochs=epochs,
            interval_s=period_s,
            longest_gap_s=max(self._gaps(), default=math.nan),
            short_losses=sum(
                2.5 * max(period_s, 1.0) < gap_s < 30.0 for gap_s in self._gaps()
            ),
            first_fix_s=self._fix_s[0] if self._fix_s else math.nan,
            lateness_s=late_s[int(0.95 * (len(late_s) - 1))] if late_s else math.nan,
            lateness_growth_s=median(in_order[-tenth:]) - median(in_order[:tenth])
            if in_order
            else math.nan,
            baud=baud,
            busy_share=BITS * self._bytes / (baud * heard_s) if baud else math.nan,
            missed_share=self._missed(period_s),
            satellites=median(self._used) if self._used else math.nan,
            hdop=median(self._hdops) if self._hdops else math.nan,
            signal_dbhz=median(self._signals) if self._signals else math.nan,
            has_velocity=self._velocities > 0.5 * len(self._fix_s),
            jumps=self._jumps,
            sigma_m=median(self._sigmas_m) if self._sigmas_m else math.nan,
        )

    def _end_session(self) -> None:
        self._counters += self._reader.counters
        self._unread = self._reader.unread.worst() or self._unread
        least_s = min(self._offsets_s, default=0.0)
        self._late_s += (offset_s - least_s for offset_s in self._offsets_s)
        self._offsets_s = []

    def _fixes(self, t_s: float, positions: list[GpsFix | UtcTime]) -> list[GpsFix]:
        fixes = [fix for fix in positions if isinstance(fix, GpsFix)]
        for fix in fixes:
            self._add_fix(t_s, fix)
        return fixes

    def _add_fix(self, t_s: float, fix: GpsFix) -> None:
        self._sigmas_m.append(fix.sigma_h_m)
        if fix.vel_ne_mps is not None:
            self._velocities += 1
            self.speeds.append((t_s, math.hypot(*fix.vel_ne_mps)))
        self._fix_s.append(t_s)
        last, self._last = self._last, fix
        if fix.utc_s is None:
            return
        self._offsets_s.append(fix.t_ns * 1e-9 - fix.utc_s)
        if last is None or last.utc_s is None:
            return
        step_s = fix.utc_s - last.utc_s
        if not 0.0 < step_s <= SLOWEST_FIX_S:
            return
        self._steps_s.append(step_s)
        if last.vel_ne_mps is not None and fix.vel_ne_mps is not None:
            north = METRES_PER_RAD * (fix.lat_rad - last.lat_rad)
            east = METRES_PER_RAD * math.cos(fix.lat_rad) * (fix.lon_rad - last.lon_rad)
            half_s = 0.5 * step_s
            off_m = math.hypot(
                north - half_s * (last.vel_ne_mps[0] + fix.vel_ne_mps[0]),
                east - half_s * (last.vel_ne_mps[1] + fix.vel_ne_mps[1]),
            )
            limit_m = JUMP_SIGMAS * fix.sigma_h_m + JUMP_MPS2 * step_s**2
            self._jumps += off_m > limit_m

    def _gaps(self) -> list[float]:
        return [after - before for before, after in itertools.pairwise(self._fix_s)]

    def _missed(self, period_s: float) -> float:
        """Share of the epochs that are missing between two fixes close together."""
        if not self._steps_s or not period_s > 0.0:
            return math.nan
        due = sum(max(1, round(step_s / period_s)) for step_s in self._steps_s)
        return 1.0 - len(self._steps_s) / due

    def _measure_wire(self, t_s: float, t_ns: int, line: bytes) -> None:
        size = len(line) + CR_LF
        self._n_lines += 1
        self._bytes += size
        if math.isnan(self._first_s):
            self._first_s = t_s
        self._last_s = t_s
        before, self._line = self._line, (t_ns, size)
        if before is None:
            return
        took_s = (t_ns - before[0]) * 1e-9
        if 0.0 < took_s < 1.0:
            self._bauds.append(BITS * before[1] / took_s)

    def _baud(self) -> int | None:
        """Speed of the wire, by lines that follow one another without a pause.

        Lines that were read in one piece carry one time, and tell nothing.
        """
        if len(self._bauds) < 20:
            return None
        fastest = sorted(self._bauds)[int(0.7 * len(self._bauds))]
        near = min(BAUDS, key=lambda baud: abs(math.log(baud / fastest)))
        return near if abs(fastest / near - 1.0) < 0.06 else None

    def _add_geometry(self, t_s: float, quality: str, used: str, hdop: str) -> None:
        if used.isdigit():
            self._used.append(int(used))
            self.satellites.add(t_s, int(used))
        try:
            value = float(hdop)
        except ValueError:
            return
        if quality not in ("", "0") and 0.0 < value < 90.0:
            self._hdops.append(value)

    def _add_view(self, t_s: float, kind: str, fields: list[str]) -> None:
        """Take satellites in view: four fields each, the last one the signal."""
        if len(fields) < 3:
            return
        if fields[1] == "1":
            self._view[kind] = []
        signals = [int(text) for text in fields[6::4] if text.isdigit() and int(text)]
        view = self._view.setdefault(kind, [])
        view += signals
        if fields[0] == fields[1]:
            strongest = sorted(s for v in self._view.values() for s in v)[-BEST:]
            if len(strongest) == BEST:
                mean = sum(strongest) / BEST
                self._signals.append(mean)
                self.signal.add(t_s, mean)
