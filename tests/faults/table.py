"""The table of the campaign: what befalls the tracker, and what must be true of it."""

import errno
import math
from collections.abc import Callable
from enum import StrEnum
from typing import Any, Final, NamedTuple

from faults import sentences, strikes
from faults.bench import Bench
from faults.drives import Said, drive

FOR_EVER: Final = math.inf
SYNC_S: Final = 5.0


class Phase(StrEnum):
    """When it strikes."""

    START = "start"  # before the first fix
    STILL = "still"
    MOVING = "moving"
    OUTAGE = "outage"  # moving, and no receiver


AT_S: Final = {Phase.START: 2.0, Phase.STILL: 12.0, Phase.MOVING: 32.0}
AT_S[Phase.OUTAGE] = 50.0
HIDDEN_S: Final = (45.0, 65.0)  # the outage

ALWAYS: Final = (Phase.START, Phase.STILL, Phase.MOVING, Phase.OUTAGE)
WITH_GPS: Final = (Phase.START, Phase.STILL, Phase.MOVING)
TRACKING: Final = (Phase.STILL, Phase.MOVING)


class Fault(NamedTuple):
    """One row.

    `strike` plans what happens on the bench, `say` changes what the receiver says,
    both from a second of the drive on. What follows must be true, in every phase.
    """

    name: str
    lasts_s: float  # 0: at an instant
    strike: Callable[[Bench, float], object] | None = None
    say: Callable[[list[Said], float], list[Said]] | None = None
    phases: tuple[Phase, ...] = ALWAYS
    bench: dict[str, Any] = {}  # noqa: RUF012 - never changed
    for_s: float = 13.0  # that is watched afterwards

    back: str = ""  # "imu" or "gps": what must be back
    within_s: float = 2.0
    mode: str = ""  # is seen meanwhile
    counters: tuple[str, ...] = ()  # are above zero
    says: str = ""  # in the journal, once
    is_true: bool = True  # r95 holds the truth
    is_late: bool = False  # rows may be
    moves_time: bool = False  # the receiver's word on UTC is the fault
    lost_s: float = 0.0  # rows of the file that may be missing after it struck


SPOOFED: Final = "may be led astray"
LOST: Final = "position reset to the receiver's"
JUMPED: Final = "the receiver's time jumped"
OVERLOADED: Final = "more than its line carries"
BUS: Final[dict[str, Any]] = {"back": "imu", "mode": "gpsonly", "says": "imu lost"}
RESET: Final[dict[str, Any]] = {"back": "imu", "within_s": 1.0, "says": "imu reset"}
RESTARTED: Final[dict[str, Any]] = {"back": "imu", "within_s": 1.0}
STUCK: Final[dict[str, Any]] = {
    "mode": "gpsonly",
    "says": "the IMU is not used",
    "back": "imu",
}
GPS: Final[dict[str, Any]] = {"phases": WITH_GPS, "back": "gps"}
NO_DISK: Final[dict[str, Any]] = {
    "says": "cannot be written",
    "counters": ("write_failures",),
}

FAULTS: Final = (
    Fault("nothing at all", 0),
    # The bus.
    Fault("NACK once", 0, strikes.nack_once, counters=("imu_bus_errors",), **RESTARTED),
    Fault("NACK for 10 s", 10, strikes.bus_fails(10, errno.EREMOTEIO), **BUS),
    Fault(
        *("NACK for ever", FOR_EVER, strikes.bus_fails(FOR_EVER, errno.EREMOTEIO)),
        mode="gpsonly",
        says="imu lost",
    ),
    Fault(
        "bus held low for 10 s", 10, strikes.bus_fails(10, errno.ETIMEDOUT, 1.0), **BUS
    ),
    Fault("adapter unplugged for 10 s", 10, strikes.unplugged_adapter, **BUS),
    # The chip.
    Fault("another WHO_AM_I for 10 s", 10, strikes.another_chip, **BUS),
    Fault(
        "brown-out", 0, strikes.brown_out, counters=("imu_reinitialisations",), **RESET
    ),
    Fault("ranges back to default", 0, strikes.other_ranges, **RESET),
    Fault(
        "chip repeats itself",
        0,
        strikes.wedged,
        counters=("imu_frozen_frames",),
        **RESET,
    ),
    Fault(
        *("FIFO overflow: host stalls 1.2 s", 1.2, strikes.stalled_host),
        counters=("imu_fifo_overflows",),
        is_late=True,
        **RESTARTED,
    ),
    Fault(
        "FIFO misaligned",
        0,
        strikes.shifted_fifo,
        counters=("imu_fifo_restarts",),
        **RESTARTED,
    ),
    Fault("bit flips for 10 s", 10, strikes.bit_flips, back="imu"),
    Fault(
        "axis stuck for 10 s: gyro z",
        10,
        strikes.axis("gz", 10),
        counters=("stuck_samples",),
        **STUCK,
    ),
    Fault(
        "axis stuck for 10 s: accel x",
        10,
        strikes.axis("ax", 10),
        counters=("stuck_samples",),
        **STUCK,
    ),
    Fault(
        "axis clipped for 10 s: gyro z",
        10,
        strikes.axis("gz", 10, 600.0),
        counters=("clipped_samples",),
        **STUCK,
    ),
    Fault(
        "axis clipped for 10 s: accel x",
        10,
        strikes.axis("ax", 10, 9.0),
        counters=("clipped_samples",),
        **STUCK,
    ),
    Fault(
        "a knock: accel y clipped for 0.1 s",
        0.1,
        strikes.axis("ay", 0.1, 9.0),
        counters=("saturated_samples",),
    ),
    Fault(
        *("clipped in bursts for 20 s", 20, strikes.clips_in_bursts),
        phases=(Phase.STILL, Phase.MOVING),
        counters=("clipped_samples",),
        mode="gpsonly",
        says="an axis stays at the end of its range",
        for_s=26,
    ),
    Fault("sensor 2 % fast", FOR_EVER, bench={"clock_error": 0.02}),
    # The receiver.
    Fault("GPS silent for 10 s", 10, say=strikes.silent, **GPS),
    Fault(
        "GPS silent for ever",
        FOR_EVER,
        say=strikes.silent_for_ever,
        phases=TRACKING,
        for_s=66,
        mode="dr",
        says="GPS lost",
    ),
    Fault("GPS: noise for 10 s", 10, strikes.noise, **GPS),
    Fault(
        "GPS at another baud",
        0,
        strikes.other_baud,
        phases=WITH_GPS,
        back="gps",
        within_s=7.0,
    ),
    Fault(
        "GPS unplugged for 10 s", 10, strikes.unplugged_receiver, says="gps lost", **GPS
    ),
    Fault(
        "GPS without a fix for 10 s",
        10,
        say=strikes.said(sentences.no_fix),
        counters=("epochs_without_fix",),
        **GPS,
    ),
    Fault(
        "GPS at 0 N 0 E for 10 s",
        10,
        say=strikes.said(sentences.null_island),
        counters=("bad_positions",),
        **GPS,
    ),
    Fault(
        "RMC status D",
        FOR_EVER,
        say=strikes.said(sentences.status_d, 1e3),
        phases=WITH_GPS,
    ),
    Fault(
        "longitude with a sign for 12 s",
        12,
        say=strikes.said(sentences.signed_longitude, 12),
        phases=TRACKING,
        back="gps",
        counters=("bad_positions",),
        says="RMC: longitude -",
    ),
    Fault(
        "place frozen for 15 s",
        15,
        say=lambda lines, at_s: strikes.said(sentences.frozen(), 15)(lines, at_s),
        phases=(Phase.MOVING,),
        counters=("fixes_frozen",),
    ),
    Fault(
        "GLL in local time",
        FOR_EVER,
        say=lambda lines, _: sentences.with_local_gll(lines),
        phases=WITH_GPS,
        counters=("foreign_times",),
    ),
    Fault(
        "first dates two weeks early",
        FOR_EVER,
        say=strikes.said(sentences.dated(-14), 12),
        phases=(Phase.START,),
        moves_time=True,
        for_s=50,
        says=JUMPED,
    ),
    Fault(
        "time one hour back for ever",
        FOR_EVER,
        say=strikes.said(sentences.timed(-3600), 1e3),
        phases=TRACKING,
        moves_time=True,
        for_s=45,
        counters=("logs_put_aside",),
        says="put aside, and begun anew",
    ),
    Fault(
        *("a log of the future", 0, strikes.future_log),
        phases=(Phase.START,),
        for_s=45,
        lost_s=30,
        counters=("logs_put_aside",),
        says="put aside, and begun anew",
    ),
    Fault(
        "date 1024 weeks back",
        FOR_EVER,
        say=strikes.said(sentences.dated(-7168), 1e3),
        phases=WITH_GPS,
        says="1024 weeks back",
    ),
    Fault(
        "time one hour ahead for 10 s",
        10,
        say=strikes.said(sentences.timed(3600)),
        phases=TRACKING,
        back="gps",
        within_s=4.0,
        moves_time=True,
        counters=("fixes_undated",),
    ),
    Fault(
        "time one hour ahead for ever",
        FOR_EVER,
        say=strikes.said(sentences.timed(3600), 1e3),
        phases=TRACKING,
        moves_time=True,
        says=JUMPED,
    ),
    Fault(
        "a leap second",
        FOR_EVER,
        say=strikes.said(sentences.timed(-1), 1e3),
        phases=(*TRACKING, Phase.OUTAGE),
        moves_time=True,
        for_s=25,
        counters=("fixes_undated",),
        says=JUMPED,
    ),
    Fault("epochs twice for 10 s", 10, say=strikes.doubled, **GPS),
    Fault(
        "epochs out of order for 10 s",
        10,
        say=strikes.disordered,
        moves_time=True,
        **GPS,
    ),
    Fault(
        "50 km away for 5 s",
        5,
        say=strikes.said(sentences.moved_north(lambda _: 5e4), 5),
        phases=TRACKING,
        back="gps",
        counters=("fixes_outlier",),
    ),
    Fault(
        "50 km away for ever",
        FOR_EVER,
        say=strikes.said(sentences.moved_north(lambda _: 5e4), 1e3),
        phases=TRACKING,
        says=LOST,
        is_true=False,
    ),
    Fault(
        "first fixes 50 km away",
        5,
        say=strikes.said(sentences.moved_north(lambda _: 5e4), 5),
        phases=(Phase.START,),
        says=LOST,
        back="gps",
        within_s=8.0,
        is_true=False,
        for_s=25,
    ),
    Fault(
        "places drawn away at 1 m/s",
        FOR_EVER,
        say=strikes.said(sentences.moved_north(lambda s: s), 1e3),
        phases=TRACKING,
        for_s=66,
        says=SPOOFED,
        counters=("suspect_fixes",),
        is_true=False,
    ),
    Fault(
        "places and speed drawn away, parked",
        FOR_EVER,
        say=strikes.said(sentences.drawn_north(1.0), 1e3),
        phases=(Phase.STILL,),
        bench={"drives": drive(scenario="still")},
        for_s=70,
        says=SPOOFED,
        counters=("suspect_fixes",),
        is_true=False,
    ),
    Fault(
        "receiver at 10 Hz",
        FOR_EVER,
        phases=(Phase.MOVING,),
        bench={"drives": drive(0.1, 115200), "baud": 115200},
    ),
    Fault(
        "10 Hz over 9600 baud, drops epochs",
        FOR_EVER,
        phases=(Phase.START,),
        bench={"drives": drive(0.1, 115200), "baud": 9600, "buffer_s": 1.5},
        for_s=70,
        says=OVERLOADED,
        counters=("overdue_epochs",),
    ),
    Fault(
        "10 Hz over 9600 baud, endless buffer",
        FOR_EVER,
        phases=(Phase.START,),
        bench={"drives": drive(0.1, 115200), "baud": 9600},
        for_s=70,
        mode="dr",
        says=OVERLOADED,
        counters=("overdue_epochs",),
    ),
    # The host.
    Fault("system clock stepped by hours", 0, strikes.stepped_clock),
    Fault("disk full for 10 s", 10, strikes.full_disk, **NO_DISK),
    Fault("disk fails for 10 s", 10, strikes.failing_disk, **NO_DISK),
    Fault("log directory read-only for 10 s", 10, strikes.read_only, **NO_DISK),
    Fault(
        "log file deleted",
        0,
        strikes.deleted_log,
        says="moved or deleted",
        lost_s=SYNC_S,
    ),
    Fault(
        "log directory deleted",
        0,
        strikes.deleted_directory,
        says="moved or deleted",
        lost_s=SYNC_S,
    ),
    Fault(
        "queue overrun",
        0,
        strikes.flood,
        counters=("refused_frames",),
        says="queue overrun",
        **RESTARTED,
    ),
    Fault("SIGHUP", 0, strikes.sighup, says="told to open the files anew"),
)
