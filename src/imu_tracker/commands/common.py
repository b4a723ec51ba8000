"""What the commands share: arguments, outputs and the little words of the tables."""

import argparse
import contextlib
import logging
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias, TypeVar

from imu_tracker.errors import OutputError, UsageError

if TYPE_CHECKING:
    from imu_tracker.config import Config

T = TypeVar("T")

INSTALLED: Final = Path("/etc/imu-tracker/imu-tracker.toml")
"""The configuration of the service."""

STDOUT: Final = Path("-")

Subparsers: TypeAlias = "argparse._SubParsersAction[Any]"


def add_command(
    subparsers: Subparsers, name: str, summary: str, description: str, examples: str
) -> argparse.ArgumentParser:
    """Add a command with the options that all of them have."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        name,
        help=summary,
        description=description,
        epilog=f"examples:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    talk = parser.add_mutually_exclusive_group()
    talk.add_argument("-v", "--verbose", action="store_true", help="say more")
    talk.add_argument(
        "-q", "--quiet", action="store_true", help="say only what is wrong"
    )
    return parser


def add_config(parser: argparse.ArgumentParser, *, required: bool = False) -> None:
    """Add `--config` and `--set`."""
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        required=required,
        help="the configuration (TOML); config/imu-tracker.toml explains every key",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        dest="overrides",
        help="overrule one key of the configuration, like filter.profile=vehicle; "
        "may be given again",
    )


def config_of(args: argparse.Namespace) -> "Config":
    """Load what `--config` and `--set` say."""
    from imu_tracker.config import load_config

    return load_config(args.config, args.overrides)


def installed_config_of(args: argparse.Namespace) -> "Config":
    """Load the same; without `--config` that of the service, where there is one."""
    if args.config is None and INSTALLED.exists():
        args.config = INSTALLED
    return config_of(args)


def positive(text: str) -> float:
    """Parse a number above zero, for argparse."""
    with contextlib.suppress(ValueError):
        number = float(text)
        if 0 < number < math.inf:
            return number
    raise argparse.ArgumentTypeError(f"{text!r}: must be a number above 0")


def new_file(text: str) -> Path:
    """Parse the name of a file to write, where stdout will not do, for argparse."""
    if text == str(STDOUT):
        raise argparse.ArgumentTypeError("must be a file, not stdout")
    return Path(text)


def whole_from(least: int) -> Callable[[str], int]:
    """Return a parser of whole numbers, for argparse."""

    def parse(text: str) -> int:
        with contextlib.suppress(ValueError):
            if int(text) >= least:
                return int(text)
        raise argparse.ArgumentTypeError(
            f"{text!r}: must be a whole number, {least} or more"
        )

    return parse


def refuse_to_overwrite(
    outputs: Sequence[Path | None], inputs: Sequence[Path | None]
) -> None:
    """Refuse an output that is an input, or another output, of the same command."""
    taken = {path.resolve() for path in inputs if path is not None}
    for path in outputs:
        if path is None or path == STDOUT:
            continue
        if path.resolve() in taken:
            raise UsageError(f"{path}: would be overwritten; choose another output")
        taken.add(path.resolve())


def write(text: str) -> None:
    """Write data to stdout."""
    Output(STDOUT).write(text)


def progress(
    items: Iterable[T], args: argparse.Namespace, unit: str, total: int | None = None
) -> Iterator[T]:
    """Show on a terminal how far a stream has come; elsewhere just pass it on."""
    if args.quiet or not sys.stderr.isatty():
        yield from items
        return
    from tqdm import tqdm
    from tqdm.contrib.logging import logging_redirect_tqdm

    with logging_redirect_tqdm([logging.getLogger("imu_tracker")]):
        yield from tqdm(items, unit=unit, total=total, unit_scale=True, leave=False)


class Output:
    """A text file that is written anew, or stdout for "-"; a context manager.

    Raises
    ------
    OutputError
        For whatever the disk refuses, on opening and later.
    """

    def __init__(self, path: Path, name: str = "") -> None:
        self._name = name or ("stdout" if path == STDOUT else str(path))
        with self._errors():
            self._file = (
                sys.stdout
                if path == STDOUT
                else path.open("w", encoding="utf-8", newline="\n")
            )

    def write(self, text: str) -> None:
        """Write text as it is."""
        with self._errors():
            self._file.write(text)

    def flush(self) -> None:
        """Let the reader of a pipe see what was written."""
        with self._errors():
            self._file.flush()

    def close(self) -> None:
        """Close the file; stdout stays open."""
        with self._errors():
            if self._file is sys.stdout:
                self._file.flush()
            else:
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextlib.contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            raise  # the reader has seen enough: no error
        except OSError as error:
            raise OutputError(f"{self._name}: {error.strerror or error}") from error


@contextlib.contextmanager
def whole_output(path: Path) -> Iterator[Output]:
    """Open an output that stands under its name only when it is whole.

    Stdout, pipes and devices are written as they are.

    Raises
    ------
    OutputError
        For whatever the disk refuses.
    """
    if path == STDOUT or (path.exists() and not path.is_file()):
        with Output(path) as output:
            yield output
        return
    target = path.resolve()  # a link stays one
    unfinished = target.with_name(f".{target.name}.{os.getpid()}.new")
    try:
        with Output(unfinished, str(path)) as output:
            yield output
        try:
            unfinished.replace(target)
        except OSError as error:
            raise OutputError(f"{path}: {error.strerror or error}") from error
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink(missing_ok=True)
