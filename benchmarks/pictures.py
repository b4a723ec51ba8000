"""Draw the pictures of docs/pictures.md: wiring, mounting, what good looks like.

    python -m benchmarks.pictures --folder docs

The last one is drawn from a simulated drive, tracked twice: with the chip, and without.
"""

import argparse
import csv
import json
import tempfile
from datetime import datetime
from pathlib import Path
from typing import Any

import matplotlib as mpl

from imu_tracker.cli import main as imu_tracker

mpl.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle

DPI = 110
RED, BLACK, BLUE, GREEN, AMBER, GREY = (
    *("#c62828", "#222222", "#1565c0", "#2e7d32", "#b26a00", "#777777"),
)

PIN_NAMES = {
    1: "3.3 V", 2: "5 V", 3: "SDA", 4: "5 V", 5: "SCL", 6: "GND", 8: "TXD", 10: "RXD",
    9: "GND", 14: "GND",
}  # fmt: skip
"""Of the header of every Pi with 40 pins; the others are not used."""

CHIP_WIRES = (("VCC", 1, RED), ("GND", 9, BLACK), ("SCL", 5, AMBER), ("SDA", 3, BLUE))
CHIP_FREE = ("XDA", "XCL", "AD0", "INT")
GPS_WIRES = (("VCC", 4, RED), ("GND", 6, BLACK), ("TX", 10, GREEN))
GPS_FREE = ("RX", "PPS")


def wiring(path: Path) -> None:
    """Draw the header with a chip on its left and a receiver on its right."""
    figure = Figure(figsize=(9.5, 6.2), dpi=DPI, layout="constrained")
    axes = _canvas(figure, (-7.3, 7.6), (-8.6, 1.9))
    axes.add_patch(_box(-1.1, -8.2, 2.2, 9.2, "#eef3ee", GREEN))
    axes.text(0, 1.35, "Raspberry Pi, header, seen from above", ha="center", size=11)
    for pin in range(1, 21):
        x, y = _pin(pin)
        used = pin in {p for _, p, _ in (*CHIP_WIRES, *GPS_WIRES)}
        axes.plot(x, y, "s" if pin == 1 else "o", ms=13, color="#d8a800", mec=BLACK)
        axes.text(x, y, str(pin), ha="center", va="center", size=6.5)
        if used and pin in PIN_NAMES:
            side = -1 if pin % 2 else 1
            axes.text(
                side * 1.25, y + 0.14, PIN_NAMES[pin],
                ha="right" if side < 0 else "left", size=7, color=GREY,
            )  # fmt: skip
    axes.text(0, -8.05, "21 to 40: unused", ha="center", size=7, color=GREY)
    _module(axes, -5.9, "MPU-6050 (GY-521)", CHIP_WIRES, CHIP_FREE, side=-1)
    _module(axes, 5.9, "GPS receiver", GPS_WIRES, GPS_FREE, side=1)
    axes.text(
        -5.9, -7.7, "AD0 open: address 0x68\nAD0 on 3.3 V: 0x69",
        ha="center", size=8, color=GREY,
    )  # fmt: skip
    axes.text(
        5.9, -7.7, "5 V or 3.3 V: what the module says;\nits TX must not exceed 3.3 V",
        ha="center", size=8, color=RED,
    )  # fmt: skip
    figure.savefig(path)


def _pin(pin: int) -> tuple[float, float]:
    row, is_right = divmod(pin - 1, 2)
    return (0.45 if is_right else -0.45), 0.4 - 0.82 * row


def _module(
    axes: Axes,
    x: float,
    name: str,
    wires: tuple[tuple[str, int, str], ...],
    free: tuple[str, ...],
    side: int,
) -> None:
    """Draw a module with its pins towards the header, and the wires between."""
    names = [*(wire[0] for wire in wires), *free]
    top, step = 0.2, 0.82
    height = step * len(names) + 0.5
    axes.add_patch(_box(x - 1.3, top - height + 0.55, 2.6, height, "#e8eefb", BLUE))
    axes.text(x, top + 0.85, name, ha="center", size=10)
    edge = x - side * 1.05
    for number, label in enumerate(names):
        y = top - step * number
        axes.plot(edge, y, "o", ms=9, color="#d8a800", mec=BLACK)
        axes.text(edge + side * 0.35, y, label, ha="left" if side > 0 else "right",
                  va="center", size=9)  # fmt: skip
    for number, (_, pin, color) in enumerate(wires):
        y = top - step * number
        pin_x, pin_y = _pin(pin)
        bend = side * (3.9 - 0.42 * number)
        axes.plot([edge, bend, bend, pin_x + side * 0.13], [y, y, pin_y, pin_y],
                  color=color, lw=2.4, solid_joinstyle="round", zorder=1)  # fmt: skip


def mounting(path: Path) -> None:
    """Draw a car from above with its axes, and chips as they may be turned in it."""
    figure = Figure(figsize=(9.5, 5.4), dpi=DPI, layout="constrained")
    axes = _canvas(figure, (-5, 14.2), (-4.6, 4.6))
    axes.add_patch(_box(-1.7, -3.6, 3.4, 7.2, "#f2f2f2", GREY))
    axes.add_patch(Rectangle((-1.2, 1.0), 2.4, 0.9, fc="#cfe3f7", ec=GREY))
    axes.add_patch(Rectangle((-1.2, -2.7), 2.4, 0.7, fc="#cfe3f7", ec=GREY))
    _arrow(axes, (0, 0), (0, 3.3), GREEN, "forward", (0.2, 2.6))
    _arrow(axes, (0, 0), (2.6, 0), BLUE, "right", (1.9, 0.25))
    axes.text(
        0, -0.75, "down: into\nthe paper", ha="center", va="top", size=8, color=GREY
    )
    axes.plot(0, 0, "o", ms=9, color=BLACK)
    axes.plot(-0.9, -2.35, "^", ms=10, color=RED)
    axes.text(-1.9, -3.2, "antenna:\nsees the sky", ha="right", size=8, color=RED)
    axes.annotate(
        "box: fixed, cannot move", (0, 0), (-4.9, 0.9), size=8,
        arrowprops={"arrowstyle": "->", "color": GREY},
    )  # fmt: skip
    axes.text(0, 3.95, "the vehicle from above", ha="center", size=10)
    chips = (
        (
            "lies flat, x forward (default)",
            '["+x", "-y", "-z"]',
            "up",
            "left",
            "up at you",
        ),
        ("lies flat, x to the right", '["+y", "+x", "-z"]', "right", "up", "up at you"),
        ("lies flat, x backward", '["-x", "+y", "-z"]', "down", "right", "up at you"),
        (
            "upside down, x forward",
            '["+x", "+y", "+z"]',
            "up",
            "right",
            "away from you",
        ),
    )
    for number, (title, mount, x_way, y_way, z_way) in enumerate(chips):
        x, y = 5.4 + 4.9 * (number % 2), 1.3 - 4.5 * (number // 2)
        _chip(axes, x, y, x_way, y_way)
        axes.text(x, y + 2.2, title, ha="center", size=9)
        axes.text(
            x, y + 1.75, f"mount = {mount}", ha="center", size=8, family="monospace"
        )
        axes.text(x, y - 1.75, f"z: {z_way}", ha="center", size=8, color=GREY)
    figure.savefig(path)


WAYS = {"up": (0, 1), "down": (0, -1), "left": (-1, 0), "right": (1, 0)}


def _chip(axes: Axes, x: float, y: float, x_way: str, y_way: str) -> None:
    axes.add_patch(_box(x - 0.75, y - 0.75, 1.5, 1.5, "#e8eefb", BLUE))
    axes.add_patch(Rectangle((x - 0.2, y - 0.2), 0.4, 0.4, fc=BLACK))
    for way, name, color in ((x_way, "x", GREEN), (y_way, "y", BLUE)):
        dx, dy = WAYS[way]
        tip = (x + 1.35 * dx, y + 1.35 * dy)
        label = (x + 1.1 * dx + 0.18 * (dx == 0), y + 1.1 * dy + 0.15 * (dy == 0))
        _arrow(axes, (x, y), tip, color, name, label)


def good(path: Path) -> None:
    """Draw r95 of a drive with a tunnel, tracked with the chip and without."""
    figure = Figure(figsize=(9.5, 5.0), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole, alone, begun_s = _logs(folder)
    _radius(axes, alone, begun_s, RED, "chip not connected (mode gpsonly)")
    _radius(axes, whole, begun_s, GREEN, "good: chip and receiver")
    start, end = OUTAGE
    axes.axvspan(start, end, color="#dddddd", zorder=0)
    axes.set_yscale("log")
    axes.set_ylim(1, 3000)
    axes.set_xlabel("seconds after the start of the recording")
    axes.set_ylabel("r95_m")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right")
    notes = (
        ("a wide circle at the start,\nmetres within a minute", 48, 13),
        (f"no reception for {end - start} s", (start + end) / 2, 1.25),
        ("afterwards small again\nwithin seconds", end + 32, 12),
    )
    for text, x, y in notes:
        axes.text(x, y, text, ha="center", size=9)
    figure.savefig(path)


OUTAGE = (240, 300)


def _logs(folder: Path) -> tuple[list[dict[str, str]], list[dict[str, str]], float]:
    """Track a simulated drive with an outage, with the chip's samples and without."""
    drive, bare = folder / "drive.rec", folder / "bare.rec"
    _run("simulate", "drive", "--duration", "350", "--seed", "3", "--output", drive)
    lines = drive.read_text("ascii").splitlines(keepends=True)
    bare.write_text("".join(line for line in lines if line[0] != "I"), "ascii")
    logs = []
    for recording in (drive, bare):
        log = recording.with_suffix(".csv")
        blind = f"{OUTAGE[0]}:{OUTAGE[1] - OUTAGE[0]}"
        _run("replay", recording, "--output", log, "--gps-outage", blind)
        with log.open(encoding="utf-8") as file:
            logs.append(list(csv.DictReader(file)))
    header = json.loads(lines[1].removeprefix("#"))
    begun_s = datetime.fromisoformat(header["start_utc"]).timestamp()
    return logs[0], logs[1], begun_s


def _run(*words: object) -> None:
    if code := imu_tracker([*map(str, words), "--quiet"]):
        raise SystemExit(code)


def _radius(
    axes: Axes, rows: list[dict[str, str]], begun_s: float, color: str, label: str
) -> None:
    times = [datetime.fromisoformat(row["time_utc"]).timestamp() for row in rows]
    radii = [float(row["r95_m"]) for row in rows]
    axes.plot([t - begun_s for t in times], radii, color=color, lw=1.6, label=label)


def _canvas(figure: Figure, x: tuple[float, float], y: tuple[float, float]) -> Axes:
    axes = figure.subplots()
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_aspect("equal")
    axes.axis("off")
    return axes


def _box(x: float, y: float, width: float, height: float, face: str, edge: str) -> Any:
    style = "round,pad=0,rounding_size=0.2"
    return FancyBboxPatch(
        (x, y), width, height, boxstyle=style, fc=face, ec=edge, lw=1.5
    )


def _arrow(
    axes: Axes,
    start: tuple[float, float],
    end: tuple[float, float],
    color: str,
    text: str,
    place: tuple[float, float],
) -> None:
    arrow = FancyArrowPatch(
        start, end, arrowstyle="-|>", mutation_scale=16, color=color, lw=2.2, zorder=3
    )
    axes.add_patch(arrow)
    axes.text(*place, text, color=color, size=9, weight="bold")


def main() -> None:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description="draw the pictures of the docs")
    parser.add_argument("--folder", type=Path, default=Path("docs"))
    folder = parser.parse_args().folder
    wiring(folder / "wiring.png")
    mounting(folder / "mounting.png")
    good(folder / "good.png")


if __name__ == "__main__":
    main()
