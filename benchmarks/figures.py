"""Put the figures of the benchmarks into README and docs.

    python -m benchmarks.figures                      # write them from figures.json
    python -m benchmarks.figures accuracy carriers    # measure these anew before

A benchmark prints Markdown tables. They are kept in `benchmarks/figures.json`, with the
command that makes them, and stand in a page between two comments, the first of which
names them: `<!-- figures: accuracy 1 -->` for the first table of `accuracy`, or
`<!-- figures: accuracy 1, rtkexp_car phone_highway -->` for some of its rows.
"""

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final

REPOSITORY: Final = Path(__file__).parents[1]
KEPT: Final = REPOSITORY / "benchmarks" / "figures.json"
PAGES: Final = ("README.md", "docs/estimation.md", "docs/serve.md")

COMMANDS: Final[Mapping[str, str]] = {
    "accuracy": "benchmarks.accuracy",
    "carriers": "benchmarks.carriers --seeds 4",
    "consistency": "benchmarks.consistency --drives 20",
    "serving": "benchmarks.serving",
}

TITLES: Final[Mapping[str, str]] = {
    "rtkexp_car": "car, consumer receiver at 1 Hz (its fixes: 2.3)",
    "rtkexp_car_rtk4hz": "the same drive, RTK receiver at 4 Hz",
    "phone_highway": "motorway at 130 km/h, a telephone",
}
"""What drives of known names are called in a table."""

_BLOCK: Final = re.compile(
    r"(<!-- figures: (?P<name>\w+) (?P<number>\d)(?:, (?P<rows>[\w ]+))? -->\n)"
    r".*?(<!-- end of figures -->)",
    re.DOTALL,
)

Figures = dict[str, Any]


def measure(name: str) -> Figures:
    """Run a benchmark; return its command and its tables, each a list of lines."""
    command = [sys.executable, "-m", *COMMANDS[name].split()]
    done = subprocess.run(
        command, cwd=REPOSITORY, check=True, stdout=subprocess.PIPE, text=True
    )
    print(done.stdout)
    lines = groupby(done.stdout.splitlines(), lambda line: line.startswith("|"))
    tables = [list(group) for is_table, group in lines if is_table]
    return {"command": f"python -m {COMMANDS[name]}", "tables": tables}


def filled(text: str, figures: Mapping[str, Figures]) -> str:
    """Return a page with its tables written anew.

    Raises
    ------
    KeyError
        When it names a benchmark that is not in the figures.
    """

    def block(match: re.Match[str]) -> str:
        table = figures[match["name"]]["tables"][int(match["number"]) - 1]
        rows = (match["rows"] or "").split()
        return match[1] + "\n".join(_chosen(table, rows)) + "\n" + match[5]

    return _BLOCK.sub(block, text)


def _chosen(table: Sequence[str], names: Sequence[str]) -> list[str]:
    """Return the lines of these rows in their order, or all of them."""
    head, body = list(table[:2]), list(table[2:])
    if names:
        body = [line for name in names for line in body if _first(line) == name]
    last = ""
    for line in body:
        name = _first(line)
        title = "" if name == last else f" {TITLES.get(name, name)}"
        head.append(line.replace(f" {name}", title, 1))
        last = name
    return head


def _first(line: str) -> str:
    return line.split("|")[1].strip()


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.figures",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(COMMANDS))
    names = parser.parse_args().names
    if not set(names) <= set(COMMANDS):
        parser.error(f"a NAME is one of {', '.join(COMMANDS)}")
    figures = json.loads(KEPT.read_text("utf-8")) if KEPT.exists() else {}
    for name in names:
        figures[name] = measure(name)
        KEPT.write_text(json.dumps(figures, indent=1, sort_keys=True) + "\n", "utf-8")
    for page in PAGES:
        path = REPOSITORY / page
        path.write_text(filled(path.read_text("utf-8"), figures), "utf-8")


if __name__ == "__main__":
    main()
