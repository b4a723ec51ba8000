"""config.txt of a Raspberry Pi: what holds on this model, and the smallest edit.

Works on text alone. Facts from the Raspberry Pi documentation, "config.txt":
conditional filters, `dtparam` and `enable_uart`; the last of several lines wins. What a
newcomer gets wrong: a line below `[pi4]` or `[cm5]` does not hold on other models, so a
line that is only appended may never be read.
"""

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from imu_tracker.errors import shown

MODEL_FILTERS: Final = {
    *("pi0", "pi0w", "pi02", "pi1", "pi2", "pi3", "pi3+", "pi4", "pi400"),
    *("pi5", "pi500", "cm0", "cm1", "cm3", "cm3+", "cm4", "cm4s", "cm5"),
}

_FILTERS_OF: Final = (
    (r"Raspberry Pi Zero 2", {"pi0", "pi0w", "pi02"}),
    (r"Raspberry Pi Zero W", {"pi0", "pi0w"}),
    (r"Raspberry Pi Zero", {"pi0"}),
    (r"Raspberry Pi 2 ", {"pi2"}),
    (r"Raspberry Pi 3 Model [AB] Plus", {"pi3", "pi3+"}),
    (r"Raspberry Pi 3 ", {"pi3"}),
    (r"Raspberry Pi Compute Module 3", {"pi3", "cm3", "cm3+"}),
    (r"Raspberry Pi 4 ", {"pi4"}),
    (r"Raspberry Pi 400", {"pi4", "pi400"}),
    (r"Raspberry Pi Compute Module 4S", {"pi4", "cm4s"}),
    (r"Raspberry Pi Compute Module 4", {"pi4", "cm4"}),
    (r"Raspberry Pi 500", {"pi5", "pi500"}),
    (r"Raspberry Pi 5 ", {"pi5"}),
    (r"Raspberry Pi Compute Module 5", {"pi5", "cm5"}),
)
"""How a model calls itself in the device tree, and the filters that it passes."""

_ON: Final = ("on", "true", "yes", "1", "")
_ASSIGNMENT: Final = re.compile(r"[A-Za-z0-9_]+(:\d+)?=.*")
_OTHER: Final = re.compile(r"(initramfs|ramfsfile)\s.*")


class NotUnderstoodError(ValueError):
    """A file holds something that this program cannot judge; says what and where."""


class Setting(NamedTuple):
    """What a line of config.txt shall say; all of the names mean the same."""

    names: tuple[str, ...]
    value: str
    is_parameter: bool  # of the device tree: dtparam=NAME=VALUE

    @property
    def line(self) -> str:
        """The line as it is written."""
        text = f"{self.names[0]}={self.value}"
        return f"dtparam={text}" if self.is_parameter else text

    def is_met_by(self, value: str) -> bool:
        """Tell whether a value that was found says the same."""
        return value == self.value or (self.value in _ON and value in _ON)


class Found(NamedTuple):
    """One place where a setting is made."""

    line: int  # from 0
    value: str
    is_sure: bool  # that it holds on this Pi


class BootConfig:
    """The lines of one config.txt, as one model of Raspberry Pi reads them.

    Parameters
    ----------
    text : str
        The whole file.
    model : str
        What the device tree calls this Pi, like "Raspberry Pi 4 Model B Rev 1.5".

    Raises
    ------
    NotUnderstoodError
        For a line that is none of config.txt, and for `include`: settings may be there.
    """

    def __init__(self, text: str, model: str) -> None:
        self._lines = text.splitlines(keepends=True)
        self._end = "\r\n" if "\r\n" in text else "\n"
        self._filters = filters_of(model)
        self._holds: list[bool | None] = []  # None: nobody can tell
        model_filter, others = "", False
        for number, line in enumerate(map(str.strip, self._lines), start=1):
            if line.startswith("["):
                name = line.removeprefix("[").partition("]")[0]
                if "]" not in line:
                    raise NotUnderstoodError(f"line {number}: {shown(line)}")
                if name == "all":
                    model_filter, others = "", False
                elif name in MODEL_FILTERS or name == "none":
                    model_filter = name
                else:
                    others = True
            elif not _is_known(line):
                raise NotUnderstoodError(f"line {number}: {shown(line)}")
            self._holds.append(self._passes(model_filter, others))
        self._ends_filtered = bool(model_filter) or others

    def _passes(self, model_filter: str, others: bool) -> bool | None:
        if model_filter == "none":
            return False
        if model_filter:
            if self._filters is None:
                return None
            if model_filter not in self._filters:
                return False
        return None if others else True

    def value_of(self, setting: Setting) -> str | None:
        """Return what holds on this Pi; None when nothing is said.

        Raises
        ------
        NotUnderstoodError
            When it depends on a filter that cannot be judged here.
        """
        found = self._deciding(setting)
        return found.value if found else None

    def with_setting(self, setting: Setting) -> str:
        """Return the text with a setting made, by the change of one line or two.

        The line that decides today is changed; without one, the same line behind a `#`
        comes to be; without that, a line is added at the end, below `[all]`.

        Raises
        ------
        NotUnderstoodError
            As `value_of`.
        """
        lines = list(self._lines)
        found = self._deciding(setting)
        if found is not None:
            lines[found.line] = _replaced(lines[found.line], setting)
            return "".join(lines)
        for number, line in enumerate(lines):
            if self._holds[number] and _uncommented(line) == setting.line:
                lines[number] = setting.line + line[len(line.rstrip("\r\n")) :]
                return "".join(lines)
        if lines and not lines[-1].endswith("\n"):
            lines[-1] += self._end
        if self._ends_filtered:
            lines.append(f"[all]{self._end}")
        return "".join([*lines, f"{setting.line}{self._end}"])

    def _deciding(self, setting: Setting) -> Found | None:
        places = list(self._places(setting))
        sure = [place for place in places if place.is_sure]
        unsure = [place for place in places if not place.is_sure]
        last = sure[-1] if sure else None
        for place in unsure:
            if (last is None or place.line > last.line) and not (
                last and place.value == last.value
            ):
                raise NotUnderstoodError(
                    f"line {place.line + 1}: {shown(self._lines[place.line].strip())} "
                    "below a filter that cannot be judged here"
                )
        return last

    def _places(self, setting: Setting) -> Iterator[Found]:
        for number, line in enumerate(self._lines):
            holds = self._holds[number]
            if holds is False:
                continue
            for name, value in _settings(line.strip(), setting.is_parameter):
                if name in setting.names:
                    yield Found(number, value, is_sure=holds is True)


def filters_of(model: str) -> set[str] | None:
    """Return the model filters that a Pi passes; None for a model not known here."""
    for pattern, filters in _FILTERS_OF:
        if re.match(pattern, model):
            return filters
    return None


def is_pi5(model: str) -> bool:
    """Tell whether a Pi has the buses of the fifth generation."""
    return "pi5" in (filters_of(model) or ())


def _is_known(line: str) -> bool:
    return (
        not line
        or line.startswith("#")
        or _ASSIGNMENT.fullmatch(line) is not None
        or _OTHER.fullmatch(line) is not None
    )


def _uncommented(line: str) -> str:
    text = line.strip()
    return text[1:].strip() if text.startswith("#") else ""


_PARAMETERS: Final = ("dtparam=", "device_tree_param=")


def _settings(line: str, is_parameter: bool) -> Iterator[tuple[str, str]]:
    """Split a line into names and values; of the device tree or of the firmware."""
    if line.startswith(_PARAMETERS):
        if is_parameter:
            for part in line.partition("=")[2].split(","):
                name, _, value = part.strip().partition("=")
                yield name, value
    elif not is_parameter and not line.startswith("#"):
        name, _, value = line.partition("=")
        yield name, value


def _replaced(line: str, setting: Setting) -> str:
    """Change one setting of a line, and nothing else of it."""
    body = line.rstrip("\r\n")
    end = line[len(body) :]
    if not setting.is_parameter:
        return setting.line + end
    head, _, parts = body.partition("=")
    wanted = f"{setting.names[0]}={setting.value}"
    changed = [
        wanted if part.strip().partition("=")[0] in setting.names else part
        for part in parts.split(",")
    ]
    return f"{head}={','.join(changed)}{end}"
