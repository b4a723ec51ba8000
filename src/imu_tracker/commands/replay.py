"""`imu-tracker replay`: track a recording again."""

import argparse
import logging

from imu_tracker.commands.common import Subparsers, add_command, new_file, positive
from imu_tracker.commands.recorded import add_recorded, run_recorded

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Track a recording again, as fast as the computer can. The same recording and the same
configuration give the same log, to the byte.

Ranges and rate come from the recording's header; its mount, profile and start_utc,
too, unless --set or the file says otherwise. With --truth it tells how far off the
track is, and how often the truth lies inside r95; --gps-outage and --gps-every show
how it would be with less GPS."""

_EXAMPLES = """\
  imu-tracker replay drive.rec --output drive.csv
  imu-tracker replay drive.rec.gz --set filter.profile=vehicle | tail -n 3
  imu-tracker replay drive.rec --truth truth.csv --gps-outage 120:60 --gps-outage 300:30
  imu-tracker replay drive.rec --truth truth.csv --gps-every 5 --json
  imu-tracker replay drive.rec --state drive.json --set filter.estimator=error-state
  imu-tracker replay drive.rec --speed 1 --output -          as if it were now"""


def add_replay(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "replay", "track a recording again", _DESCRIPTION, _EXAMPLES
    )
    add_recorded(parser)
    parser.add_argument(
        "--state",
        type=new_file,
        metavar="FILE",
        help="begin with what an earlier run learnt, where the file exists, and write "
        "what this one learns",
    )
    parser.add_argument(
        "--speed",
        type=positive,
        metavar="X",
        help="X times real time; default: as fast as possible",
    )
    parser.set_defaults(run=run_replay)


def run_replay(args: argparse.Namespace) -> int:
    """Replay, write the log, print the score."""
    from imu_tracker.recording.replay import Replay
    from imu_tracker.storage.state_file import StateFile

    state = StateFile(args.state) if args.state is not None else None
    run_recorded(
        args,
        lambda config, corrections: Replay(config, corrections, state),
        also_written=[args.state],
    )
    if state is not None:
        is_kept = state.write()
        what = "written" if is_kept else "not written: nothing was learnt to be kept"
        log.log(
            logging.INFO if is_kept else logging.WARNING, "%s: %s", args.state, what
        )
    return 0
