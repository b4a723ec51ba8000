"""Print the table of the campaign with what was measured: `python -m faults`."""

from faults.campaign import run
from faults.table import FAULTS


def main() -> None:
    print("| fault | recovered after | r95 holds |")
    for fault in FAULTS:
        cells = {phase: run(fault, phase) for phase in fault.phases}
        print(
            fault.name,
            {
                str(p): (c.back_s and round(c.back_s, 2), round(c.inside, 3))
                for p, c in cells.items()
            },
            flush=True,
        )
        for p, c in cells.items():
            for x in c.complaints:
                print("      !!", p, x)


if __name__ == "__main__":
    main()
