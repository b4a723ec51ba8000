"""The command line: parse, configure logging, run one command, translate its end.

Each command lives in `commands/`, as one `add_x` (arguments and help, cheap to import)
and one `run_x` (the work, which imports what it needs). stdout is data, stderr is
talk. Whatever a user or a device can cause ends in one line and the exit code of its
error; the only `except Exception` of the program is the bug report below.
"""

import argparse
import contextlib
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

from imu_tracker import __version__
from imu_tracker.commands.analysis.batch import add_batch
from imu_tracker.commands.analysis.report import add_report
from imu_tracker.commands.analysis.smooth import add_smooth
from imu_tracker.commands.analysis.tune import add_tune
from imu_tracker.commands.check import add_check
from imu_tracker.commands.common import STDOUT, Output, Subparsers
from imu_tracker.commands.export import add_export
from imu_tracker.commands.machine.hardware_report import add_hardware_report
from imu_tracker.commands.machine.setup import add_setup
from imu_tracker.commands.network.publish import add_publish
from imu_tracker.commands.network.serve import add_serve
from imu_tracker.commands.plot import add_plot
from imu_tracker.commands.record import add_record
from imu_tracker.commands.replay import add_replay
from imu_tracker.commands.run import add_run
from imu_tracker.commands.sensor.calibrate import add_calibrate
from imu_tracker.commands.sensor.characterise import add_characterise
from imu_tracker.commands.sensor.selftest import add_selftest
from imu_tracker.commands.simulate import add_simulate
from imu_tracker.commands.status import add_status
from imu_tracker.errors import OutputError, TrackerError

log = logging.getLogger(__name__)

BUG: Final = 70  # EX_SOFTWARE
INTERRUPTED: Final = 130  # as a shell reports SIGINT

_COMMANDS: Final = (
    add_run,
    add_check,
    add_status,
    add_serve,
    add_publish,
    add_record,
    add_replay,
    add_smooth,
    add_tune,
    add_simulate,
    add_plot,
    add_export,
    add_report,
    add_batch,
    add_characterise,
    add_calibrate,
    add_selftest,
    add_setup,
    add_hardware_report,
)

_EPILOG: Final = """\
try it without any hardware:
  imu-tracker simulate drive --output drive.rec --truth truth.csv
  imu-tracker replay drive.rec --truth truth.csv --gps-outage 120:60
  imu-tracker replay drive.rec --output drive.csv
  imu-tracker plot drive.csv --truth truth.csv --output drive.png

on the Raspberry Pi:
  imu-tracker check --config /etc/imu-tracker/imu-tracker.toml
  imu-tracker run --config /etc/imu-tracker/imu-tracker.toml

exit codes:
  0 done                     66 input file missing     73 output cannot be opened
  2 wrong usage              69 hardware unavailable   78 bad configuration
  65 bad data in a file      70 a bug of imu-tracker

`imu-tracker COMMAND --help` explains a command, with examples.
"""


class _Parser(argparse.ArgumentParser):
    """Ends in one line, as every other error does."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = _Parser(
        prog="imu-tracker",
        description="Track a position with an MPU-6050 and an NMEA GPS receiver: a "
        "lat/long log that goes on without GPS, and says in every row how far off it "
        "may be.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version", action="version", version=f"imu-tracker {__version__}"
    )
    subparsers: Subparsers = parser.add_subparsers(
        title="commands", metavar="COMMAND", required=True, dest="command"
    )
    for add in _COMMANDS:
        add(subparsers)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    _open_missing_streams()
    try:
        args = build_parser().parse_args(argv)
    except SystemExit as end:  # --help, --version and usage errors
        return int(end.code or 0)
    _configure_logging(is_verbose=args.verbose, is_quiet=args.quiet)
    try:
        code: int = args.run(args)
        Output(STDOUT).flush()
    except TrackerError as error:
        for line in str(error).splitlines():
            log.error("%s", line)
        log.debug("where it comes from:", exc_info=error)
        if isinstance(error, OutputError):
            _let_stdout_go()
        return error.exit_code
    except BrokenPipeError:  # `| head` has seen enough
        _let_stdout_go()
        return 0
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        log.critical(
            "a bug of imu-tracker %s: %s: %s%s",
            __version__,
            type(error).__name__,
            " ".join(str(error).split()),
            "" if args.verbose else " (add -v for the details)",
        )
        log.debug("where it comes from:", exc_info=error)
        return BUG
    return code


def _open_missing_streams() -> None:
    """Give what was closed before the start (`2>&-`) a place to go.

    Else Python has None there, and the next file opened would take its descriptor.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            setattr(sys, name, os.fdopen(nowhere, "w", encoding="utf-8"))


def _let_stdout_go() -> None:
    """Keep Python from complaining about stdout once more when it ends."""
    with (
        contextlib.suppress(OSError, ValueError),  # not a file: nothing to do
        Path(os.devnull).open("wb") as nowhere,
    ):
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


class _Talk(logging.Formatter):
    """One line a message: priorities for the journal, words for people."""

    PRIORITIES: Final = {"DEBUG": 7, "INFO": 6, "WARNING": 4, "ERROR": 3, "CRITICAL": 2}
    """What sd-daemon(3) calls SD_DEBUG and so on."""

    def __init__(self, *, is_journal: bool) -> None:
        super().__init__()
        self._is_journal = is_journal

    def format(self, record: logging.LogRecord) -> str:
        text = super().format(record)
        if self._is_journal:
            prefix = f"<{self.PRIORITIES[record.levelname]}>"
            return "\n".join(prefix + line for line in text.splitlines())
        return f"warning: {text}" if record.levelname == "WARNING" else text


def _configure_logging(*, is_verbose: bool, is_quiet: bool) -> None:
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Talk(is_journal=_stderr_is_the_journal()))
    package = logging.getLogger("imu_tracker")
    package.handlers = [handler]
    package.setLevel(
        logging.DEBUG if is_verbose else logging.WARNING if is_quiet else logging.INFO
    )


def _stderr_is_the_journal() -> bool:
    """Tell whether systemd reads our stderr: it says which file that would be."""
    try:
        stat = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError, AttributeError):  # closed, or not a file
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{stat.st_dev}:{stat.st_ino}"
