"""The error tree: everything that a user or a device can cause.

Faults are exceptions, weather is not: a late fix or a bad checksum is an outcome
and a counter. Each error says what failed, where, what was expected and what to do
next, and knows the exit code (sysexits.h) of a command that it ends.
"""

MAX_SHOWN = 60
"""Characters of somebody else's text in a message."""


def shown(text: str) -> str:
    """Return the beginning of somebody else's text, which may hold anything."""
    short = text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."
    if short.isprintable():
        return short
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in short)


class TrackerError(Exception):
    """Base of all errors that are not bugs of the program."""

    exit_code = 70


class UsageError(TrackerError, ValueError):
    """The command line does not make sense."""

    exit_code = 2


class ConfigError(TrackerError, ValueError):
    """The configuration is wrong: key, value, what is allowed."""

    exit_code = 78


class BusError(TrackerError):
    """An I2C transfer failed; keeps the address and register for the log."""

    exit_code = 69

    def __init__(self, action: str, address: int, register: int) -> None:
        self.address, self.register = address, register
        where = f"address 0x{address:02X}, register 0x{register:02X}"
        super().__init__(f"I2C {action} failed at {where}")


class DeviceNotFoundError(TrackerError):
    """Nobody, or somebody else, answers where the device should be."""

    exit_code = 69


class NotRunningError(TrackerError):
    """There is no daemon to ask, or it hangs."""

    exit_code = 69


class NmeaError(TrackerError, ValueError):
    """One line of the receiver is not a sentence; `trouble` is how it is counted."""

    def __init__(self, trouble: str, line: bytes) -> None:
        self.trouble = trouble
        super().__init__(f"{trouble.replace('_', ' ')}: {line!r}")


class RecordingError(TrackerError, ValueError):
    """A recording is malformed: path:line and what was expected."""

    exit_code = 65


class LogError(TrackerError, ValueError):
    """A lat/long log is malformed: path:line and what was expected."""

    exit_code = 65


class RouteError(TrackerError, ValueError):
    """A route cannot be followed: which file, why."""

    exit_code = 65


class CalibrationError(TrackerError, ValueError):
    """A calibration cannot be used or made: which axis or pose, what to do."""

    exit_code = 65


class StateError(TrackerError, ValueError):
    """What an earlier run learnt cannot be begun with: which file, why."""

    exit_code = 65


class InputMissingError(TrackerError, FileNotFoundError):
    """A file that the command should read is not there."""

    exit_code = 66


class OutputError(TrackerError, OSError):
    """An output cannot be opened or written: which file, why."""

    exit_code = 73
