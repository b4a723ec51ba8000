"""Draw the rooms of the code and the imports between them, from the sources.

    python -m benchmarks.rooms --output docs/rooms.png

Each room stands above all that it imports. An arrow that another path implies is left
out, so that the picture shows the order and not every import.
"""

import argparse
import ast
from pathlib import Path

import imu_tracker

ROOT = Path(imu_tracker.__file__).parent
PACKAGE = "imu_tracker"
BELOW = frozenset({"samples", "errors"})  # imported by nearly all: no arrows


def room_of(parts: tuple[str, ...]) -> str:
    """Name the top-level room of a module."""
    return parts[0].removesuffix(".py") if parts else ""


def imports() -> dict[str, set[str]]:
    """Read which room imports which, imports inside functions included."""
    found: dict[str, set[str]] = {}
    for path in sorted(ROOT.rglob("*.py")):
        here = room_of(path.relative_to(ROOT).parts)
        if here.startswith("__"):
            continue
        found.setdefault(here, set())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or not node.module:
                continue
            names = node.module.split(".")
            if names[0] == PACKAGE and len(names) > 1 and names[1] != here:
                found[here].add(names[1])
    return {room: there - BELOW for room, there in found.items() if room not in BELOW}


def floors(arrows: dict[str, set[str]]) -> dict[str, int]:
    """Give each room the length of the longest way down from it."""
    height: dict[str, int] = {}

    def measure(room: str) -> int:
        if room not in height:
            height[room] = 1 + max((measure(r) for r in arrows[room]), default=-1)
        return height[room]

    for room in arrows:
        measure(room)
    return height


def reachable(arrows: dict[str, set[str]], room: str) -> set[str]:
    """Return all rooms below one, itself left out."""
    found: set[str] = set()
    waiting = list(arrows[room])
    while waiting:
        other = waiting.pop()
        if other not in found:
            found.add(other)
            waiting += arrows[other]
    return found


def direct(arrows: dict[str, set[str]]) -> list[tuple[str, str]]:
    """Leave out each arrow that a longer way implies."""
    below = {room: reachable(arrows, room) for room in arrows}
    return [
        (room, other)
        for room, there in sorted(arrows.items())
        for other in sorted(there)
        if not any(other in below[between] for between in there - {other})
    ]


def draw(output: Path) -> None:
    """Draw the picture."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    arrows = imports()
    height = floors(arrows)
    top = max(height.values())
    place: dict[str, tuple[float, float]] = {}
    for level in range(top + 1):
        here = sorted(room for room in arrows if height[room] == level)
        for i, room in enumerate(here):
            place[room] = ((i + 0.5) / len(here) * 10.0, float(level))
    figure, axes = plt.subplots(figsize=(9.0, 0.9 * (top + 1.5)))
    for room, other in direct(arrows):
        axes.annotate(
            "",
            xy=(place[other][0], place[other][1] + 0.2),
            xytext=(place[room][0], place[room][1] - 0.2),
            arrowprops={"arrowstyle": "-|>", "color": "0.55", "linewidth": 0.9},
        )
    for room, (x, y) in place.items():
        axes.text(
            *(x, y, room),
            ha="center",
            va="center",
            fontsize=10,
            bbox={"boxstyle": "round,pad=0.35", "facecolor": "#e8f1fa"},
        )
    axes.set_xlim(-0.3, 10.3)
    axes.set_ylim(-0.6, top + 0.6)
    axes.axis("off")
    figure.savefig(output, dpi=110, bbox_inches="tight")


def main() -> None:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description="draw the rooms of the code")
    parser.add_argument("--output", type=Path, default=Path("docs/rooms.png"))
    draw(parser.parse_args().output)


if __name__ == "__main__":
    main()
