"""A simulated drive as the models of chip and receiver need it, and its truth.

Twenty seconds at rest, then town traffic. The simulator decides what is felt and what
the receiver says; chip, bus and serial line make bytes of it.
"""

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from fake_i2c.world import Feeling
from imu_tracker.samples import Source
from imu_tracker.simulation import TruthRow, simulate
from imu_tracker.simulation.receiver.receiver import TYPICAL_RECEIVER
from imu_tracker.simulation.simulator import START_NS

S: Final = 1_000_000_000
LENGTH_S: Final = 100
FIRST_FIX_S: Final = 4  # a warm receiver
SEED: Final = 2  # drives from second 21 on, without a stop and without a tunnel

_COUNTS_PER_G, _COUNTS_PER_DPS = 8192.0, 65.5  # 4 g, 500 deg/s


class Said(NamedTuple):
    """A line of the receiver without its end, and when its first byte arrives."""

    t_ns: int
    line: bytes


class Drive(NamedTuple):
    """What happens; seconds count from the start of the daemon."""

    feelings: list[tuple[float, ...]]  # t_s of the clock, g, deg/s, deg C
    lines: list[Said]
    truth: list[TruthRow]

    def feel(self, t_s: float) -> Feeling:
        """Return what the chip feels at a time of the clock, between two readings."""
        rows = self.feelings
        first_s, last_s = rows[0][0], rows[-1][0]
        rate = (len(rows) - 1) / (last_s - first_s)
        index = min(max(int((t_s - first_s) * rate), 0), len(rows) - 2)
        old, new = rows[index], rows[index + 1]
        share = min(max((t_s - old[0]) / (new[0] - old[0]), 0.0), 1.0)
        _, ax, ay, az, gx, gy, gz, temp = (
            a + share * (b - a) for a, b in zip(old, new, strict=True)
        )
        return Feeling((ax, ay, az), (gx, gy, gz), temp)


@lru_cache(maxsize=4)
def drive(
    gps_every_s: float = 1.0,
    baud: int = 9600,
    *,
    scenario: str = "drive",
    seed: int = SEED,
) -> Drive:
    """Simulate it; once per process for each kind of receiver."""
    receiver = TYPICAL_RECEIVER._replace(
        time_after_s=1.0, fix_after_s=float(FIRST_FIX_S), baud=baud
    )
    simulated = simulate(
        scenario,
        seed=seed,
        duration_s=LENGTH_S,
        gps_every_s=gps_every_s,
        receiver=receiver,
    )
    feelings, lines = [], []
    for t_ns, source, data in simulated.frames:
        if source is Source.GPS:
            lines.append(Said(t_ns, data))
        else:
            ax, ay, az, temp, gx, gy, gz = np.frombuffer(data, ">i2").tolist()
            feelings.append(
                (
                    t_ns / S,
                    *(count / _COUNTS_PER_G for count in (ax, ay, az)),
                    *(count / _COUNTS_PER_DPS for count in (gx, gy, gz)),
                    temp / 340.0 + 36.53,
                )
            )
    return Drive(feelings, lines, list(simulated.truth))


def clock_ns(second: float) -> int:
    """Return the time of the clock at a second of the drive."""
    return START_NS + round(second * S)
