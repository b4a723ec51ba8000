"""Write the man page and the completions of three shells, from the parser itself.

    python packaging/documents.py FOLDER

Needs argparse-manpage and shtab (`pip install -e '.[package]'`); a Pi needs neither.
"""

import argparse
import os
import sys
from pathlib import Path

import shtab
from argparse_manpage.manpage import Manpage

from imu_tracker import RELEASE_DATE, __version__
from imu_tracker.cli import build_parser

FILES = ("FILE", "REC", "LOG", "CSV", "PNG", "HTML", "PATH")
"""Names of arguments for which a shell offers files."""

NAMES = {"bash": "imu-tracker", "zsh": "_imu-tracker", "fish": "imu-tracker.fish"}


def offer_files(parser: argparse.ArgumentParser) -> None:
    """Let the shells complete file names where a file is meant."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in set(action.choices.values()):
                offer_files(command)
        elif str(action.metavar) in FILES or action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]


def man_page(parser: argparse.ArgumentParser) -> str:
    """Return the man page, dated by the release."""
    page = Manpage(parser, format="single-commands-section")
    page.date, page.manual = RELEASE_DATE, "User Commands"
    page.source = f"imu-tracker {__version__}"
    page.description = "track a position with an MPU-6050 and a GPS receiver"
    return str(page)


def main() -> int:
    """Write them."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["COLUMNS"] = "80"
    (folder / "imu-tracker.1").write_text(man_page(build_parser()), "utf-8")
    parser = build_parser()
    offer_files(parser)
    for shell, name in NAMES.items():
        path = folder / shell / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(shtab.complete(parser, shell=shell) + "\n", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
