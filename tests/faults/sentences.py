"""What a receiver says, changed: by the field order of NMEA 0183, for RMC and GGA."""

from collections.abc import Callable, Iterable
from datetime import date, timedelta
from functools import reduce
from operator import xor
from typing import Final

from faults.drives import Said, clock_ns

METRES_PER_DEG: Final = 111_200.0

# Where RMC and GGA have their fields.
_TIME = 1
_LAT: Final = {b"RMC": 3, b"GGA": 2}
_RMC_KNOTS, _RMC_COURSE, _RMC_DATE = 7, 8, 9

Change = Callable[[list[bytes], float], list[bytes]]


def changed(
    lines: Iterable[Said], start_s: float, end_s: float, change: Change
) -> list[Said]:
    """Return the lines with the fields of some seconds changed, checksum and all.

    `change` gets the fields, from the address on, and the seconds since `start_s`.
    """
    return [
        Said(t_ns, _written(change(_fields(line), (t_ns - clock_ns(start_s)) / 1e9)))
        if clock_ns(start_s) <= t_ns < clock_ns(end_s)
        else Said(t_ns, line)
        for t_ns, line in lines
    ]


def without(lines: Iterable[Said], start_s: float, end_s: float) -> list[Said]:
    """Return the lines but those of some seconds."""
    first, end = clock_ns(start_s), clock_ns(end_s)
    return [said for said in lines if not first <= said.t_ns < end]


def no_fix(fields: list[bytes], _: float) -> list[bytes]:
    """Know the time and no place."""
    kind = fields[0][2:]
    blank = [b""] * 4
    if kind == b"RMC":
        empty = [fields[0], fields[_TIME], b"V", *blank, b"", b""]
        return [*empty, fields[_RMC_DATE], b"", b"", b"N"]
    return [fields[0], fields[_TIME], *blank, b"0", b"00", b"99.99"] + [b""] * 6


def null_island(fields: list[bytes], _: float) -> list[bytes]:
    """Claim a fix at 0 N 0 E."""
    return _placed(fields, b"0000.00000", b"N", b"00000.00000", b"E")


def moved_north(metres_at: Callable[[float], float]) -> Change:
    """Be so many metres further north, by the seconds since it began."""

    def change(fields: list[bytes], since_s: float) -> list[bytes]:
        at = _LAT[fields[0][2:]]
        if not fields[at]:
            return fields
        minutes = float(fields[at][:2]) * 60.0 + float(fields[at][2:])
        minutes += metres_at(since_s) / METRES_PER_DEG * 60.0
        text = b"%02d%08.5f" % (minutes // 60, minutes % 60)
        return _placed(fields, text, *fields[at + 1 : at + 4])

    return change


def dated(days: int) -> Change:
    """Say another date."""

    def change(fields: list[bytes], _: float) -> list[bytes]:
        if fields[0].endswith(b"RMC") and fields[_RMC_DATE]:
            day, month, year = (int(fields[_RMC_DATE][i : i + 2]) for i in (0, 2, 4))
            told = date(2000 + year, month, day) + timedelta(days=days)
            fields = [*fields]
            fields[_RMC_DATE] = f"{told:%d%m%y}".encode()
        return fields

    return change


def timed(seconds: int) -> Change:
    """Say another time of day."""

    def change(fields: list[bytes], _: float) -> list[bytes]:
        if not fields[_TIME]:
            return fields
        time = fields[_TIME]
        total = int(time[:2]) * 3600 + int(time[2:4]) * 60 + int(time[4:6]) + seconds
        fields = [*fields]
        clock = total // 3600 % 24, total // 60 % 60, total % 60
        fields[_TIME] = b"%02d%02d%02d" % clock + time[6:]
        return fields

    return change


def status_d(fields: list[bytes], _: float) -> list[bytes]:
    """Say D for A in RMC, as Unicore receivers do once corrections arrive."""
    if fields[0].endswith(b"RMC") and fields[2] == b"A":
        fields = [*fields[:2], b"D", *fields[3:]]
    return fields


def signed_longitude(fields: list[bytes], _: float) -> list[bytes]:
    """Write the longitude with a sign, as some relays do."""
    at = _LAT[fields[0][2:]] + 2
    return [*fields[:at], b"-" + fields[at], *fields[at + 1 :]]


def frozen() -> Change:
    """Repeat the first place, and let time and speed run on."""
    first: dict[bytes, list[bytes]] = {}

    def change(fields: list[bytes], _: float) -> list[bytes]:
        at = _LAT[fields[0][2:]]
        place = first.setdefault(fields[0], fields[at : at + 4])
        return _placed(fields, *place)

    return change


def with_local_gll(lines: Iterable[Said]) -> list[Said]:
    """Add a GLL behind each GGA, two hours ahead: a zone for UTC."""
    found = []
    for said in lines:
        found.append(said)
        fields = _fields(said.line)
        if fields[0].endswith(b"GGA"):
            (ahead,) = changed([said], 0.0, 1e6, timed(7200))
            tod = _fields(ahead.line)[_TIME]
            gll = [b"GNGLL", *fields[2:6], tod, b"A", b"A"]
            found.append(Said(said.t_ns + 1, _written(gll)))
    return found


def epochs(lines: Iterable[Said]) -> list[list[Said]]:
    """Return the lines by the epoch that they describe."""
    found: list[list[Said]] = []
    for said in lines:
        if said.line[3:6] == b"RMC" or not found:
            found.append([])
        found[-1].append(said)
    return found


def _placed(fields: list[bytes], *place: bytes) -> list[bytes]:
    at = _LAT[fields[0][2:]]
    if not fields[at]:
        return fields
    return [*fields[:at], *place, *fields[at + 4 :]]


def _fields(line: bytes) -> list[bytes]:
    return line[1 : line.index(b"*")].split(b",")


def _written(fields: list[bytes]) -> bytes:
    body = b",".join(fields)
    return b"$%s*%02X" % (body, reduce(xor, body))


def drawn_north(speed_mps: float) -> Change:
    """Forge places and velocity alike: a body that goes north, from standing."""
    knots = b"%.2f" % (speed_mps * 3600.0 / 1852.0)
    move = moved_north(lambda since_s: speed_mps * since_s)

    def change(fields: list[bytes], since_s: float) -> list[bytes]:
        fields = move(fields, since_s)
        if fields[0].endswith(b"RMC"):
            fields = [*fields]
            fields[_RMC_KNOTS], fields[_RMC_COURSE] = knots, b"0.0"
        return fields

    return change
