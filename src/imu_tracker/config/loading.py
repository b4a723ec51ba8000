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

from imu_tracker.config.publishing import PublishConfig
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
        if table == "publish":
            table, _, key = key.partition(".")
            _destination(tables, table)[key] = value
        elif isinstance(known := tables.setdefault(table, {}), dict):
            known[key] = value
    try:
        config = Config.model_validate(tables)
    except ValidationError as error:
        problems += _describe(error.errors(), tables)
    if problems:
        raise ConfigError("\n".join(problems))
    return config


def _destination(tables: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the `[[publish]]` of a name, a new one if there is none."""
    known = tables.setdefault("publish", [])
    if not isinstance(known, list):
        return {}  # refused anyway
    for table in known:
        if isinstance(table, dict) and table.get("name") == name:
            return table
    known.append({"name": name})
    return known[-1]  # type: ignore[no-any-return]


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
    if table == "publish" and not all(key.partition(".")):
        raise ConfigError(
            f"--set {shown(text)}: must be publish.NAME.KEY=VALUE, like "
            "publish.home.moving_s=30"
        )
    try:
        parsed = tomllib.loads(f"value = {value.strip()}")
    except (ValueError, RecursionError):
        parsed = {}
    return table, key, parsed["value"] if len(parsed) == 1 else value.strip()


def _describe(errors: Iterable[ErrorDetails], tables: Mapping[str, Any]) -> list[str]:
    """Turn pydantic's findings into our lines, one for each key."""
    lines: dict[tuple[int | str, ...], str] = {}
    for error in errors:
        place = error["loc"][: 3 if error["loc"][:1] == ("publish",) else 2]
        lines[place] = lines.get(place) or _line(error, tables)
    return list(lines.values())


def _line(error: ErrorDetails, tables: Mapping[str, Any]) -> str:
    if error["loc"][:1] == ("publish",):
        return _line_of_destination(error, tables["publish"])
    table, key, *_ = [str(part) for part in error["loc"][:2]] + ["", ""]
    if not table:
        return _said(error)
    if table not in Config.model_fields:
        return _unknown(table, tables[table])
    if not key:
        return f"{table} = {_shown(tables[table])}: must be a table, [{table}]"
    fields = Config.model_fields[table].annotation.model_fields  # type: ignore[union-attr]
    return _line_of_key(error, table, fields, tables.get(table, {}))


def _line_of_destination(error: ErrorDetails, tables: Any) -> str:
    """Name a destination by its name, or by its place where it has none."""
    _, *place = error["loc"]
    if not place:
        return f"publish = {_shown(tables)}: must be tables, [[publish]]"
    number = int(place[0])
    table = tables[number]
    if not isinstance(table, dict):
        return f"publish = {_shown(table)}: must be a table, [[publish]]"
    name = table.get("name")
    label = name if isinstance(name, str) and name.isidentifier() else number + 1
    where = f"publish.{label}"
    if not place[1:]:
        return f"{where}: {_said(error)}"
    return _line_of_key(error, where, PublishConfig.model_fields, table, place[1:])


def _line_of_key(
    error: ErrorDetails,
    table: str,
    fields: Mapping[str, Any],
    values: Mapping[str, Any],
    place: Sequence[int | str] | None = None,
) -> str:
    key = str((error["loc"][1:] if place is None else place)[0])
    if key not in fields:
        return f"{table}.{shown(key)}: no such key{_hint(key, fields)}"
    if error["type"] == "missing" and key not in values:
        return f"{table}.{key}: is missing; must be {fields[key].description}"
    said = _said(error)
    where = f"{table}.{key} = {_shown(values.get(key, ''), is_hex=key == 'address')}"
    if "password" in said:  # what is refused for holding one is not repeated
        where = f"{table}.{key}"
    # What we say ourselves begins with "must"; float() and the like know less.
    ours = said if said.startswith("must") else f"must be {fields[key].description}"
    return f"{where}: {ours}"


def _said(error: ErrorDetails) -> str:
    return str(error["ctx"]["error"]) if error["type"] == "value_error" else ""


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
