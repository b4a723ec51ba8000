"""`imu-tracker check`: is everything there, and how to mend what is not."""

import argparse
import itertools
import logging

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    installed_config_of,
    write,
)
from imu_tracker.commands.status import read_status
from imu_tracker.errors import DeviceNotFoundError, NotRunningError

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Read the configuration, look for the chip, the receiver and the place of the log, and
say how to mend what is missing. Ends with 0, or with the code of the first problem. The
sensors of a daemon that runs are left alone.

Without --config it reads /etc/imu-tracker/imu-tracker.toml where that exists."""

_EXAMPLES = """\
  imu-tracker check
  imu-tracker check --set imu.bus=0
  imu-tracker check --set gps.port=/dev/ttyACM0"""


def add_check(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "check", "is everything there?", _DESCRIPTION, _EXAMPLES
    )
    add_config(parser)
    parser.set_defaults(run=run_check)


def run_check(args: argparse.Namespace) -> int:
    """Print a table of what was found."""
    config = installed_config_of(args)

    from imu_tracker.check.sensors import check_outputs, check_sensors
    from imu_tracker.sensors.clock import MonotonicClock

    _print("ok", "configuration", str(args.config or "the defaults"))
    for line in config.advice():
        _print("warning", "configuration", line)
    try:
        _, status = read_status(config.status.path)
    except NotRunningError:
        sensors = check_sensors(config, MonotonicClock())
    else:
        sensors = iter(())
        text = f"it runs (process {status.get('pid')}) and has the sensors: see status"
        _print("ok", "daemon", text)
    exit_code = 0
    for finding in itertools.chain(sensors, check_outputs(config)):
        _print(finding.verdict, finding.what, finding.text)
        exit_code = exit_code or finding.exit_code
    if exit_code == DeviceNotFoundError.exit_code:
        log.info("sudo imu-tracker setup switches on what a Pi needs for this")
    return exit_code


def _print(verdict: str, what: str, text: str) -> None:
    write(f"{verdict:8} {what:14} {text}\n")
