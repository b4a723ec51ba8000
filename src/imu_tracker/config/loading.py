"""Reading the file and the `--set` overrides, and saying what is wrong with them.

All problems are reported at once, one line each, the key first.
"""

import difflib
import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from imu_tracker.config.tables import Config, keys
from imu_tracker.errors import ConfigError, shown

MAX_FILE_BYTES: Final = 100_000
"""Ten times the documented file; also of a device, which would never end."""

MAX_LINE_BYTES: Final = 5000
"""More than the longest path of Linux."""


def load_config(path: Path | None = None, overrides: Sequence[str] = ()) -> Config:
    """Read the file, lay the `--set` overrides over it, and check everything.

    Raises
    ------
    ConfigError
        With every problem, a line each. A missing file is one, too: a service
        must not be started again and again for it.
    """
    tables = _read(path) if path is not None else {}
    problems = []
    for text in overrides:
        try:
            table, key, value = _parse_override(text)
        except ConfigError as error:
            problems.append(str(error))
            continue
        if isinstance(known := tables.setdefault(table, {}), dict):
            known[key] = value
    try:
        config = Config.model_validate(tables)
    except ValidationError as error:
        problems += _describe(error.errors(), tables)
    if problems:
        raise ConfigError("\n".join(problems))
    return config


def _read(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
        if len(data) > MAX_FILE_BYTES:
            raise ConfigError(f"{path}: longer than {MAX_FILE_BYTES} bytes")
        # tomllib takes time by the square of the dots in a key.
        for number, text in enumerate(data.split(b"\n"), 1):
            if len(text) > MAX_LINE_BYTES:
                raise ConfigError(
                    f"{path}: line {number}: longer than {MAX_LINE_BYTES} bytes"
                )
        return tomllib.loads(data.decode("utf-8-sig"))
    except ConfigError:
        raise
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: no such file") from error
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"{path}: line {line}: not UTF-8 text") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: {_toml_problem(error)}") from error


def _toml_problem(error: Exception) -> str:
    """Put the place first: `line 3, column 7: invalid value`."""
    what, _, where = str(error).rpartition(" (at ")
    where = where.rstrip(")").replace("end of document", "end of the file")
    return f"{where}: {what[:1].lower()}{what[1:]}" if what else str(error)


def _parse_override(text: str) -> tuple[str, str, Any]:
    """Split `table.key=value`; a value that is not TOML is a bare word."""
    name, equals, value = text.partition("=")
    table, _, key = name.strip().partition(".")
    is_text = name.encode(errors="replace").decode() == name  # or bytes of a shell
    if not (equals and table and key and is_text):
        raise ConfigError(
            f"--set {shown(text)}: must be TABLE.KEY=VALUE, like filter.profile=vehicle"
        )
    try:
        parsed = tomllib.loads(f"value = {value.strip()}")
    except (ValueError, RecursionError):
        parsed = {}
    return table, key, parsed["value"] if len(parsed) == 1 else value.strip()


def _describe(errors: Iterable[ErrorDetails], tables: Mapping[str, Any]) -> list[str]:
    """Turn pydantic's findings into our lines, one for each key."""
    lines = {error["loc"][:2]: "" for error in errors}
    for error in errors:
        loc = error["loc"][:2]
        lines[loc] = lines[loc] or _line(error, tables)
    return list(lines.values())


def _line(error: ErrorDetails, tables: Mapping[str, Any]) -> str:
    table, key, *_ = [str(part) for part in error["loc"][:2]] + ["", ""]
    said = str(error["ctx"]["error"]) if error["type"] == "value_error" else ""
    if not table:
        return said
    if table not in Config.model_fields:
        return _unknown(table, tables[table])
    if not key:
        return f"{table} = {_shown(tables[table])}: must be a table, [{table}]"
    fields = Config.model_fields[table].annotation.model_fields  # type: ignore[union-attr]
    if key not in fields:
        return f"{table}.{shown(key)}: no such key{_hint(key, fields)}"
    value = tables.get(table, {}).get(key, "")
    where = f"{table}.{key} = {_shown(value, is_hex=key == 'address')}"
    # What we say ourselves begins with "must"; float() and the like know less.
    ours = said if said.startswith("must") else f"must be {fields[key].description}"
    return f"{where}: {ours}"


def _unknown(name: str, value: Any) -> str:
    if isinstance(value, dict):
        return f"[{shown(name)}]: no such table{_hint(name, Config.model_fields)}"
    homes = [f"[{table}]" for table, key, _ in keys() if key == name]
    advice = f"it belongs below {' or '.join(homes)}" if homes else "every key has one"
    return f"{shown(name)} = {_shown(value)}: stands outside of a table; {advice}"


def _hint(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {near[0]}?" if near else f"; there are {', '.join(known)}"


def _shown(value: Any, *, is_hex: bool = False) -> str:
    """Write the beginning of a value in one line."""
    return shown(" ".join(_toml(value, is_hex=is_hex).split()))


def _toml(value: Any, *, is_hex: bool = False) -> str:
    """Write a value as the file would."""
    match value:
        case bool() | str():
            return json.dumps(value, ensure_ascii=False)
        case int() if is_hex or value.bit_length() > 64:
            return f"0x{value:02X}"  # str() refuses 4300 digits and more
        case list():
            return f"[{', '.join(map(_toml, value))}]"
        case dict():
            return "{...}"
        case _:
            return str(value)
