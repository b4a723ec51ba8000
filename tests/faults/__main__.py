"""Print the tables of docs/reliability.md, measured now: `python -m faults`.

In the directory `tests`; it takes a minute. See also `faults.kills` and
`faults.protections`.
"""

import argparse

from faults.campaign import Cell, run
from faults.protections import PROTECTIONS
from faults.table import ALWAYS, FAULTS


def main() -> None:
    """Run every cell, or only list what protects."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--protections", action="store_true", help="list, run nothing")
    parser.add_argument("--estimator", default="error-state")
    arguments = parser.parse_args()
    if arguments.protections:
        print("| trap | protection | where | test |\n| --- | --- | --- | --- |")
        for entry in PROTECTIONS:
            name = entry.test.strip("[]").removeprefix("tests/")
            print(f"| {entry.trap} | {entry.protection} | `{entry.place}` | {name} |")
        return
    print("| fault | at most | " + " | ".join(ALWAYS) + " |")
    print("| --- " * (2 + len(ALWAYS)) + "|")
    for fault in FAULTS:
        cells = {
            phase: run(fault, phase, f"filter.estimator={arguments.estimator}")
            for phase in fault.phases
        }
        limit = f"{fault.within_s:g} s" if fault.back else ""
        told = [
            _text(cells[phase], is_true=fault.is_true) if phase in cells else ""
            for phase in ALWAYS
        ]
        print(f"| {fault.name} | {limit} | " + " | ".join(told) + " |", flush=True)


def _text(cell: Cell, *, is_true: bool) -> str:
    """How long it took, how many rows held the truth, and what was wrong."""
    parts = [] if cell.back_s is None else [f"{cell.back_s:.2f} s"]
    parts.append(f"{cell.inside:.0%}" if is_true else "told")
    return ", ".join(parts) + (" **!**" if cell.complaints else "")


if __name__ == "__main__":
    main()
