"""`imu-tracker tune`: settings that explain recordings best, and how sure."""

import argparse
import logging
from functools import partial
from pathlib import Path

from imu_tracker.commands.common import (
    STDOUT,
    Subparsers,
    add_command,
    add_config,
    config_of,
    refuse_to_overwrite,
    whole_output,
)

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Say which settings explain recordings best: how the box sits, how late the receiver is,
how far its antenna is from the chip, what carries it, how it is fixed, and what a
calibration would take away. Prints TOML, with the interval that holds each value with
95 %; a setting that the recordings do not show is not written, and the comment says
what would show it.

A drive of ten minutes with turns and stops is enough; more recordings of the same
installation make intervals smaller. Takes three to four times as long as `replay`."""

_EXAMPLES = """\
  imu-tracker tune monday.rec tuesday.rec.gz
  imu-tracker tune drive.rec --set filter.profile=vehicle --output tuned.toml"""


def add_tune(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "tune",
        "settings that explain recordings best",
        _DESCRIPTION,
        _EXAMPLES,
    )
    parser.add_argument(
        "recordings",
        type=Path,
        nargs="+",
        metavar="REC",
        help="recordings of one installation, plain or gzip",
    )
    add_config(parser)
    parser.add_argument(
        "--output",
        type=Path,
        default=STDOUT,
        metavar="TOML",
        help="write the settings here; default: stdout",
    )
    parser.set_defaults(run=run_tune)


def run_tune(args: argparse.Namespace) -> int:
    """Track each recording some times, and write what they say together."""
    from imu_tracker.errors import ConfigError
    from imu_tracker.recording.advice import find, toml
    from imu_tracker.recording.files import read_recording

    config = config_of(args)
    if config.filter.estimator != "error-state":
        raise ConfigError(
            f"filter.estimator = {config.filter.estimator}: only error-state learns "
            "settings"
        )
    refuse_to_overwrite([args.output], args.recordings)
    findings = []
    for path in args.recordings:
        log.info("%s", path)
        findings.append(find(config, partial(read_recording, path)))
    with whole_output(args.output) as output:
        for line in toml(findings):
            output.write(f"{line}\n")
    return 0
