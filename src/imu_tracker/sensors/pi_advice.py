"""How to mend what a Pi has not been told yet: a command to type, each time.

Only reads what the system says about itself. What a newcomer gets wrong: each of these
looks the same, a device that does not open; and half of them need a restart or a new
login before they hold, so the advice says that, too.
"""

import grp
import os
import pwd
from contextlib import suppress
from pathlib import Path
from typing import Final

BOOT_CONFIGS: Final = (Path("/boot/firmware/config.txt"), Path("/boot/config.txt"))
ADAPTERS: Final = Path("/sys/bus/i2c/devices")
CMDLINE: Final = Path("/proc/cmdline")

UARTS: Final = ("serial0", "ttyAMA0", "ttyS0", "ttyAMA10")
_ROOT: Final = 0


def join_group(path: Path, usual: str) -> str:
    """Say how this user may come to use a file of a group.

    Parameters
    ----------
    path : Path
        The file that may not be opened.
    usual : str
        The group that such a file has where udev rules are in order.
    """
    group = usual
    with suppress(OSError, KeyError):
        gid = path.stat().st_gid
        group = grp.getgrgid(gid).gr_name if gid != _ROOT else usual
    user, members = _user(), []
    with suppress(KeyError):
        members = grp.getgrnam(group).gr_mem
    if user in members:
        return f"{user} is in the group {group}, but this session is not: log in again"
    return (
        f"put {user} into the group {group}: sudo usermod -aG {group} {user}, "
        "and log in again"
    )


def _user() -> str:
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return "USER"


def own_directory(directory: Path) -> str:
    """Say how this user may come to write files in a directory."""
    user = _user()
    with suppress(OSError, KeyError):
        found = directory.stat()
        owner = pwd.getpwuid(found.st_uid).pw_name
        if _ROOT != found.st_uid != os.geteuid():
            return f"it is {owner}'s: run this as {owner}, with sudo -u {owner}"
    return f"sudo install -d -m 750 -o {user} -g {user} {directory}"


def switch_i2c_on(number: int) -> str:
    """Say how a bus that does not exist comes to be: module, overlay, restart."""
    if (ADAPTERS / f"i2c-{number}").exists():
        return "load its driver: sudo modprobe i2c-dev"
    if any("i2c_arm=on" in _settings(path) for path in BOOT_CONFIGS):
        return "I2C is on from the next start: sudo reboot"
    return (
        "switch I2C on: sudo raspi-config nonint do_i2c 0 (that is dtparam=i2c_arm=on "
        "in config.txt), and restart"
    )


def switch_uart_on() -> str:
    """Say how the serial port of the header comes to be."""
    if any("enable_uart=1" in _settings(path) for path in BOOT_CONFIGS):
        return "the serial port is on from the next start: sudo reboot"
    return (
        "switch the serial port on: sudo raspi-config nonint do_serial_hw 0 (that is "
        "enable_uart=1 in config.txt), and restart"
    )


def switch_console_off() -> str:
    """Say how Linux lets go of the serial port of the header."""
    return (
        "switch it off: sudo raspi-config nonint do_serial_cons 1 (that takes "
        "console=serial0 out of cmdline.txt), and restart"
    )


def console_on(port: str) -> str | None:
    """Return the kernel's console parameter that claims this port, if one does."""
    try:
        parameters = CMDLINE.read_text("ascii").split()
    except (OSError, UnicodeDecodeError):
        return None
    names = {Path(port).name, Path(port).resolve().name}
    return next((one for one in parameters if is_console_on(one, names)), None)


def is_console_on(parameter: str, names: set[str]) -> bool:
    """Tell whether a kernel parameter claims the port of these names in /dev."""
    key, _, value = parameter.partition("=")
    console = value.partition(",")[0]
    return key == "console" and (
        console in names or (console == "serial0" and bool(names & set(UARTS)))
    )


def _settings(path: Path) -> set[str]:
    """Return the settings of a config.txt, `dtparam=a,b=c` as `a` and `b=c`."""
    try:
        lines = path.read_text("utf-8", "replace").splitlines()
    except OSError:
        return set()
    active = (line.strip() for line in lines)
    return {
        part.strip()
        for line in active
        if not line.startswith("#")
        for part in line.removeprefix("dtparam=").split(",")
    }
