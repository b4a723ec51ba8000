"""Draw the rooms of the code and the imports between them, from the sources.

    python -m benchmarks.rooms --output docs/rooms.png

Each room stands above all that it imports. An arrow that another path implies is left
out, so that the picture shows the order and not every import.
"""

import argparse
import ast
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import imu_tracker

ROOT = Path(imu_tracker.__file__).parent
PACKAGE = "imu_tracker"
SWEEPS = 24  # down and up; the picture changes no more then
BELOW = frozenset({"samples", "errors"})  # imported by nearly all: no arrows

Node: TypeAlias = tuple[str, str]
"""A room and "", or where its arrow passes a floor."""


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


def layers_of(
    height: dict[str, int], arrows: list[tuple[str, str]]
) -> tuple[list[list[Node]], list[list[Node]]]:
    """Return the nodes of each floor, and each arrow as a way from floor to floor.

    An arrow that passes a floor has a node there, so that no room stands in its way.
    """
    layers: list[list[Node]] = [[] for _ in range(max(height.values()) + 1)]
    for room in sorted(height):
        layers[height[room]].append((room, ""))
    ways = []
    for room, other in arrows:
        between = range(height[room] - 1, height[other], -1)
        passed = [(room, f"{other} {level}") for level in between]
        for level, node in zip(between, passed, strict=True):
            layers[level].append(node)
        ways.append([(room, ""), *passed, (other, "")])
    return layers, ways


def placed(layers: list[list[Node]], ways: list[list[Node]]) -> dict[Node, float]:
    """Give each node its x: near to its neighbours, and no two in one place.

    Source: Sugiyama, Tagawa and Toda 1981, the barycentre method.
    """
    above: dict[Node, list[Node]] = defaultdict(list)
    below: dict[Node, list[Node]] = defaultdict(list)
    for way in ways:
        for upper, lower in pairwise(way):
            above[lower].append(upper)
            below[upper].append(lower)
    x: dict[Node, float] = {}
    for layer in layers:
        x |= {node: i - 0.5 * len(layer) for i, node in enumerate(layer)}
    for turn in range(SWEEPS):
        is_down = turn % 2 == 0
        for layer in reversed(layers) if is_down else layers:
            for node in layer:
                near = (above if is_down else below)[node] or [node]
                x[node] = sum(x[each] for each in near) / len(near)
            layer.sort(key=lambda node: x[node])
            wanted_x = sum(x[node] for node in layer) / len(layer)
            for left, right in pairwise(layer):
                x[right] = max(x[right], x[left] + 0.5 * (width(left) + width(right)))
            shift = wanted_x - sum(x[node] for node in layer) / len(layer)
            for node in layer:
                x[node] += shift
    return x


def width(node: Node) -> float:
    """How much room a node takes, in characters: its name, or an arrow that passes."""
    room, passing = node
    return 3.0 if passing else len(room) + 5.0


def draw(output: Path) -> None:
    """Draw the picture."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    arrows = imports()
    height = floors(arrows)
    layers, ways = layers_of(height, direct(arrows))
    x = placed(layers, ways)
    y = {node: float(level) for level, layer in enumerate(layers) for node in layer}
    figure, axes = plt.subplots(figsize=(9.0, 0.75 * len(layers)))
    for way in ways:
        corners = [(x[way[0]], y[way[0]] - 0.2)]
        for node in way[1:-1]:
            corners += [(x[node], y[node] + 0.2), (x[node], y[node] - 0.2)]
        end = (x[way[-1]], y[way[-1]] + 0.2)
        axes.plot(*zip(*corners, strict=True), color="0.55", linewidth=0.9)
        arrow = {"arrowstyle": "-|>", "color": "0.55", "linewidth": 0.9}
        arrow |= {"shrinkA": 0.0, "shrinkB": 0.0}
        axes.annotate("", xy=end, xytext=corners[-1], arrowprops=arrow)
    for node in x:
        if not node[1]:
            axes.text(
                *(x[node], y[node], node[0]),
                ha="center",
                va="center",
                fontsize=10,
                bbox={"boxstyle": "round,pad=0.35", "facecolor": "#e8f1fa"},
            )
    axes.set_xlim(min(x.values()) - 6.0, max(x.values()) + 6.0)
    axes.set_ylim(-0.5, len(layers) - 0.5)
    axes.axis("off")
    figure.savefig(output, dpi=110, bbox_inches="tight")


def main() -> None:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description="draw the rooms of the code")
    parser.add_argument("--output", type=Path, default=Path("docs/rooms.png"))
    draw(parser.parse_args().output)


if __name__ == "__main__":
    main()
