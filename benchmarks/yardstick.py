"""A fixed piece of pure Python, to tell a slow program from a busy machine."""

import time
from typing import Final

TURNS: Final = 100_000


def yardstick_s() -> float:
    """Measure the processor time of a hundred thousand quaternion products.

    Tuples of floats, a call, some attribute-free arithmetic: what a sample costs
    imu-tracker is of the same kind. It must never change: figures of years ago are
    compared by it.
    """
    q = turn = (0.8, 0.0, 0.6, 0.0)
    begin = time.process_time()
    for _ in range(TURNS):
        q = _product(q, turn)
    return time.process_time() - begin


def _product(
    p: tuple[float, float, float, float], q: tuple[float, float, float, float]
) -> tuple[float, float, float, float]:
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return (
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )
