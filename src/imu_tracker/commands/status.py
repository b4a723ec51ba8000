"""`imu-tracker status`: what the running daemon is doing."""

import argparse
import json
import logging
import math
import sys
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    config_of,
    write,
)
from imu_tracker.errors import NotRunningError, TrackerError
from imu_tracker.sensors import pi_advice as mending
from imu_tracker.storage import status_file

if TYPE_CHECKING:
    from imu_tracker.config import Config
    from imu_tracker.guidance.guide import Guide

log = logging.getLogger(__name__)

_CLEAR: Final = "\x1b[H\x1b[2J"

_DESCRIPTION = """\
Show what the running daemon is doing: the last row, the sensors, the counters. Exit
code 69 when no daemon runs, when it hangs, or while its rows are not written."""

_EXAMPLES = """\
  imu-tracker status
  imu-tracker status --watch
  imu-tracker status --config config/demo.toml
  imu-tracker status --json | jq .row"""


def add_status(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "status", "what the daemon is doing", _DESCRIPTION, _EXAMPLES
    )
    add_config(parser)
    parser.add_argument("--json", action="store_true", help="print the JSON object")
    parser.add_argument(
        "--watch", action="store_true", help="show it anew each second until Ctrl-C"
    )
    parser.set_defaults(run=run_status)


def run_status(args: argparse.Namespace) -> int:
    """Print the status once, or each second."""
    config = config_of(args)
    guide = _guide_of(config)
    if not args.watch:
        page, is_healthy = _page(config, guide, is_json=args.json)
        write(page)
        return 0 if is_healthy else NotRunningError.exit_code
    clear = _CLEAR if sys.stdout.isatty() and not args.json else ""
    try:
        while True:
            write(clear + _page(config, guide, is_json=args.json)[0])
            sys.stdout.flush()
            time.sleep(1)
    except KeyboardInterrupt:
        return 0


def _guide_of(config: "Config") -> "Guide | None":
    """Return who guides; a route that is missing or bad is told."""
    if config.guide.route is None:
        return None
    from imu_tracker.guidance.guide import Guide
    from imu_tracker.guidance.route import read_route

    try:
        route = read_route(config.guide.route)
    except TrackerError as error:
        log.warning("no guidance: %s", error)
        return None
    return Guide(route, config.guide.arrival_m, config.guide.limit_m)


def _guidance(guide: "Guide", row: dict[str, Any]) -> dict[str, Any]:
    """Return what the last row means on the route."""
    from imu_tracker.storage.latlong import LogRow

    places = {name: row.get(name) for name in LogRow._fields[1:7]}
    numbers = {n: math.nan if v is None else float(v) for n, v in places.items()}
    row_then = LogRow(utc_s=0.0, mode=str(row.get("mode")), **numbers)
    return guide.at(row_then).summary()


def _page(
    config: "Config", guide: "Guide | None", *, is_json: bool
) -> tuple[str, bool]:
    """Return what is shown, and whether rows reach the log."""
    text, status = read_status(config.status.path)
    is_healthy = status.get("state") != "not logging"
    publish = _published(config)
    if guide is not None and isinstance(row := status.get("row"), dict):
        status["guide"] = _guidance(guide, row)
    if is_json:
        status |= {"publish": publish} if publish else {}
        page = f"{json.dumps(status) if guide or publish else text.strip()}\n"
        return page, is_healthy
    status |= {f"publish {name}": found for name, found in publish.items()}
    return "\n".join(_lines(status)) + "\n", is_healthy


def _published(config: "Config") -> dict[str, Any]:
    """Return how each destination of `imu-tracker publish` is; empty: it has none."""
    try:
        _, found = status_file.read_status(config.status.publish, "imu-tracker publish")
    except (NotRunningError, PermissionError) as error:
        reason = f"{error}"
        return {table.name: {"state": reason} for table in config.publish}
    destinations = found.get("destinations")
    return destinations if isinstance(destinations, dict) else {}


def read_status(path: Path) -> tuple[str, dict[str, Any]]:
    """Read what the daemon wrote just now, as text and as an object.

    Raises
    ------
    NotRunningError
        When there is no daemon, it stopped writing, or this user may not read it.
    """
    try:
        return status_file.read_status(path)
    except PermissionError as error:
        raise NotRunningError(
            f"{path}: no permission: {mending.join_group(path, 'imu-tracker')}"
        ) from error


def _lines(status: dict[str, Any]) -> Iterator[str]:
    """Lay the object out for people: a summary, what stands alone, then the groups."""
    if "state" in status:
        yield _summary(status)
        yield ""
    groups = {key: value for key, value in status.items() if isinstance(value, dict)}
    yield from _table({k: v for k, v in status.items() if k not in groups}, indent="")
    for name, group in groups.items():
        if not group:
            continue
        yield ""
        yield _words(name)
        lists = [value for value in group.values() if isinstance(value, list)]
        if len(lists) == len(group) and len({len(values) for values in lists}) == 1:
            yield from _columns(group)
            continue
        if name == "learnt":
            group = _with_sigmas(group)
        yield from _table(group, indent="  ")


def _summary(status: dict[str, Any]) -> str:
    """Say in a line what a person wants to know first."""
    parts = [status["state"]]
    if (log_group := status.get("log")) and log_group.get("trouble"):
        parts.append(log_group["trouble"])
    if status.get("mode") is not None:
        parts[0] += f": {status['mode']}, r95 {status['r95_m']} m"
    if status.get("fix_age_s") is not None:
        parts.append(f"last fix {status['fix_age_s']} s ago")
    if status.get("imu_rate_hz") is not None:
        parts.append(f"{status['imu_rate_hz']:.0f} samples/s")
    if (faults := status.get("faults")) is not None:
        kinds = [f"{_words(kind)} {n}" for kind, n in faults.items() if n]
        parts.append(f"faults: {', '.join(kinds) or 'none'}")
    if status.get("disk_free_mb") is not None:
        parts.append(f"{status['disk_free_mb'] / 1000:.1f} GB free")
    if status.get("uptime_s") is not None:
        parts.append(f"up {timedelta(seconds=status['uptime_s'])}")
    return "; ".join(parts)


def _columns(lists: dict[str, list[Any]]) -> Iterator[str]:
    """Lay out lists that belong together beside one another, a line for each entry."""
    names = [_words(key) for key in lists]
    rows = [
        [_text(value) for value in row] for row in zip(*lists.values(), strict=True)
    ]
    widths = [max(map(len, column)) for column in zip(names, *rows, strict=True)]
    for row in (names, *rows):
        cells = (f"{cell:>{w}}" for cell, w in zip(row, widths, strict=True))
        yield f"  {'  '.join(cells)}"


def _with_sigmas(values: dict[str, Any]) -> dict[str, Any]:
    """Round, and put a standard deviation behind the value that it belongs to."""
    shown = {}
    for key, value in values.items():
        quantity, _, unit = key.rpartition("_")
        sigma = values.get(f"{quantity}_sigma_{unit}")
        text = _rounded(value)
        shown[key] = text if sigma is None else f"{text}  +- {_rounded(sigma)}"
    told = {key.replace("_sigma_", "_") for key in values if "_sigma_" in key}
    return {
        key: text
        for key, text in shown.items()
        if "_sigma_" not in key or key.replace("_sigma_", "_") not in told & {*values}
    }


def _rounded(value: object) -> str:
    match value:
        case float():
            return f"{value:.3g}"
        case list():
            return ", ".join(map(_rounded, value))
        case dict():
            parts = _with_sigmas(value).items()
            return ", ".join(f"{_words(key)} {text}" for key, text in parts)
        case _:
            return _text(value)


def _table(values: dict[str, Any], indent: str) -> Iterator[str]:
    shown = {_words(key): value for key, value in values.items() if key != "t_ns"}
    width = max(map(len, shown), default=0)
    for key, value in shown.items():
        yield f"{indent}{key:{width}}  {_text(value)}"


def _words(key: str) -> str:
    return key.replace("_", " ")


def _text(value: object) -> str:
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.12g}"
        case list():
            return ", ".join(map(_text, value)) or "-"
        case _:
            return str(value)
