"""Run the seeds' experiments, print the tables, draw the pictures.

python -m benchmarks.seeds --pictures seeds
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.seeds.tables import ahead_table, figure_table, walk_table


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.seeds")
    parser.add_argument("--seeds", type=int, default=100, help="of the simulations")
    parser.add_argument("--walks", type=int, default=10, help="of the walks")
    parser.add_argument("--pictures", type=Path, help="a folder to draw into")
    args = parser.parse_args()
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for lines in (
            figure_table(args.seeds, pool),
            walk_table(args.walks, pool),
            ahead_table(args.walks, pool),
        ):
            for line in lines:
                print(line, flush=True)
            print()
    if args.pictures is not None:
        from benchmarks.seeds.pictures import draw_all

        for path in draw_all(args.pictures):
            print(path)


if __name__ == "__main__":
    main()
