"""`imu-tracker serve`: live page, gpsd JSON and NMEA beside the daemon."""

import argparse

from imu_tracker.commands.common import Subparsers, add_command, add_config, config_of

_DESCRIPTION = """\
Show the running track to others: a live page for a browser (serve.page), gpsd JSON
for cgps, gpspipe, python3-gps or a gpsd that relays it (serve.gpsd), and NMEA 0183 by
TCP for chart plotters (serve.nmea). A program of its own: it reads the log and the
status file, and the daemon does not notice whether it runs. SIGTERM and SIGINT end
it."""

_EXAMPLES = """\
  imu-tracker serve --config /etc/imu-tracker/imu-tracker.toml
  imu-tracker serve --config config/demo.toml
  imu-tracker serve --set serve.nmea= --set guide.route=way.gpx
  cgps localhost:2948                                      meanwhile, elsewhere"""


def add_serve(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "serve",
        "live page, gpsd JSON and NMEA for others",
        _DESCRIPTION,
        _EXAMPLES,
    )
    add_config(parser)
    parser.set_defaults(run=run_serve)


def run_serve(args: argparse.Namespace) -> int:
    """Serve until it is told to end."""
    config = config_of(args)
    from imu_tracker.serve.server import run

    return run(config)
