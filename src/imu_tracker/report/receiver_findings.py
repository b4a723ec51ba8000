"""Faults of the receiver, its antenna and its line."""

import math
from collections.abc import Iterator
from typing import Final

from imu_tracker.check import advice, serial_ports
from imu_tracker.report.finding import Finding, Weight
from imu_tracker.report.measures.receiver_log import ReceiverFigures
from imu_tracker.sensors.gnss.reader import GpsState

WEAK_DBHZ: Final = 30.0
"""A patch antenna under the open sky gives 40 to 48 dB-Hz for the strongest four, one
behind a windscreen some 38."""

FEW_SATELLITES: Final = 6
POOR_HDOP: Final = 2.0
"""Eight and 1.2 are usual; under trees six and 1.8."""

SHORT_LOSSES_PER_HOUR: Final = 20.0
LOST_SHARE: Final = 0.1
"""A town has some tunnels and bridges an hour, not one in three minutes."""

FULL_SHARE: Final = 0.9
"""The sentences' lengths vary by a tenth: a wire this full is too full at times."""

GROWING_S: Final = 1.0
SPREAD_S: Final = 0.5
DAMAGED_SHARE: Final = 0.005
JUMP_SHARE: Final = 0.005
SLOW_S: Final = 1.9
COLD_START_S: Final = 90.0


def receiver_findings(receiver: ReceiverFigures, length_s: float) -> Iterator[Finding]:
    """Judge the receiver over a recording of this length."""
    if not receiver.fixes:
        yield from _without_fix(receiver, length_s)
        return
    counters = receiver.counters
    if counters["fixes_without_date"] > 0.5 * receiver.fixes:
        yield _bad("gps_no_date", "The receiver sends no date", "", advice.NO_DATE)
    yield from _antenna(receiver, length_s)
    yield from _wire(receiver)
    if not receiver.has_velocity:
        yield Finding(
            "gps_no_speed",
            Weight.POOR,
            "The receiver does not send its speed",
            "Most fixes have no velocity.",
            "Make it send RMC or VTG: the heading is learnt from it.",
        )
    if receiver.interval_s >= SLOW_S:
        yield Finding(
            "gps_slow",
            Weight.NOTE,
            "The receiver reports seldom",
            f"A fix comes every {receiver.interval_s:.0f} s.",
            "Set it to one fix a second or more, if it can.",
        )
    if receiver.jumps > max(2.0, JUMP_SHARE * receiver.fixes):
        yield Finding(
            "gps_jumps",
            Weight.POOR,
            "The receiver's position jumps",
            f"{receiver.jumps} of {receiver.fixes} fixes lie where nothing could have "
            "driven in the time.",
            "Reflections, mostly: give the antenna more sky and a metal plate below "
            "it, away from pillars and the roof's edge.",
        )


def _without_fix(receiver: ReceiverFigures, length_s: float) -> Iterator[Finding]:
    """Say why there is no fix at all."""
    kinds = set(receiver.kinds)
    if not receiver.lines:
        state, what = GpsState.SILENT, "The GPS receiver says nothing"
        yield _bad("gps_silent", what, "", serial_ports.WHY_USELESS[state])
    elif not kinds:
        what = "What comes from the receiver cannot be read"
        shows = f"{receiver.lines} lines, and none that is a sentence."
        yield _bad(
            "gps_garbage", what, shows, serial_ports.WHY_USELESS[GpsState.GARBAGE]
        )
    elif not advice.has_places({kind[-3:] for kind in kinds}):
        what = "The receiver sends no position"
        shows = f"It sends {', '.join(sorted(kinds))}."
        yield _bad("gps_no_position", what, shows, advice.NO_POSITION)
    elif receiver.unread:
        what = "The receiver's sentences cannot be used"
        shows = f"{receiver.unread}."
        yield _bad("gps_unread", what, shows, advice.UNUSABLE)
    elif length_s < COLD_START_S:
        yield Finding(
            "gps_no_fix",
            Weight.NOTE,
            "The receiver had no fix yet",
            f"After a cold start it takes half a minute and more; these are "
            f"{length_s:.0f} s.",
            "Record for longer, under the open sky.",
        )
    else:
        what = "The receiver never had a fix: look at the antenna and its cable"
        shows = f"{receiver.epochs} reports, and none with a position."
        if not math.isnan(receiver.signal_dbhz):
            shows += f" The strongest signals have {receiver.signal_dbhz:.0f} dB-Hz."
        yield _bad("antenna", what, shows, f"{advice.NO_FIX}. {_CABLE}")


_CABLE: Final = (
    "Push the plug in until it clicks, look for a squeezed or bent cable, lay the "
    "antenna flat with its face to the sky, and try another one."
)


def _antenna(receiver: ReceiverFigures, length_s: float) -> Iterator[Finding]:
    """Tell weak signals from a drive with tunnels."""
    shows = []
    if receiver.signal_dbhz < WEAK_DBHZ:
        shows.append(
            f"The four strongest satellites come with {receiver.signal_dbhz:.0f} "
            "dB-Hz; 40 and more is usual."
        )
    if receiver.satellites < FEW_SATELLITES and receiver.hdop > POOR_HDOP:
        shows.append(
            f"It mostly uses {receiver.satellites:.0f} satellites; eight and more is "
            "usual."
        )
    lost_share = 1.0 - receiver.fixes / max(receiver.epochs, 1)
    losses_per_hour = receiver.short_losses / max(length_s / 3600.0, 0.1)
    if lost_share > LOST_SHARE and losses_per_hour > SHORT_LOSSES_PER_HOUR:
        shows.append(
            f"It lost its fix {receiver.short_losses} times for some seconds, "
            f"{lost_share:.0%} of the time in all."
        )
    if shows:
        what = "Weak GPS signals: look at the antenna and its cable"
        yield _bad("antenna", what, " ".join(shows), _CABLE)


def _wire(receiver: ReceiverFigures) -> Iterator[Finding]:
    """Tell a line that is too slow, or bad."""
    counters = receiver.counters
    is_growing = receiver.lateness_growth_s > GROWING_S
    is_late = counters["late_velocities"] > 0.1 * receiver.fixes
    is_full = receiver.busy_share > FULL_SHARE
    if is_full or (receiver.interval_s < 0.5 and (is_growing or is_late)):
        shows = []
        if receiver.baud is not None:
            shows.append(
                f"The line runs at {receiver.baud} baud and is busy "
                f"{min(receiver.busy_share, 1.0):.0%} of the time, with "
                f"{1.0 / receiver.interval_s:.0f} fixes a second."
            )
        if is_growing:
            shows.append(
                f"Fixes come later and later: by {receiver.lateness_growth_s:.1f} s "
                "at the end."
            )
        if receiver.missed_share > 0.05:
            shows.append(f"{receiver.missed_share:.0%} of the reports are missing.")
        yield _bad(
            "gps_line_full",
            "The receiver's line is too slow for what it sends",
            " ".join(shows),
            'Set the receiver to 38400 or 115200 baud (gps.baud = "auto" finds it), '
            "or to fewer fixes a second, or switch off GSV, GSA and GLL.",
        )
    elif receiver.lateness_s > SPREAD_S:
        yield Finding(
            "gps_delay",
            Weight.NOTE,
            "The receiver's delay varies",
            f"One fix in twenty comes more than {receiver.lateness_s:.1f} s later than "
            "the fastest.",
            "Switch off smoothing in the receiver, if it can; a network or a busy USB "
            "hub in between also does that.",
        )
    names = ("bad_checksums", "missing_checksums", "overlong_lines", "unparsable_lines")
    damaged = sum(counters[name] for name in names)
    if damaged > DAMAGED_SHARE * receiver.lines:
        yield Finding(
            "gps_line_bad",
            Weight.POOR,
            "Sentences arrive damaged",
            f"{damaged} of {receiver.lines} lines.",
            "A loose contact or a missing ground wire between receiver and Pi; keep "
            "the wires short and away from the antenna.",
        )


def _bad(kind: str, what: str, shows: str, to_do: str) -> Finding:
    to_do = f"{to_do[0].upper()}{to_do[1:]}"
    return Finding(kind, Weight.BAD, what, shows, to_do)
