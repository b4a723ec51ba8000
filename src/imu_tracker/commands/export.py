"""`imu-tracker export`: logs in the formats of other programs, and as a map."""

import argparse
import logging
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from imu_tracker.commands.common import (
    STDOUT,
    Subparsers,
    add_command,
    positive,
    progress,
    refuse_to_overwrite,
    whole_output,
)

if TYPE_CHECKING:
    from imu_tracker.exports.merging import Point

log = logging.getLogger(__name__)

FORMATS: Final = ("gpx", "kml", "geojson", "nmea", "html")

_DESCRIPTION = """\
Write lat/long logs in the format of other programs: gpx for nearly all, kml for Google
Earth, geojson for QGIS and the web, nmea for what expects a receiver; or html, a map in
one file that needs no network: point at the track and it says when, how fast, how sure.

Logs that follow one another, as rotated ones do, make one track; where the tracker was
off begins a new segment. The map keeps 50,000 points at most and says so; the other
formats keep every row, whatever it takes: --every thins them."""

_EXAMPLES = """\
  imu-tracker export drive.csv --format gpx --output drive.gpx
  imu-tracker export latlong-*.csv.gz latlong.csv --format html --output week.html
  imu-tracker export latlong.csv --format geojson --every 10 --output - | jq ."""


def add_export(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "export",
        "write a log as gpx, kml, geojson, nmea or a map",
        _DESCRIPTION,
        _EXAMPLES,
    )
    parser.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help="lat/long logs, in any order; plain or gzip",
    )
    parser.add_argument("--format", choices=FORMATS, required=True, help="what to make")
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help="written as a whole or not at all; - for stdout",
    )
    parser.add_argument(
        "--every",
        type=positive,
        metavar="SECONDS",
        help="a row in so many seconds, and each where the mode changes; default: all",
    )
    parser.set_defaults(run=run_export)


def run_export(args: argparse.Namespace) -> int:
    """Write the file."""
    refuse_to_overwrite([args.output], args.logs)
    from imu_tracker.exports.merging import merged, spaced

    points = merged(args.logs)
    if args.every is not None:
        points = spaced(points, args.every)
    rows = 0

    def counted() -> Iterator["Point"]:
        nonlocal rows
        for point in progress(points, args, "row"):
            rows += 1
            yield point

    write = _format(args.format)
    with whole_output(args.output) as output:
        for text in write(counted()):
            output.write(text)
    if not rows:
        log.warning("no rows: the logs hold none")
    if args.output != STDOUT:
        log.info("%s: written, %d rows", args.output, rows)
    return 0


def _format(name: str) -> Callable[[Iterable["Point"]], Iterator[str]]:
    """Import what a format needs, and nothing of the others."""
    match name:
        case "gpx":
            from imu_tracker.exports.gpx import gpx

            return gpx
        case "kml":
            from imu_tracker.exports.kml import kml

            return kml
        case "geojson":
            from imu_tracker.exports.geojson import geojson

            return geojson
        case "nmea":
            from imu_tracker.exports.nmea import nmea

            return nmea
        case _:
            from imu_tracker.exports.page import html

            return html
