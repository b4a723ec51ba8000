"""What the commands that track a recording again share."""

import argparse
import collections
import contextlib
import json
import logging
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imu_tracker.commands.common import (
    STDOUT,
    Output,
    add_config,
    config_of,
    progress,
    refuse_to_overwrite,
    whole_from,
    write,
)

if TYPE_CHECKING:
    from imu_tracker.calibration.corrected import Corrections
    from imu_tracker.config import Config
    from imu_tracker.recording.edit import Outage
    from imu_tracker.recording.replay import Replay
    from imu_tracker.samples import Frame, NavState, SessionHeader

log = logging.getLogger(__name__)


def add_recorded(parser: argparse.ArgumentParser) -> None:
    """Add the recording, the configuration, and what to make of it."""
    parser.add_argument(
        "recording", type=Path, metavar="REC", help="a recording, plain or gzip"
    )
    add_config(parser)
    parser.add_argument(
        "--output",
        type=Path,
        metavar="LOG",
        help="write the lat/long log here; - is stdout, and the default unless "
        "--truth or --json is given",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="CSV",
        help="score the track: a table with the columns time_utc,lat_deg,lon_deg",
    )
    parser.add_argument(
        "--gps-outage",
        type=_outage,
        action="append",
        default=[],
        metavar="START:LENGTH",
        dest="outages",
        help="hide the receiver from this second of the recording on, for so many "
        "seconds; may be given again",
    )
    parser.add_argument(
        "--gps-every",
        type=whole_from(1),
        default=1,
        metavar="N",
        help="keep the first, (N+1)th, (2N+1)th ... epoch of the receiver",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print score, counters and what was learnt as one JSON object",
    )


def _outage(text: str) -> tuple[float, float]:
    with contextlib.suppress(ValueError):
        start_s, length_s = map(float, text.split(":"))
        if 0 <= start_s < math.inf and 0 < length_s < math.inf:
            return start_s, length_s
    raise argparse.ArgumentTypeError(
        f"{text!r}: must be START:LENGTH in seconds, like 120:60"
    )


def run_recorded(
    args: argparse.Namespace,
    make: "Callable[[Config, Corrections | None], Replay]",
    also_written: Sequence[Path | None] = (),
) -> None:
    """Track the recording, write the log, print the score."""
    from imu_tracker.recording.edit import Outage
    from imu_tracker.recording.scoring import describe, read_truth

    config = config_of(args)
    output = args.output
    if output is None and args.truth is None and not args.json:
        output = STDOUT
    refuse_to_overwrite([output, *also_written], [args.recording, args.truth])
    truth = read_truth(args.truth) if args.truth is not None else None
    outages = [Outage(*outage) for outage in args.outages]

    replay = make(config, _corrections(args, config))
    rows = replay.rows(_scene(args, outages))
    if output is None:
        collections.deque(rows, maxlen=0)
    else:
        _write_log(output, rows, is_live=_speed(args) is not None)

    log.info("%s: %s", args.recording, replay.summary())
    result = {"recording": str(args.recording), **replay.result()}
    if truth is not None:
        result["score"] = replay.score(truth, outages)
    if args.json:
        write(json.dumps(_without_infinity(result)) + "\n")
    elif truth is not None:
        write("".join(f"{line}\n" for line in describe(result["score"])))


def _speed(args: argparse.Namespace) -> float | None:
    """Times real time; None: as fast as possible, as for all but `replay`."""
    speed: float | None = getattr(args, "speed", None)
    return speed


def _corrections(args: argparse.Namespace, config: "Config") -> "Corrections | None":
    """Read the calibration that `--set` names; the file's is this machine's own."""
    is_named = any(
        override.partition("=")[0].strip() == "imu.calibration"
        for override in args.overrides
    )
    if not is_named or config.imu.calibration is None:
        return None
    from imu_tracker.storage.calibration_file import read_calibration

    return read_calibration(config.imu.calibration).corrections()


def _scene(
    args: argparse.Namespace, outages: "Sequence[Outage]"
) -> "Iterator[SessionHeader | Frame]":
    """Read the recording as it were with less GPS, at the speed asked for."""
    from imu_tracker.recording.edit import hide_gps, keep_every_nth_epoch, pace
    from imu_tracker.recording.files import read_recording

    stream = read_recording(args.recording)
    if args.gps_every > 1:
        stream = keep_every_nth_epoch(stream, args.gps_every)
    if outages:
        stream = hide_gps(stream, outages)
    speed = _speed(args)
    if speed is not None:
        from imu_tracker.sensors.clock import MonotonicClock

        stream = pace(stream, speed, MonotonicClock())
    return progress(stream, args, unit=" records")


def _write_log(output: Path, rows: "Iterator[NavState]", *, is_live: bool) -> None:
    from imu_tracker.storage.latlong import HEADER, format_row, put_aside

    # Before the file is opened: a recording that cannot be read leaves no empty log.
    row = next(rows, None)
    is_first = True
    while row is not None or is_first:
        if not is_first and output != STDOUT:
            log.warning(
                "%s: the dates until here were wrong: put aside as %s, and begun anew",
                *(output, put_aside(output)),
            )
        is_first, last_utc_s = False, -math.inf
        with Output(output) as file:
            file.write(f"{HEADER}\n")
            while row is not None and row.utc_s > last_utc_s:
                last_utc_s = row.utc_s
                file.write(f"{format_row(row)}\n")
                if is_live:
                    file.flush()
                row = next(rows, None)


def _without_infinity(value: Any) -> Any:
    """Replace what JSON cannot say by null."""
    match value:
        case dict():
            return {key: _without_infinity(item) for key, item in value.items()}
        case list() | tuple():
            return [_without_infinity(item) for item in value]
        case float() if not math.isfinite(value):
            return None
        case _:
            return value
