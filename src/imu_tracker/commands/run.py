"""`imu-tracker run`: the daemon."""

import argparse

from imu_tracker.commands.common import Subparsers, add_command, add_config, config_of

_DESCRIPTION = """\
Track until SIGTERM or SIGINT. Reads the sensors, estimates, and appends to the
lat/long log of [log]. A sensor that is missing, dies or comes back never ends it: it
goes on with what it has, and says in every row how far off it may be. SIGHUP reopens
the log.

`imu-tracker check` tells beforehand whether everything is there, `imu-tracker status`
what is going on meanwhile."""

_EXAMPLES = """\
  imu-tracker run --config /etc/imu-tracker/imu-tracker.toml
  imu-tracker run --config config/demo.toml          no hardware: a simulated drive
  imu-tracker run --set source.kind=simulation --set log.path=latlong.csv"""


def add_run(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "run", "track: the daemon", _DESCRIPTION, _EXAMPLES
    )
    add_config(parser)
    parser.set_defaults(run=run_run)


def run_run(args: argparse.Namespace) -> int:
    """Run the daemon until it is told to end."""
    config = config_of(args)
    from imu_tracker.daemon.run import run

    return run(config)
