"""`imu-tracker setup`: switch on what the sensors need of a Raspberry Pi."""

import argparse
import logging
import os
import sys
from typing import TYPE_CHECKING

from imu_tracker.commands.common import (
    STDOUT,
    Output,
    Subparsers,
    add_command,
    add_config,
    installed_config_of,
    write,
)
from imu_tracker.errors import DeviceNotFoundError, UsageError

if TYPE_CHECKING:
    from imu_tracker.setup.machine import Machine
    from imu_tracker.setup.steps import Step

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Go through what the sensors need of a Raspberry Pi: I2C and its clock, the serial port
of pins 8 and 10, no login console on it, the I2C driver, and the groups of the user who
asks. Each command and each line of a file is shown before, and asked for unless --yes
is given; at the end it says what needs a restart, and how all of it is undone. A file
that holds anything it does not understand is left as it is. It may be run again.

Without --config it reads /etc/imu-tracker/imu-tracker.toml where that exists."""

_EXAMPLES = """\
  sudo imu-tracker setup
  imu-tracker setup --dry-run
  sudo imu-tracker setup --yes --set gps.port=/dev/ttyACM0"""


def add_setup(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "setup", "switch on what the sensors need", _DESCRIPTION, _EXAMPLES
    )
    add_config(parser)
    how = parser.add_mutually_exclusive_group()
    how.add_argument("-y", "--yes", action="store_true", help="do not ask")
    how.add_argument(
        "-n", "--dry-run", action="store_true", help="only show what would be done"
    )
    parser.set_defaults(run=run_setup)


def run_setup(args: argparse.Namespace) -> int:
    """Take the steps that are missing, as far as the user agrees."""
    config = installed_config_of(args)

    from imu_tracker.setup.machine import Machine, who_asks
    from imu_tracker.setup.steps import State, steps

    session = _Session(args, Machine(user=who_asks()))
    for look in steps(config, session.machine):
        step = look()
        _print(step)
        if step.state is State.TO_DO:
            session.take(step)
        elif step.state is State.AT_RESTART:
            session.holds_after.add("restart")
        elif step.state is State.BY_HAND:
            session.exit_code = DeviceNotFoundError.exit_code
    session.say_what_is_next()
    return session.exit_code


class _Session:
    """What was agreed to, and done, in one run."""

    def __init__(self, args: argparse.Namespace, machine: "Machine") -> None:
        self.machine = machine
        self.exit_code = 0
        self.holds_after: set[str] = set()
        self._is_yes, self._is_dry = args.yes, args.dry_run
        self._undo: list[str] = []
        self._is_left = False

    def take(self, step: "Step") -> None:
        """Show what is to do, ask, and do it."""
        from imu_tracker.setup.actions import Edit

        if step.action is None:
            raise ValueError("a step that is to do has an action")
        for line in step.action.lines():
            write(f"    {line}\n")
        if self._is_dry:
            self._is_left = True
            return
        if os.geteuid() != 0:
            raise UsageError("this changes the system: sudo imu-tracker setup")
        if not self._is_yes and not _agrees():
            self._is_left = True
            return
        undo = step.action.undo()
        if isinstance(step.action, Edit) and undo not in self._undo:
            step.action.keep_copy()
        step.action.run()
        self.holds_after.add(step.holds_after)
        if undo not in self._undo:
            self._undo.append(undo)

    def say_what_is_next(self) -> None:
        """Say how it is undone, and what has to follow."""
        if self._undo:
            write("\nthis is undone by:\n")
            write("".join(f"    {line}\n" for line in self._undo))
        if self._is_left:
            write("\nnot everything was done: run it again when you want it\n")
        if "restart" in self.holds_after:
            write("\nnow restart: sudo reboot\nthen: imu-tracker check\n")
        elif "login" in self.holds_after:
            write("\nnow log in again; then: imu-tracker check\n")
        elif not self._is_left and not self.exit_code:
            write("\nnothing is missing; next: imu-tracker check\n")


def _print(step: "Step") -> None:
    write(f"{step.state:8} {step.what:18} {step.text}\n")


def _agrees() -> bool:
    """Ask on the terminal; without an answer nothing is done."""
    write("    do this? [y/N] ")
    Output(STDOUT).flush()
    answer = sys.stdin.readline() if sys.stdin else ""
    if not answer.endswith("\n"):
        write("\n")
    return answer.strip().lower() in ("y", "yes")
