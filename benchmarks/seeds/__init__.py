"""The two documents that this program starts from, and what became of them.

`python -m benchmarks.seeds` runs the algorithm of the bachelor thesis and that of the
project report on samples of their own experiments, beside the filters of imu-tracker on
the same samples, and prints their errors beside the figures that the thesis printed.
The seeds' faults are repeated here on purpose, and nowhere else: docs/seeds.md tells
which, and where the figures of this repetition differ from the printed ones.
"""
