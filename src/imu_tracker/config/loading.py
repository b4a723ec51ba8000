"""Reading the file and the `--set` overrides, and saying what is wrong with them.

All problems are reported at once, one line each, the key first.
"""

import difflib
import json
import textwrap
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from imu_tracker.config.tables import Config, keys
from imu_tracker.errors import ConfigError


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
        return tomllib.loads(path.read_text("utf-8"))
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
    if not (equals and table and key):
        raise ConfigError(
            f"--set {text}: must be TABLE.KEY=VALUE, like filter.profile=vehicle"
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
        return f"{table} = {_toml(tables[table])}: must be a table, [{table}]"
    fields = Config.model_fields[table].annotation.model_fields  # type: ignore[union-attr]
    if key not in fields:
        return f"{table}.{key}: no such key{_hint(key, fields)}"
    value = tables.get(table, {}).get(key, "")
    shown = textwrap.shorten(
        _toml(value, is_hex=key == "address"), 60, placeholder="..."
    )
    where = f"{table}.{key} = {shown}"
    # What we say ourselves begins with "must"; float() and the like know less.
    ours = said if said.startswith("must") else f"must be {fields[key].description}"
    return f"{where}: {ours}"


def _unknown(name: str, value: Any) -> str:
    if isinstance(value, dict):
        return f"[{name}]: no such table{_hint(name, Config.model_fields)}"
    homes = [f"[{table}]" for table, key, _ in keys() if key == name]
    advice = f"it belongs below {' or '.join(homes)}" if homes else "every key has one"
    return f"{name} = {_toml(value)}: stands outside of a table; {advice}"


def _hint(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {near[0]}?" if near else f"; there are {', '.join(known)}"


def _toml(value: Any, *, is_hex: bool = False) -> str:
    """Write a value as the file would."""
    match value:
        case bool() | str():
            return json.dumps(value, ensure_ascii=False)
        case int() if is_hex:
            return f"0x{value:02X}"
        case list():
            return f"[{', '.join(map(_toml, value))}]"
        case dict():
            return "{...}"
        case _:
            return str(value)
