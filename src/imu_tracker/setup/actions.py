"""What a step does: start a program, or change one file.

Each says what it will do before, and how it is undone. The only place of the program
that starts others: by a list of words, never through a shell.
"""

import difflib
import os
import shlex
import subprocess
from pathlib import Path
from typing import Final, NamedTuple

from imu_tracker.errors import OutputError

COPY: Final = ".before-imu-tracker"
"""What is put behind the name of a file for the copy of how it was."""

NEW_FILE_MODE: Final = 0o644


class Command(NamedTuple):
    """Start a program."""

    words: tuple[str, ...]
    undone_by: tuple[str, ...]

    def lines(self) -> list[str]:
        """Say what it will do."""
        return [f"$ {shlex.join(self.words)}"]

    def undo(self) -> str:
        """Say how it is undone."""
        return f"sudo {shlex.join(self.undone_by)}"

    def run(self) -> None:
        """Do it.

        Raises
        ------
        OutputError
            When the program is missing, or ends with another code than 0.
        """
        try:
            subprocess.run(self.words, check=True, stdin=subprocess.DEVNULL)
        except (OSError, subprocess.CalledProcessError) as error:
            raise OutputError(f"{shlex.join(self.words)}: {error}") from error


class Edit(NamedTuple):
    """Replace the text of a file, or make the file; a copy of how it was stays."""

    path: Path
    before: str | None  # None: there is no such file
    after: str

    def lines(self) -> list[str]:
        """Say what it will do, line by line."""
        old = (self.before or "").splitlines()
        changes = difflib.unified_diff(old, self.after.splitlines(), n=0, lineterm="")
        shown = [line for line in changes if not line.startswith(("---", "+++", "@@"))]
        return [f"edit {self.path}", *(f"  {line[0]} {line[1:]}" for line in shown)]

    def undo(self) -> str:
        """Say how it is undone."""
        if self.before is None:
            return f"sudo rm {shlex.quote(str(self.path))}"
        words = ("sudo", "cp", str(self.path) + COPY, str(self.path))
        return shlex.join(words)

    def run(self) -> None:
        """Do it, unless the file is no longer what was read.

        The partition of the boot files is FAT: a rename there is no more atomic than it
        can be, so the copy is on the disk first.

        Raises
        ------
        OutputError
            For whatever the disk refuses, and for a file that changed meanwhile.
        """
        try:
            if self.before is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
            elif _read(self.path) != self.before:
                raise OutputError(f"{self.path}: somebody else changes it: again")
            _replace(self.path, self.after)
        except OSError as error:
            if isinstance(error, OutputError):
                raise
            raise OutputError(f"{self.path}: {error.strerror or error}") from error

    def keep_copy(self) -> None:
        """Put a copy of the file beside it; the first edit of a file does this.

        Raises
        ------
        OutputError
            For whatever the disk refuses.
        """
        if self.before is None:
            return
        try:
            _replace(self.path.with_name(self.path.name + COPY), self.before)
        except OSError as error:
            raise OutputError(f"{self.path}{COPY}: {error.strerror}") from error


Action = Command | Edit


def read_text(path: Path) -> str:
    """Return the text of a file, its line ends as they are.

    Raises
    ------
    OSError, UnicodeDecodeError
        When it cannot be read.
    """
    return _read(path)


def _read(path: Path) -> str:
    with path.open(encoding="utf-8", newline="") as file:
        return file.read()


def _replace(path: Path, text: str) -> None:
    """Write beside, force to the disk, rename; owner and mode stay what they are."""
    new = path.with_name(f".{path.name}.new")
    mode = path.stat().st_mode & 0o777 if path.exists() else NEW_FILE_MODE
    try:
        with new.open("w", encoding="utf-8", newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        new.chmod(mode)
        new.replace(path)
    except OSError:
        new.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
