"""How long the commands take to say their first word, and what they import for it."""

import re
import resource
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

HEAVY: Final = ("numpy", "scipy", "filterpy", "pydantic", "matplotlib")

_IMPORT = re.compile(r"import time: +\d+ \| +\d+ \| +(\w+)$", re.MULTILINE)


class Startup(NamedTuple):
    """One command, as a whole process."""

    command: str
    wall_s: float
    cpu_s: float  # less than that where others are busy, too
    imports: list[str]  # of the heavy ones


def measure(scratch: Path, runs: int) -> list[Startup]:
    """Run the commands that need no hardware, on a second of data."""
    drive, log = str(scratch / "second.rec"), str(scratch / "second.csv")
    commands = [
        ["--help"],
        ["--version"],
        ["status"],
        ["simulate", "still", "--duration", "1", "--output", drive],
        ["replay", drive, "--output", log],
        ["plot", drive, "--output", str(scratch / "second.png")],
    ]
    return [_measure(arguments, runs) for arguments in commands]


def _measure(arguments: list[str], runs: int) -> Startup:
    walls_s, cpus_s = [], []
    for _ in range(runs):
        wall_s, cpu_s = time.perf_counter(), _children_cpu_s()
        _run([], arguments)
        walls_s.append(time.perf_counter() - wall_s)
        cpus_s.append(_children_cpu_s() - cpu_s)
    imported = set(_IMPORT.findall(_run(["-X", "importtime"], arguments)))
    return Startup(
        f"imu-tracker {arguments[0]}",
        median(walls_s),
        median(cpus_s),
        [package for package in HEAVY if package in imported],
    )


def _run(options: list[str], arguments: list[str]) -> str:
    command = [sys.executable, *options, "-m", "imu_tracker", *arguments]
    return subprocess.run(command, check=False, capture_output=True, text=True).stderr


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
