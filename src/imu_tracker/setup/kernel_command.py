"""cmdline.txt of a Raspberry Pi: taking Linux's console off the receiver's port.

Works on text alone. What a newcomer gets wrong: the file is a single line; a line break
in it, and the Pi does not start.
"""

import re
from typing import Final

from imu_tracker.sensors.pi_advice import is_console_on
from imu_tracker.setup.boot_config import NotUnderstoodError

_ROOT: Final = "root="


def consoles_on(text: str, names: set[str]) -> list[str]:
    """Return the console parameters that claim a port.

    Parameters
    ----------
    text : str
        The whole file.
    names : set of str
        What the port is called in /dev, its link's name and its own.

    Raises
    ------
    NotUnderstoodError
        When this is not one line of kernel parameters.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) != 1:
        raise NotUnderstoodError(f"{len(lines)} lines where there should be one")
    parameters = lines[0].split()
    if not any(parameter.startswith(_ROOT) for parameter in parameters):
        raise NotUnderstoodError("no root= in it")
    if '"' in lines[0]:
        raise NotUnderstoodError("quotation marks in it")
    return [one for one in parameters if is_console_on(one, names)]


def without_consoles(text: str, names: set[str]) -> str:
    """Return the text without the console parameters that claim a port.

    Raises
    ------
    NotUnderstoodError
        As `consoles_on`.
    """
    claims = consoles_on(text, names)
    line = next(line for line in text.splitlines() if line.strip())
    kept = line
    for one in claims:
        kept = re.sub(rf"(?<!\S){re.escape(one)}(?!\S)[ \t]*", "", kept)
    return text.replace(line, kept.rstrip(" \t") if kept != line else line, 1)
