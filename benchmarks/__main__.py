"""Measure, print the tables, and write the figures as JSON where asked."""

import argparse
import json
import os
import platform
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from benchmarks import endurance, startup, throughput
from benchmarks.drives import find_drive, write_drive

HOUR_S: Final = 3610.0  # the first row comes after some seconds


def main(argv: Sequence[str] | None = None) -> None:
    args = _parse(argv)
    _print_machine()
    figures: dict[str, Any] = {}
    with TemporaryDirectory() as folder:
        scratch = Path(folder)
        if "throughput" in args.parts:
            figures["throughput"] = _throughput(scratch, args.rounds)
        if "endurance" in args.parts:
            figures["endurance"] = _endurance(scratch, args.rounds)
        if "startup" in args.parts:
            figures["startup"] = _startup(scratch)
    if args.json is not None:
        args.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parts = ("throughput", "endurance", "startup")
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {parts}; or all")
    parser.add_argument("--rounds", type=int, default=3, help="default: 3")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args(argv)
    args.parts = args.parts or parts
    if not set(args.parts) <= set(parts) or args.rounds < 1:
        parser.error(f"a PART is one of {', '.join(parts)}; rounds are 1 or more")
    return args


def _print_machine() -> None:
    load = " ".join(f"{average:.2f}" for average in os.getloadavg())
    print(
        f"Python {platform.python_version()}, {platform.machine()}, "
        f"{os.cpu_count()} processors, load {load}"
    )


def _throughput(scratch: Path, rounds: int) -> dict[str, Any]:
    drive = find_drive(scratch)
    print(
        f"\nThroughput on {drive.name}: {len(drive.samples)} samples, "
        f"{len(drive.fixes)} fixes, {rounds} rounds in turn"
    )
    names = list(throughput.CONTESTANTS)
    if find_spec("pyins") is None:
        print("  without pyins: pip install '.[benchmark]'")
        names.remove("pyins")
    results = throughput.compete(drive, names, rounds)
    ours = results["imu-tracker"].median_per_s
    print(
        f"  {'':18}{'best':>10}{'median':>10}{'quiet':>10}{'ours is':>10}{'end':>9}\n"
        f"  {'':18}{3 * '  samples/s'[1:]}{'x faster':>10}{'off by':>9}"
    )
    for name, result in results.items():
        print(
            f"  {name:18}{result.best_per_s:10.0f}{result.median_per_s:10.0f}"
            f"{result.quiet_per_s:10.0f}{ours / result.median_per_s:10.1f}"
            f"{result.end_m:7.1f} m"
        )
    yardsticks = [turn.yardstick_s for r in results.values() for turn in r.turns]
    print(
        f"  yardstick {1e3 * min(yardsticks):.1f} to {1e3 * max(yardsticks):.1f} ms; "
        "quiet: as if it always took the least"
    )
    return {
        name: {
            **result._asdict(),
            "turns": [turn._asdict() for turn in result.turns],
            "best_per_s": result.best_per_s,
            "median_per_s": result.median_per_s,
            "quiet_per_s": result.quiet_per_s,
        }
        for name, result in results.items()
    }


def _endurance(scratch: Path, rounds: int) -> dict[str, Any]:
    print("\nAn hour of a simulated drive, in slices of 5 minutes")
    result = endurance.measure(write_drive(scratch / "hour.rec.gz", HOUR_S), rounds)
    measured, quiet = (
        " ".join(f"{cost:.1f}" for cost in costs)
        for costs in (result.us_per_sample, result.quiet_us_per_sample)
    )
    print(
        f"  us per sample (median of {rounds}): {measured}\n"
        f"  as with the fastest yardstick:  {quiet}\n"
        f"  slope: {result.slope_us_per_h:+.2f} +- {result.slope_sigma_us_per_h:.2f} "
        "us per sample and hour\n"
        f"  peak memory of the process: {result.imported_rss_mb:.1f} MB after the "
        f"imports, {result.peak_rss_mb[0]:.1f} MB after the first slice, "
        f"{result.peak_rss_mb[-1]:.1f} MB at the end\n"
        f"  of it in Python objects: {result.traced_kb[0]:.0f} kB after the first "
        f"slice, {result.traced_kb[-1]:.0f} kB at the end, peak "
        f"{result.traced_peak_kb:.0f} kB"
    )
    return result._asdict()


def _startup(scratch: Path) -> dict[str, Any]:
    print("\nStart to end of a process, median of 7, in s")
    print(f"  {'':24}{'wall':>6}{'CPU':>6}  imports")
    results = startup.measure(scratch, runs=7)
    for result in results:
        print(
            f"  {result.command:24}{result.wall_s:6.2f}{result.cpu_s:6.2f}  "
            f"{' '.join(result.imports) or '-'}"
        )
    return {result.command: result._asdict() for result in results}


if __name__ == "__main__":
    main()
