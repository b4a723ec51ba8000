"""Print what CHANGELOG.md says of this version; of what is unreleased before that."""

import re
import sys
from pathlib import Path

from imu_tracker import __version__

CHANGELOG = Path(__file__).parents[1] / "CHANGELOG.md"


def notes(changelog: str, version: str) -> str:
    """Return the section of a version, else that of what is unreleased.

    Raises
    ------
    ValueError
        When there is neither.
    """
    sections = re.split(r"^## ", changelog, flags=re.MULTILINE)[1:]
    for wanted in (f"[{version}]", "[Unreleased]"):
        for section in sections:
            if section.startswith(wanted):
                return section.partition("\n")[2].strip() + "\n"
    raise ValueError(f"CHANGELOG.md has no section [{version}] and no [Unreleased]")


if __name__ == "__main__":
    sys.stdout.write(notes(CHANGELOG.read_text("utf-8"), __version__))
