"""The steps from a fresh Raspberry Pi OS to sensors that answer.

Each looks at the machine as it is now, and returns what is to do, or that nothing is.
Sources: the Raspberry Pi documentation ("config.txt", "Configure UARTs"), the README of
the firmware's overlays (dtparam), and for the Pi 5 that its primary serial port is on
the debug connector unless `uart0_console` moves it to pins 8 and 10.
"""

from collections.abc import Callable, Iterator
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from imu_tracker.config import Config
from imu_tracker.sensors.pi_advice import UARTS
from imu_tracker.setup.actions import Action, Command, Edit, read_text
from imu_tracker.setup.boot_config import (
    BootConfig,
    NotUnderstoodError,
    Setting,
    filters_of,
    is_pi5,
)
from imu_tracker.setup.kernel_command import consoles_on, without_consoles
from imu_tracker.setup.machine import Machine

HEADER_BUS: Final = 1  # pins 3 and 5 of every Pi with 40 pins
FAST_HZ: Final = 400_000

I2C_ON: Final = Setting(("i2c_arm", "i2c"), "on", is_parameter=True)
I2C_FAST: Final = Setting(
    ("i2c_arm_baudrate", "i2c_baudrate"), str(FAST_HZ), is_parameter=True
)
UART_ON: Final = Setting(("enable_uart",), "1", is_parameter=False)
PI5_SERIAL0: Final = Setting(("uart0_console",), "on", is_parameter=True)
PI5_UART0: Final = Setting(("uart0", "uart0_console"), "on", is_parameter=True)

_GROUPS: Final = {
    "i2c": "use the I2C bus",
    "dialout": "use the serial port",
    "imu-tracker": "read the log and the status",
}
MODULE: Final = "i2c-dev"
MODULE_FILE: Final = Path("etc/modules-load.d/imu-tracker.conf")


class State(StrEnum):
    """How one thing is."""

    OK = "ok"
    TO_DO = "to do"
    AT_RESTART = "restart"  # made already; it holds from the next start on
    BY_HAND = "by hand"


class Step(NamedTuple):
    """One thing that the sensors need."""

    what: str
    state: State
    text: str
    action: Action | None = None
    holds_after: str = ""  # "restart", "login" or "" for at once


def steps(config: Config, machine: Machine) -> Iterator[Callable[[], Step]]:
    """Return the steps in their order; each looks anew when it is called."""
    port = Path(config.gps.port)
    if config.source.kind != "hardware":
        text = f"source.kind = {config.source.kind}: no sensors, nothing to switch on"
        yield lambda: Step("sensors", State.OK, text)
        return
    if not machine.is_pi:
        text = "no Raspberry Pi: switch I2C and the serial port on by its own manual"
        yield lambda: Step("boot files", State.BY_HAND, text)
    elif config.imu.bus != HEADER_BUS:
        text = f"imu.bus = {config.imu.bus} is not that of pins 3 and 5"
        yield lambda: Step("I2C", State.BY_HAND, text)
    else:
        yield lambda: _i2c(machine)
        yield lambda: _i2c_clock(machine)
    if machine.is_pi and "://" not in config.gps.port:
        if port.name in UARTS:
            yield lambda: _uart(machine, config.gps.port)
            yield lambda: _console(machine, config.gps.port)
        else:
            text = f"{config.gps.port} is not that of pins 8 and 10: nothing to do"
            yield lambda: Step("serial port", State.OK, text)
    yield lambda: _module(machine, config.imu.bus)
    for name in _GROUPS:
        yield partial(_group, machine, name)


def _i2c(machine: Machine) -> Step:
    is_there = machine.device(f"dev/i2c-{HEADER_BUS}").exists()
    return _boot_setting("I2C", machine, I2C_ON, is_there)


def _i2c_clock(machine: Machine) -> Step:
    what = "I2C clock"
    clock_hz = machine.i2c_clock_hz(HEADER_BUS)
    step = _boot_setting(what, machine, I2C_FAST, clock_hz == FAST_HZ)
    if step.state is State.TO_DO and (value := _value(machine, I2C_FAST)):
        return Step(what, State.OK, f"{value} Hz, set by somebody: left as it is")
    return step


def _uart(machine: Machine, port: str) -> Step:
    what, name = "serial port", Path(port).name
    if filters_of(machine.model) is None:
        return Step(what, State.BY_HAND, f"unknown model: {machine.model}")
    if not is_pi5(machine.model):
        return _boot_setting(what, machine, UART_ON, machine.device(port).exists())
    if name not in ("serial0", "ttyAMA0"):
        text = f"{port} is not that of pins 8 and 10: set gps.port to /dev/serial0"
        return Step(what, State.BY_HAND, text)
    setting = PI5_SERIAL0 if name == "serial0" else PI5_UART0
    is_there = machine.device(port).exists() and "ttyAMA0" in machine.names_of(port)
    return _boot_setting(what, machine, setting, is_there)


def _boot_setting(
    what: str, machine: Machine, setting: Setting, is_in_effect: bool
) -> Step:
    """Return how one setting of config.txt is, and the edit that makes it."""
    path = machine.boot_file("config.txt")
    if path is None:
        return Step(what, State.BY_HAND, "there is no config.txt: is /boot mounted?")
    try:
        text = read_text(path)
        boot = BootConfig(text, machine.model)
        value = boot.value_of(setting)
        if value is not None and setting.is_met_by(value):
            if is_in_effect:
                return Step(what, State.OK, f"{setting.line} in {path}")
            return Step(what, State.AT_RESTART, f"{setting.line} in {path}")
        if value is None and is_in_effect:
            return Step(what, State.OK, "it is there already")
        edit = Edit(path, text, boot.with_setting(setting))
    except (NotUnderstoodError, UnicodeDecodeError, OSError) as error:
        text = f"{path}: {error}: left as it is; add {setting.line} yourself"
        return Step(what, State.BY_HAND, text)
    return Step(what, State.TO_DO, _WHY[setting], edit, "restart")


_WHY: Final = {
    I2C_ON: "the I2C bus of pins 3 and 5 is off",
    I2C_FAST: "the bus runs at 100 kHz; at 400 kHz a sample takes a quarter of that",
    UART_ON: "the serial port of pins 8 and 10 is off",
    PI5_SERIAL0: "/dev/serial0 is the debug connector, not pins 8 and 10",
    PI5_UART0: "the serial port of pins 8 and 10 is off",
}


def _value(machine: Machine, setting: Setting) -> str | None:
    path = machine.boot_file("config.txt")
    if path is None:
        return None
    return BootConfig(read_text(path), machine.model).value_of(setting)


def _console(machine: Machine, port: str) -> Step:
    what = "console"
    path = machine.boot_file("cmdline.txt")
    if path is None:
        return Step(what, State.BY_HAND, "there is no cmdline.txt: is /boot mounted?")
    names = machine.names_of(port)
    if is_pi5(machine.model) and Path(port).name != "ttyAMA10":
        names = names - {"ttyAMA10"} | {"ttyAMA0"}  # what serial0 will be
    try:
        text = read_text(path)
        claims = consoles_on(text, names)
        edit = Edit(path, text, without_consoles(text, names))
    except (NotUnderstoodError, UnicodeDecodeError, OSError) as error:
        text = f"{path}: {error}: left as it is; take console=serial0 out yourself"
        return Step(what, State.BY_HAND, text)
    if claims:
        text = f"Linux uses the port for its console ({' '.join(claims)})"
        return Step(what, State.TO_DO, text, edit, "restart")
    try:
        running = read_text(machine.device("proc/cmdline"))
        is_in_effect = not consoles_on(running, names)
    except (NotUnderstoodError, UnicodeDecodeError, OSError):
        is_in_effect = True
    state = State.OK if is_in_effect else State.AT_RESTART
    return Step(what, state, "no console on the port")


def _module(machine: Machine, bus: int) -> Step:
    what = "I2C driver"
    if machine.loads_module(MODULE):
        return Step(what, State.OK, f"{MODULE} is loaded at each start")
    if not machine.is_pi and machine.device(f"dev/i2c-{bus}").exists():
        return Step(what, State.OK, f"/dev/i2c-{bus} is there")
    path = machine.root / MODULE_FILE
    if path.exists():
        return Step(what, State.BY_HAND, f"{path}: left as it is; add {MODULE} to it")
    edit = Edit(path, None, f"{MODULE}\n")
    text = f"the driver {MODULE} is not loaded at the start"
    return Step(what, State.TO_DO, text, edit, "restart")


def _group(machine: Machine, name: str) -> Step:
    what = f"group {name}"
    if not machine.user:
        return Step(
            what, State.OK, "root needs none: run it with sudo, as the user that shall"
        )
    if not machine.lacks_group(name):
        return Step(what, State.OK, f"{machine.user} is in it, or there is none")
    command = Command(
        ("gpasswd", "--add", machine.user, name),
        ("gpasswd", "--delete", machine.user, name),
    )
    text = f"{machine.user} may not {_GROUPS[name]}"
    return Step(what, State.TO_DO, text, command, "login")
