"""`imu-tracker hardware-report`: measure a real Pi once, into one file to send in."""

import argparse
import json
import logging
import sys
from functools import partial
from typing import Any, Final

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    installed_config_of,
    new_file,
    positive,
    whole_output,
)
from imu_tracker.commands.status import read_status
from imu_tracker.errors import ConfigError, DeviceNotFoundError, NotRunningError

log = logging.getLogger(__name__)

REST_S: Final = 600.0

_DESCRIPTION = """\
Measure what only a real Pi shows: how fast and how evenly the bus delivers, what the
processor has to do for it and how warm it gets, the chip's own test, ten minutes at
rest, what the kernel says when a wire is pulled, what the receiver sends, and what the
log's file system means for a power cut. Writes one JSON file to send in; no position
is in it. Stop the daemon before, lay the chip down, and leave it alone.

Without --config it reads /etc/imu-tracker/imu-tracker.toml where that exists."""

_EXAMPLES = """\
  sudo systemctl stop imu-tracker
  imu-tracker hardware-report --output hardware-report.json
  imu-tracker hardware-report --rest 60 --no-wire --output quick.json"""


def add_hardware_report(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "hardware-report",
        "measure a real Pi, to send in",
        _DESCRIPTION,
        _EXAMPLES,
    )
    add_config(parser)
    parser.add_argument(
        "--output", type=new_file, required=True, metavar="FILE", help="where to write"
    )
    parser.add_argument(
        "--rest",
        type=positive,
        default=REST_S,
        metavar="S",
        help="how long to measure at rest, in seconds (default: 600)",
    )
    parser.add_argument(
        "--no-wire", action="store_true", help="do not ask for a wire to be pulled"
    )
    parser.set_defaults(run=run_hardware_report)


def run_hardware_report(args: argparse.Namespace) -> int:
    """Measure part after part; a part that fails says so, and the rest goes on."""
    config = installed_config_of(args)
    if config.source.kind != "hardware":
        raise ConfigError(
            f'source.kind = "{config.source.kind}": must be "hardware" to measure it'
        )
    try:
        read_status(config.status.path)
    except NotRunningError:
        pass
    else:
        raise DeviceNotFoundError(
            "the daemon has the sensors: sudo systemctl stop imu-tracker"
        )

    from imu_tracker.check import hardware
    from imu_tracker.sensors.clock import MonotonicClock

    clock = MonotonicClock()
    found: dict[str, Any] = {"computer": hardware.computer(config)}
    with whole_output(args.output) as output:  # refused now, not after ten minutes
        log.info("the bus and the chip's own test: a few seconds")
        found["bus"] = hardware.attempted(partial(hardware.bursts, config, clock))
        log.info("at rest: do not touch it for %.0f s", args.rest)
        found["rest"] = hardware.attempted(
            partial(hardware.at_rest, config, clock, args.rest)
        )
        if not args.no_wire and _wants_wire():
            log.info("now pull SDA for some seconds and put it back; 20 s")
            found["wire"] = hardware.attempted(
                partial(hardware.pulled_wire, config, clock)
            )
        log.info("the receiver: half a minute at most")
        found["receiver"] = hardware.receiver(config, clock)
        output.write(json.dumps(found, indent=2, ensure_ascii=False) + "\n")
    failed = [part for part, value in found.items() if "error" in value]
    for part in failed:
        log.warning("%s: %s", part, found[part]["error"])
    log.info("%s: written; thank you for sending it in", args.output)
    return DeviceNotFoundError.exit_code if failed else 0


def _wants_wire() -> bool:
    """Ask whether somebody is there to pull a wire; nobody is without a terminal."""
    if not sys.stdin or not sys.stdin.isatty():
        return False
    log.info("to see what the kernel says of a broken wire: press Enter (or n, Enter)")
    return not sys.stdin.readline().strip().lower().startswith("n")
