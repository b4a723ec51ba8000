"""An IMU that contradicts a good receiver: never worse than the receiver, and honest.

Faults as users meet them, on a simulated drive from 150 s on: another chip, a box that
turns in its mount, a gyro axis that feels nothing, half the accelerometer's scale, no
IMU at all. The truth is the simulator's exact path.
"""

import math
import struct
from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
import pytest

from imu_tracker.samples import Frame, Source
from imu_tracker.simulation import Simulated, simulate
from imu_tracker.simulation.simulator import START_NS
from simulated import Figures, compare, run

FAULT_S, END_S = 150.0, 350.0
COUNTS_PER_G, COUNTS_PER_DPS = 8192.0, 65.5  # 4 g and 500 deg/s, register map 4.4, 4.5
BURST = struct.Struct(">7h")

Counts = tuple[float, ...]


def another_chip(counts: Counts, t_s: float) -> Counts | None:
    """Silent for 10 s; then other biases, as large as the datasheet allows."""
    if t_s < FAULT_S + 10.0:
        return None
    ax, ay, az, temp, gx, gy, gz = counts
    mg, dps = COUNTS_PER_G * 1e-3, COUNTS_PER_DPS
    accel = (ax + 50 * mg, ay - 60 * mg, az + 90 * mg)
    return (*accel, temp, gx + 3 * dps, gy - 4 * dps, gz + 2.5 * dps)


def turned_box(counts: Counts, t_s: float) -> Counts:
    """By 40 deg about its vertical axis within a second; the gyro measures it."""
    ax, ay, az, temp, gx, gy, gz = counts
    share = min((t_s - FAULT_S) / 1.0, 1.0)
    angle = math.radians(40.0) * share
    rate = 40.0 * COUNTS_PER_DPS if share < 1.0 else 0.0
    c, s = math.cos(angle), math.sin(angle)
    accel = (c * ax + s * ay, c * ay - s * ax, az)
    return (*accel, temp, c * gx + s * gy, c * gy - s * gx, gz + rate)


def dead_gyro_axis(counts: Counts, t_s: float) -> Counts:
    return (*counts[:6], 20.0)


def half_scale(counts: Counts, t_s: float) -> Counts:
    return (*(0.5 * a for a in counts[:3]), *counts[3:])


def silence(counts: Counts, t_s: float) -> None:
    return None


Fault = Callable[[Counts, float], Counts | None]


def drive() -> Simulated:
    return simulate("drive", seed=5, duration_s=END_S)


def broken(frames: Iterator[Frame], fault: Fault) -> Iterator[Frame]:
    for frame in frames:
        t_s = (frame.t_ns - START_NS) * 1e-9
        if frame.source is not Source.IMU or t_s < FAULT_S:
            yield frame
            continue
        counts = fault(BURST.unpack(frame.data), t_s)
        if counts is not None:
            whole = np.clip(np.rint(counts), -32768, 32767).astype(int).tolist()
            yield frame._replace(data=BURST.pack(*whole))


@cache
def tracked(fault: Fault) -> tuple[Figures, list[str]]:
    session = drive()
    rows, pipeline = run(session.header, broken(session.frames, fault))
    return compare(rows, session.truth), pipeline.take_notices()


FAULTS = (another_chip, turned_box, dead_gyro_axis, half_scale, silence)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_imu_does_not_lead_away_from_a_good_receiver(fault: Fault) -> None:
    found, _ = tracked(fault)
    after = found.between(FAULT_S + 15.0, END_S)
    before = found.between(60.0, FAULT_S)
    assert after.rms < 1.3 * max(before.rms, 2.5)  # its receiver: 2.5 m
    assert after.inside >= 0.9


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_event_and_not_a_loop_of_restarts(fault: Fault) -> None:
    _, notices = tracked(fault)
    assert sum("position lost" in notice for notice in notices) <= 1
    assert not any("GPS lost" in notice for notice in notices)


@pytest.mark.parametrize("fault", [another_chip, turned_box])
def test_a_fault_that_is_over_is_learnt_and_the_imu_comes_back(fault: Fault) -> None:
    _, notices = tracked(fault)
    assert "the IMU contradicts the receiver: GPS alone" in notices
    assert "the IMU agrees with the receiver again" in notices
