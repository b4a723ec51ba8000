"""`imu-tracker selftest`: whether the chip is what it was when it left the factory."""

import argparse
import contextlib
import logging
from typing import TYPE_CHECKING

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    config_of,
    write,
)
from imu_tracker.errors import DeviceNotFoundError

if TYPE_CHECKING:
    from imu_tracker.sensors.imu.selftest import AxisResult

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Let the MPU-6050 push its own proof masses, and compare the response with what the
factory measured: within 14 % is good. Hold the chip still for the two seconds that it
takes, and stop the daemon before: both would talk to the same chip.

Many cheap boards carry no factory values, or a chip of another family: their axes are
"not graded" or "not applicable", which says nothing against them."""

_EXAMPLES = """\
  imu-tracker selftest --config /etc/imu-tracker/imu-tracker.toml
  imu-tracker selftest --set imu.address=0x69"""


def add_selftest(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "selftest", "the chip's own test", _DESCRIPTION, _EXAMPLES
    )
    add_config(parser)
    parser.set_defaults(run=run_selftest)


def run_selftest(args: argparse.Namespace) -> int:
    """Print a table of the axes; a failed one is unusable hardware."""
    config = config_of(args)

    from imu_tracker.sensors.clock import MonotonicClock
    from imu_tracker.sensors.imu.selftest import Verdict, self_test
    from imu_tracker.sources import factory as hardware

    clock = MonotonicClock()
    with contextlib.closing(hardware.open_imu_bus(config)) as bus:
        imu = hardware.imu_driver(config, bus, clock)
        chip = imu.probe()
        log.info("%s (WHO_AM_I 0x%02X)", chip.name, chip.who_am_i)
        results = self_test(imu, clock)
    for result in results:
        write(f"{result.axis:8} {_text(result)}\n")
    verdicts = {result.verdict for result in results}
    if Verdict.NOT_APPLICABLE in verdicts:
        log.info("no MPU-6050: its factory wrote other values, or elsewhere")
    if Verdict.NOT_GRADED in verdicts:
        log.info("not graded: the factory wrote no values into this chip")
    return DeviceNotFoundError.exit_code if Verdict.FAILED in verdicts else 0


def _text(result: "AxisResult") -> str:
    if result.change is None:
        return result.verdict
    return f"{result.verdict:10} {result.change:+.1%} of the factory's response"
