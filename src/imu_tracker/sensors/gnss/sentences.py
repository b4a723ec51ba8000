"""What one NMEA sentence says, in SI, with the validity decided here.

pynmea2 splits the sentence and knows the order of its fields; its typed properties
are not used: they read a blank position as 0 N 0 E and an unknown hemisphere as 0,
and call a good u-blox fix invalid. What a newcomer gets wrong: a receiver repeats
its last position while it has no fix, so the status counts, not the coordinates.
"""

from collections import Counter
from collections.abc import Callable
from operator import itemgetter
from typing import Final, NamedTuple, TypeAlias

import pynmea2

from imu_tracker.errors import NmeaError, shown
from imu_tracker.sensors.gnss.fields import (
    century,
    degrees_of,
    dilution,
    height_m_of,
    number_of,
    per_axis,
    position,
    positive,
    time_of_day,
    utc_s_of,
    velocity,
)
from imu_tracker.sensors.gnss.lines import checked_text
from imu_tracker.sensors.gnss.verdicts import (
    HAS_FIX_BY_STATUS,
    NOT_MEASURED,
    NOT_MEASURED_QUALITY,
    QUALITY_OF_MODE,
    has_fix_by_status,
    quality_by_status,
)

TOLD_AFTER: Final = 10  # a receiver may send its date every few seconds only
MAX_REASONS: Final = 40  # kinds times fields that can be wrong; a bound for noise


class Report(NamedTuple):
    """What one sentence says; None where it is silent.

    `has_fix` is the sentence's verdict on its epoch; `sent_utc_s` is there when both
    date and time are, as the receiver believes; `sigma_m` is per axis.
    """

    kind: str
    tod_s: float | None = None
    sent_utc_s: float | None = None
    has_fix: bool | None = None
    lat_lon_rad: tuple[float, float] | None = None
    alt_m: float | None = None
    vel_ne_mps: tuple[float, float] | None = None
    quality: int | None = None
    hdop: float | None = None
    sigma_m: float | None = None


def read_sentence(line: bytes) -> Report | None:
    """Read one line; None for an intact sentence of a kind that is not used here.

    Raises
    ------
    NmeaError
        The line is damaged. A field that makes no sense counts as blank.
    """
    text = checked_text(line)
    if text[2:6] not in _READERS or text[0] == "P":  # $PGRMC is no RMC
        return None
    try:
        sentence = pynmea2.NMEASentence.parse(text)
    except pynmea2.ParseError as error:
        raise NmeaError("unparsable_lines", line) from error
    pick, read = _READERS[text[2:6]]
    fields = sentence.data
    if " " in text:  # some loggers pad the fields
        fields = [field.strip() for field in fields]
    return read(*pick(fields + _BLANKS))


_Reader: TypeAlias = Callable[..., Report]
_READERS: Final[dict[str, tuple[Callable[[list[str]], tuple[str, ...]], _Reader]]] = {}
_BLANKS: Final = [""] * 16  # for the fields that older layouts do not have


def _reads(
    sentence: type[pynmea2.TalkerSentence], fields: str
) -> Callable[[_Reader], _Reader]:
    """Register what reads a sentence, and its fields by the names that pynmea2 has."""
    pick = itemgetter(*(sentence.name_to_idx[name] for name in fields.split()))

    def register(read: _Reader) -> _Reader:
        _READERS[f"{sentence.__name__},"] = pick, read
        return read

    return register


@_reads(
    pynmea2.RMC,
    "timestamp status lat lat_dir lon lon_dir mode_indicator "
    "spd_over_grnd true_course datestamp",
)
def _read_rmc(tod: str, status: str, *rest: str) -> Report:
    *place, mode, knots, course, day = rest
    tod_s = time_of_day(tod)
    return Report(
        "RMC",
        tod_s=tod_s,
        sent_utc_s=utc_s_of(tod_s, century(day[4:6]), day[2:4], day[:2]),
        has_fix=has_fix_by_status(status, mode),
        lat_lon_rad=position(*place),
        vel_ne_mps=velocity(knots, course),
        quality=quality_by_status(status, mode),
    )


@_reads(
    pynmea2.GGA,
    "timestamp gps_qual num_sats lat lat_dir lon lon_dir altitude horizontal_dil",
)
def _read_gga(tod: str, quality: str, satellites: str, *rest: str) -> Report:
    *place, altitude, hdop = rest
    has_fix = quality not in NOT_MEASURED_QUALITY if quality.isdigit() else None
    if has_fix and number_of(satellites) == 0:
        has_fix = None  # a fix by no satellite at all needs another witness
    return Report(
        "GGA",
        tod_s=time_of_day(tod),
        has_fix=has_fix,
        lat_lon_rad=position(*place),
        alt_m=height_m_of(altitude),
        quality=int(quality) if quality.isdigit() else None,
        hdop=dilution(hdop),
    )


@_reads(
    pynmea2.GNS,
    "timestamp mode_indicator lat lat_dir lon lon_dir altitude hdop",
)
def _read_gns(tod: str, modes: str, *rest: str) -> Report:
    *place, altitude, hdop = rest
    return Report(
        "GNS",
        tod_s=time_of_day(tod),
        has_fix=not NOT_MEASURED.issuperset(modes) if modes else None,
        lat_lon_rad=position(*place),
        alt_m=height_m_of(altitude),
        quality=next((q for mode, q in QUALITY_OF_MODE.items() if mode in modes), None),
        hdop=dilution(hdop),
    )


@_reads(pynmea2.GLL, "timestamp status lat lat_dir lon lon_dir faa_mode")
def _read_gll(tod: str, status: str, *rest: str) -> Report:
    *place, mode = rest
    return Report(
        "GLL",
        tod_s=time_of_day(tod),
        has_fix=has_fix_by_status(status, mode),  # NMEA 1.5 had no status
        lat_lon_rad=position(*place),
        quality=quality_by_status(status, mode),
    )


@_reads(pynmea2.VTG, "true_track spd_over_grnd_kts spd_over_grnd_kts_sym faa_mode")
def _read_vtg(course: str, knots: str, unit: str, mode: str) -> Report:
    if unit != "N" or mode in NOT_MEASURED:  # the oldest layout has no units
        return Report("VTG")
    return Report("VTG", vel_ne_mps=velocity(knots, course))


@_reads(
    pynmea2.GST,
    "timestamp std_dev_latitude std_dev_longitude std_dev_major std_dev_minor",
)
def _read_gst(tod: str, *sigmas: str) -> Report:
    north, east, major, minor = map(positive, sigmas)
    sigma_m = per_axis(north, east) or per_axis(major, minor)
    return Report("GST", tod_s=time_of_day(tod), sigma_m=sigma_m)


@_reads(pynmea2.GBS, "timestamp lat_err lon_err")
def _read_gbs(tod: str, *sigmas: str) -> Report:
    """Read 1 sigma; gpsd, for binary receivers, puts 95 % there: never too sure."""
    sigma_m = per_axis(*map(positive, sigmas))
    return Report("GBS", tod_s=time_of_day(tod), sigma_m=sigma_m)


@_reads(pynmea2.GSA, "mode_fix_type hdop")
def _read_gsa(fix_type: str, hdop: str) -> Report:
    has_fix = {"1": False, "2": True, "3": True}.get(fix_type)
    return Report("GSA", has_fix=has_fix, hdop=dilution(hdop))


@_reads(pynmea2.ZDA, "timestamp year month day")
def _read_zda(tod: str, *day: str) -> Report:
    tod_s = time_of_day(tod)
    return Report("ZDA", tod_s=tod_s, sent_utc_s=utc_s_of(tod_s, *day))


def _one_of(letters: str) -> Callable[[str], str | None]:
    return lambda text: text if text and text in letters else None


_FORMS: Final[tuple[tuple[str, str, str, Callable[[str], object]], ...]] = (
    ("timestamp", "time", "hhmmss.ss", time_of_day),
    ("lat", "latitude", "ddmm.mmmm", lambda text: degrees_of(text, 1, 90)),
    ("lat_dir", "letter of latitude", "N or S", _one_of("NS")),
    ("lon", "longitude", "dddmm.mmmm", lambda text: degrees_of(text, 1, 180)),
    ("lon_dir", "letter of longitude", "E or W", _one_of("EW")),
    ("gps_qual", "quality", "a digit", _one_of("0123456789")),
    ("status", "status", "A or V", HAS_FIX_BY_STATUS.get),
)
"""Fields that a fix needs, in the order of blame: pynmea2's name, ours, the form that
it should have, and what reads it."""


def why_unread(line: bytes) -> tuple[str, str]:
    """Say which field of an intact sentence keeps its fix from being used.

    Returns
    -------
    tuple of str
        The field, such as `RMC: longitude`, and what is wrong with it: `-11814.617 is
        not dddmm.mmmm`.
    """
    sentence = pynmea2.NMEASentence.parse(checked_text(line))
    kind = sentence.sentence_type
    for name, field, form, read in _FORMS:
        index = sentence.name_to_idx.get(name)
        if index is None:
            continue
        text = (sentence.data + _BLANKS)[index].strip()
        if read(text) is None:
            what = f"{text[:20]} is not {form}" if text else f"is blank, not {form}"
            return f"{kind}: {field}", what
    return f"{kind}: position", "0 N 0 E is no place"


class Unread:
    """Why sentences could not be used: each reason with its count and first example."""

    def __init__(self) -> None:
        self._first: dict[str, tuple[str, bytes]] = {}  # the reason in words, the line
        self._counts: Counter[str] = Counter()
        self._notices: list[str] = []

    def add(self, field: str, what: str, line: bytes) -> None:
        """Count a sentence; reasons that concern the same field are one."""
        key = field or what
        if key not in self._first and len(self._first) >= MAX_REASONS:
            key = "others"
        reason, example = self._first.setdefault(key, (f"{field} {what}".strip(), line))
        self._counts[key] += 1
        if self._counts[key] == TOLD_AFTER:
            self._notices.append(
                f"the receiver sends what cannot be used, {TOLD_AFTER} times by now: "
                f"{reason}: {shown(example.decode('ascii', 'replace'))}"
            )

    def reasons(self) -> dict[str, int]:
        """Return how often, by reason; the most frequent first."""
        return {f"{self._first[key][0]}": n for key, n in self._counts.most_common()}

    def worst(self) -> str:
        """Say the most frequent reason, how often, and its first line; "" if none."""
        for key, n in self._counts.most_common(1):
            reason, example = self._first[key]
            line = shown(example.decode("ascii", "replace"))
            return f"{reason}, {n} {'time' if n == 1 else 'times'}: {line}"
        return ""

    def take_notices(self) -> list[str]:
        """Return what a person should know; each is said once."""
        notices, self._notices = self._notices, []
        return notices
