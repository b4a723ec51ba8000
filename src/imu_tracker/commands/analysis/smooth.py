"""`imu-tracker smooth`: the best track after the drive."""

import argparse

from imu_tracker.commands.common import Subparsers, add_command
from imu_tracker.commands.recorded import add_recorded, run_recorded

_DESCRIPTION = """\
Track a recording forward and backward, for the best track after the drive: each row
uses all that came before it and after it. A tunnel is known from both ends, and what
was learnt on the last mile corrects the first one.

Rows and options are those of `replay`, without --state and --speed; r95 is the radius
of the smoothed position. A row uses data from minutes later, so this is not what the
tracker would have written live. It takes a quarter longer than `replay`, and some
100 MB whatever the length of the recording."""

_EXAMPLES = """\
  imu-tracker smooth drive.rec --output drive.csv
  imu-tracker smooth drive.rec.gz --set filter.profile=vehicle --output drive.csv
  imu-tracker smooth drive.rec --truth truth.csv --gps-outage 120:60"""


def add_smooth(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "smooth", "the best track after the drive", _DESCRIPTION, _EXAMPLES
    )
    add_recorded(parser)
    parser.set_defaults(run=run_smooth)


def run_smooth(args: argparse.Namespace) -> int:
    """Smooth, write the log, print the score."""
    from imu_tracker.recording.smoothing import Smoothing

    run_recorded(args, Smoothing)
    return 0
