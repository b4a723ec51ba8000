"""`imu-tracker check`: is everything there, and how to mend what is not."""

import argparse
import json
import logging
from collections.abc import Iterator
from typing import TYPE_CHECKING

from imu_tracker import __version__
from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    installed_config_of,
    write,
)
from imu_tracker.commands.status import read_status
from imu_tracker.errors import DeviceNotFoundError, NotRunningError

if TYPE_CHECKING:
    from imu_tracker.check.sensors import Finding
    from imu_tracker.config import Config

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Read the configuration, look for the chip, the receiver and the place of the log, try
each destination of [[publish]], and say how to mend what is missing. Ends with 0, or
with the code of the first problem. The sensors of a daemon that runs are left alone.

Without --config it reads /etc/imu-tracker/imu-tracker.toml where that exists."""

_EXAMPLES = """\
  imu-tracker check
  imu-tracker check --json
  imu-tracker check --set imu.bus=0
  imu-tracker check --set gps.port=/dev/ttyACM0"""


def add_check(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "check", "is everything there?", _DESCRIPTION, _EXAMPLES
    )
    parser.add_argument(
        "--json", action="store_true", help="print the findings as one JSON object"
    )
    add_config(parser)
    parser.set_defaults(run=run_check)


def run_check(args: argparse.Namespace) -> int:
    """Print a table, or a JSON object, of what was found."""
    config = installed_config_of(args)
    exit_code = 0
    findings = []
    for finding in _findings(config, str(args.config or "the defaults")):
        findings.append(finding._asdict())
        if not args.json:
            write(f"{finding.verdict:8} {finding.what:14} {finding.text}\n")
        exit_code = exit_code or finding.exit_code
    if args.json:
        found = {"version": __version__, "exit_code": exit_code, "findings": findings}
        write(json.dumps(found, indent=2, ensure_ascii=False) + "\n")
    if exit_code == DeviceNotFoundError.exit_code:
        log.info("sudo imu-tracker setup switches on what a Pi needs for this")
    return exit_code


def _findings(config: "Config", source: str) -> "Iterator[Finding]":
    from imu_tracker.check.destinations import check_destinations
    from imu_tracker.check.sensors import (
        Finding,
        Verdict,
        check_outputs,
        check_sensors,
    )
    from imu_tracker.sensors.clock import MonotonicClock

    yield Finding(Verdict.OK, "configuration", source)
    for line in config.advice():
        yield Finding(Verdict.WARNING, "configuration", line)
    try:
        _, status = read_status(config.status.path)
    except NotRunningError:
        yield from check_sensors(config, MonotonicClock())
    else:
        text = f"it runs (process {status.get('pid')}) and has the sensors: see status"
        yield Finding(Verdict.OK, "daemon", text)
    yield from check_outputs(config)
    yield from check_destinations(config)
