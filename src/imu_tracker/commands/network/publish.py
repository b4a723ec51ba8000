"""`imu-tracker publish`: rows to MQTT, Traccar and InfluxDB beside the daemon."""

import argparse

from imu_tracker.commands.common import Subparsers, add_command, add_config, config_of

_DESCRIPTION = """\
Send the rows of the log to each destination of [[publish]]: an MQTT broker (as JSON,
for OwnTracks, for Home Assistant), a Traccar server, an InfluxDB. The log is the
outbox: what cannot be sent now is sent later, oldest first, once each. A program of its
own: the daemon does not notice whether it runs. SIGTERM and SIGINT end it."""

_EXAMPLES = """\
  imu-tracker publish --config /etc/imu-tracker/imu-tracker.toml
  imu-tracker publish --config /etc/imu-tracker/imu-tracker.toml --once
  imu-tracker publish --set publish.home.kind=mqtt --set publish.home.url=mqtt://pi:1883
  imu-tracker check --config /etc/imu-tracker/imu-tracker.toml     tries each of them"""


def add_publish(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "publish",
        "rows to MQTT, Traccar, InfluxDB",
        _DESCRIPTION,
        _EXAMPLES,
    )
    add_config(parser)
    parser.add_argument(
        "--once",
        action="store_true",
        help="send what waits and end: 0 when all of it was taken, 69 when not",
    )
    parser.set_defaults(run=run_publish)


def run_publish(args: argparse.Namespace) -> int:
    """Publish until it is told to end, or until nothing waits."""
    config = config_of(args)
    from imu_tracker.publish.program import run

    return run(config, is_once=args.once)
