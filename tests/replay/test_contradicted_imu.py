"""Simulated drives on which the IMU is at fault while the receiver is good.

The receiver's own error, of the same rows, is the measure: with it no drive may be
worse than 1.3 times that, nor fall out of its radius.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from struct import pack, unpack

import numpy as np
import pytest

from imu_tracker.pipeline import Pipeline
from imu_tracker.samples import Frame, Mode, SessionHeader, Source
from imu_tracker.simulation import TruthRow, simulate
from imu_tracker.simulation.simulator import START_NS
from support.simulated import SECOND_NS, Figures, compare, run, without

FAULT_S = 100.0
COUNTS_PER_DPS = 65.5  # PS-MPU-6000A section 6.1, 500 deg/s
COUNTS_PER_G = 8192.0  # section 6.2, 4 g

Reading = tuple[int, ...]  # accelerometer x y z, temperature, gyro x y z


@cache
def drive() -> tuple[SessionHeader, list[Frame], list[TruthRow]]:
    """Return a drive of six minutes; the IMU is true on it."""
    made = simulate("drive", seed=5, duration_s=360.0)
    return made.header, list(made.frames), list(made.truth)


def another_chip(reading: Reading) -> Reading:
    """Shift all axes as between two chips of the same datasheet."""
    ax, ay, az = (
        a + round(b * COUNTS_PER_G)
        for a, b in zip(reading[:3], (0.05, -0.06, 0.09), strict=True)
    )
    gx, gy, gz = (
        g + round(b * COUNTS_PER_DPS)
        for g, b in zip(reading[4:], (3.0, -4.0, 2.5), strict=True)
    )
    return (ax, ay, az, reading[3], gx, gy, gz)


def dead_yaw_axis(reading: Reading) -> Reading:
    """Feel no turn about the vertical."""
    return (*reading[:6], 20 + reading[0] % 5)


def turned_by_a_quarter(reading: Reading) -> Reading:
    """Lie turned about the vertical by 90 degrees."""
    ax, ay, az, temp, gx, gy, gz = reading
    return (-ay, ax, az, temp, -gy, gx, gz)


def half_scale(reading: Reading) -> Reading:
    """Measure half of each force, as some clones do."""
    ax, ay, az = (round(0.5 * a) for a in reading[:3])
    return (ax, ay, az, *reading[3:])


def faulty(
    frames: Iterable[Frame], fault: Callable[[Reading], Reading]
) -> Iterator[Frame]:
    """Let a fault begin."""
    for frame in frames:
        is_late = frame.t_ns - START_NS > FAULT_S * SECOND_NS
        if frame.source is Source.IMU and is_late:
            reading = fault(unpack(">7h", frame.data))
            clipped = (min(max(x, -32768), 32767) for x in reading)
            yield frame._replace(data=pack(">7h", *clipped))
        else:
            yield frame


def tracked(frames: Iterable[Frame]) -> tuple[Figures, list[Mode], Pipeline]:
    """Track a session; errors, modes, and what was told."""
    rows, pipeline = run(drive()[0], frames)
    return compare(rows, drive()[2]), [row.mode for row in rows], pipeline


@cache
def receivers_rms_m() -> float:
    """Return the error of the receiver alone, on the same drive."""
    alone = without(drive()[1], Source.IMU, -1.0, 1e6)
    return tracked(alone)[0].between(FAULT_S, 360.0).rms


@pytest.mark.parametrize(
    "fault", [another_chip, dead_yaw_axis, turned_by_a_quarter, half_scale]
)
def test_the_tracker_is_never_worse_than_its_receiver(
    fault: Callable[[Reading], Reading],
) -> None:
    figures, _, pipeline = tracked(faulty(drive()[1], fault))
    after = figures.between(FAULT_S, 360.0)
    assert after.rms < 1.3 * receivers_rms_m()
    assert after.inside > 0.9
    assert pipeline.counters["fixes_reacquired"] <= 1


def test_an_imu_that_contradicts_is_not_used_and_comes_back_relearnt() -> None:
    _, modes, pipeline = tracked(faulty(drive()[1], another_chip))
    since = modes[len(modes) * 100 // 360 :]
    assert Mode.GPSONLY in since
    assert since[-1] is not Mode.GPSONLY
    weights = pipeline.report()["hypotheses"]
    assert weights["imu"] > 0.9
    assert weights["imu"] + weights["receiver_alone"] == pytest.approx(1.0)


def test_without_an_imu_the_radius_does_not_shrink() -> None:
    figures, modes, _ = tracked(without(drive()[1], Source.IMU, FAULT_S, 1e6))
    assert figures.between(FAULT_S, 360.0).inside > 0.9
    early, late = figures.between(FAULT_S, 160.0), figures.between(300.0, 360.0)
    assert np.median(late.r95_m) > 0.8 * np.median(early.r95_m)
    assert modes[-1] is Mode.GPSONLY
