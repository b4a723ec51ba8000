"""`imu-tracker report`: one page that explains a drive."""

import argparse
import logging
from pathlib import Path
from typing import TYPE_CHECKING

from imu_tracker.commands.common import (
    STDOUT,
    Subparsers,
    add_command,
    add_config,
    config_of,
    progress,
    refuse_to_overwrite,
    whole_output,
)
from imu_tracker.errors import UsageError

if TYPE_CHECKING:
    from imu_tracker.report.collect import Collected

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Write one HTML page about a drive: what is wrong with the installation and what to do
about it, the map, speed and radius over time, the outages and how far off the track
was at their ends, whether the radius can be trusted, what was learnt, how receiver and
IMU did. The page is a single file that opens anywhere, without a network.

A recording is tracked once for it, as by replay. Logs are only shown: they hold
nothing of the sensors."""

_EXAMPLES = """\
  imu-tracker report drive.rec.gz --output drive.html
  imu-tracker report drive.rec --set filter.profile=vehicle --output drive.html
  imu-tracker report latlong-*.csv.gz latlong.csv --output week.html"""


def add_report(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "report",
        "one page about a drive: track, trust, sensors, advice",
        _DESCRIPTION,
        _EXAMPLES,
    )
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="REC|LOG",
        help="one recording, or lat/long logs; plain or gzip",
    )
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="HTML",
        help="written as a whole or not at all; - for stdout",
    )
    add_config(parser)
    parser.set_defaults(run=run_report)


def run_report(args: argparse.Namespace) -> int:
    """Write the page."""
    from imu_tracker.recording.files import is_recording
    from imu_tracker.report.findings import findings_of
    from imu_tracker.report.page import html

    refuse_to_overwrite([args.output], args.files)
    if any(map(is_recording, args.files)):
        if len(args.files) > 1:
            raise UsageError("a recording is reported alone: one page for each")
        collected = _of_recording(args)
    else:
        from imu_tracker.report.collect import collect_logs

        collected = collect_logs(args.files)
    findings = findings_of(collected)
    page = html(collected, findings)
    with whole_output(args.output) as output:
        output.write(page)
    for finding in findings:
        log.info("%s", finding.what)
    if args.output != STDOUT:
        log.info("%s: written; findings: %d", args.output, len(findings))
    return 0


def _of_recording(args: argparse.Namespace) -> "Collected":
    from imu_tracker.recording.files import read_recording
    from imu_tracker.recording.layout import is_cut
    from imu_tracker.report.collect import Tracked

    path: Path = args.files[0]
    tracked = Tracked(path.name, config_of(args))
    for _ in tracked.rows(progress(read_recording(path), args, unit=" records")):
        pass
    return tracked.collected(is_cut=is_cut(path))
