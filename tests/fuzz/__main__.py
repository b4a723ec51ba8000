"""`make fuzz`: every target, a million cases each, guided by what they reach.

    python -m fuzz [--runs N] [--seconds S] [--jobs N] [TARGET ...]

Each runs in a process of its own, from the same seeds and the same random numbers, so
that a run can be repeated. What is found stays in `build/fuzz/TARGET/`, as a file that
`python -m fuzz TARGET --case FILE` runs alone. Paths hold in a checkout, with `tests`
on PYTHONPATH.
"""

import argparse
import os
import re
import subprocess
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

MEMORY_MB = 1024
CASE_S = 20  # a case that takes longer is a hang

OUTPUT = Path("build/fuzz")


def main() -> int:
    from fuzz.targets import TARGETS

    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", choices=[[], *TARGETS])
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=int, default=0, help="at most; 0: no end")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--case", type=Path, help="run this file alone")
    args = parser.parse_args()
    names = args.targets or list(TARGETS)
    if args.case is not None:
        warnings.simplefilter("error")
        TARGETS[names[0]].run(args.case.read_bytes())
        return 0
    with ThreadPoolExecutor(args.jobs) as pool:
        results = list(
            pool.map(lambda name: _fuzz(name, args.runs, args.seconds), names)
        )
    return max(results)


def _fuzz(name: str, runs: int, seconds: int) -> int:
    """Run one target in a process of its own, and say in a line how it went."""
    from fuzz.targets import TARGETS

    target = TARGETS[name]
    folder = OUTPUT / name
    (folder / "corpus").mkdir(parents=True, exist_ok=True)
    for old in folder.glob("corpus/*"):
        old.unlink()
    for number, seed in enumerate(target.seeds):
        (folder / "corpus" / f"seed-{number}").write_bytes(seed)
    words = folder / "words"
    words.write_text(
        "".join(
            '"' + "".join(f"\\x{byte:02x}" for byte in word) + '"\n'
            for word in target.words
            if word
        ),
        "utf-8",
    )
    arguments = [
        *(f"-runs={runs}", "-seed=1", f"-max_len={target.max_bytes}"),
        *(f"-timeout={CASE_S}", f"-rss_limit_mb={MEMORY_MB}", "-print_final_stats=1"),
        *(f"-max_total_time={seconds}", f"-artifact_prefix={folder}/"),
        *([f"-dict={words}"] if target.words else []),
        str(folder / "corpus"),
    ]
    start_s = time.monotonic()
    with (folder / "output").open("w", encoding="utf-8") as output:
        code = subprocess.run(
            [sys.executable, "-m", "fuzz.one", name, *arguments],
            stdout=output,
            stderr=subprocess.STDOUT,
            check=False,
        ).returncode
    said = (folder / "output").read_text("utf-8", "replace")
    done, peak_mb = (
        (re.findall(pattern, said) or ["?"])[-1]
        for pattern in (r"number_of_executed_units: (\d+)", r"peak_rss_mb: +(\d+)")
    )
    verdict = "clean" if code == 0 else f"FOUND something: {folder}/output"
    print(
        f"{name:14} {done:>9} cases {time.monotonic() - start_s:7.0f} s "
        f"{peak_mb:>5} MB  {verdict}",
        flush=True,
    )
    return min(code, 1) if code >= 0 else 1


if __name__ == "__main__":
    sys.exit(main())
