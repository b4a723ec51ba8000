"""`imu-tracker batch`: many recordings at once."""

import argparse
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Final

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    config_of,
    new_file,
    progress,
    whole_from,
    whole_output,
)
from imu_tracker.errors import OutputError

if TYPE_CHECKING:
    from imu_tracker.batch.jobs import Job, Line

log = logging.getLogger(__name__)

TABLE: Final = "batch.csv"
PARQUET: Final = "batch.parquet"

_DESCRIPTION = """\
Track many recordings, on all cores of this computer or on a Dask cluster. For each one
a lat/long log is written, under its own name, and there is one table of all: how far,
outages, how far off at their ends, whether the radius kept its promise, faults.

A recording that cannot be read, a worker that is killed and a disk that is full cost
only themselves; the table says why. With --resume what is done already is not done
again. On a cluster, recordings and output must have the same paths everywhere."""

_EXAMPLES = """\
  imu-tracker batch /data/drives --output /data/tracks
  imu-tracker batch '/data/*/2026-11-*.rec.gz' --output tracks --resume
  imu-tracker batch /data/drives --output tracks --scheduler tcp://10.0.0.1:8786"""


def add_batch(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "batch", "many recordings at once", _DESCRIPTION, _EXAMPLES
    )
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="FOLDER|GLOB",
        help="recordings: a folder and all below it, a pattern, or names",
    )
    parser.add_argument(
        "--output",
        type=new_file,
        required=True,
        metavar="DIR",
        help=f"a folder for the logs and the table {TABLE}",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="a Dask cluster, such as tcp://host:8786; default: all cores here",
    )
    parser.add_argument(
        "--workers",
        type=whole_from(1),
        metavar="N",
        help="processes on this computer; default: one for each core",
    )
    parser.add_argument(
        "--smooth",
        action="store_true",
        help="write the smoothed track; the table stays that of the tracker",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="leave out what an earlier batch did with the same configuration",
    )
    add_config(parser)
    parser.set_defaults(run=run_batch)


def run_batch(args: argparse.Namespace) -> int:
    """Track them, and write the table."""
    from imu_tracker.batch.cluster import results, workers
    from imu_tracker.batch.jobs import done_before, find_jobs

    config = config_of(args)  # says what is wrong before anything starts
    if args.smooth:
        from imu_tracker.recording.smoothing import Smoothing

        Smoothing(config)
    jobs = find_jobs(
        args.recordings,
        args.output,
        args.config,
        args.overrides,
        is_smoothed=args.smooth,
    )
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{args.output}: {error.strerror or error}") from error
    lines: dict[str, Line] = {}
    if args.resume:
        found = ((job, done_before(job)) for job in jobs)
        lines = {job.name: line for job, line in found if line is not None}
    left = [job for job in jobs if job.name not in lines]
    if lines:
        log.info("%d of %d were done before", len(lines), len(jobs))
    if left:
        with workers(args.scheduler, args.workers) as client:
            done = progress(results(client, left), args, " recordings", len(left))
            for line in done:
                lines[line["recording"]] = line
                if line["failed"]:
                    log.warning("%s: %s", line["recording"], line["failed"])
    _write_table(args.output, jobs, lines)
    return 0


def _write_table(output: Path, jobs: "list[Job]", lines: "dict[str, Line]") -> None:
    from imu_tracker.batch.table import csv_of, has_parquet, write_parquet

    ordered = [lines[job.name] for job in jobs]
    with whole_output(output / TABLE) as file:
        file.write(csv_of(ordered))
    if has_parquet():
        write_parquet(ordered, output / PARQUET)
    failed = sum(bool(line["failed"]) for line in ordered)
    log.info(
        "%s: written; recordings: %d, failed: %d", output / TABLE, len(ordered), failed
    )
