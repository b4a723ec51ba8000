"""Installations that went wrong, simulated: what an owner's recording would hold."""

import math
from collections.abc import Iterable, Iterator
from functools import reduce
from operator import xor
from struct import pack, unpack
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from imu_tracker.samples import Frame, SessionHeader, Source, Vec3
from imu_tracker.simulation import simulate
from imu_tracker.simulation.imu.errors import TYPICAL_CHIP
from imu_tracker.simulation.simulator import START_NS

Stream: TypeAlias = Iterator[SessionHeader | Frame]
Array: TypeAlias = NDArray[np.float64]

RATE_HZ = 50.0
SEED = 3
DPS = math.radians(1.0)


def sound(duration_s: float = 300.0) -> Stream:
    """A box as it should be."""
    drive = simulate("drive", seed=SEED, duration_s=duration_s, rate_hz=RATE_HZ)
    yield drive.header
    yield from drive.frames


def about(axis: int, deg: float) -> Array:
    """Rotation of chip axes about one of them."""
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    turn = np.eye(3)
    i, j = [k for k in range(3) if k != axis]
    turn[i, i] = turn[j, j] = c
    turn[i, j], turn[j, i] = -s, s
    return turn


def turned(frame: Frame, turn: Array, rate_dps: Vec3 = (0.0, 0.0, 0.0)) -> Frame:
    """What a chip that is turned, and turning, against its box would have read."""
    ax, ay, az, temp, gx, gy, gz = unpack(">7h", frame.data)
    accel, gyro = turn @ [ax, ay, az], turn @ [gx, gy, gz]
    gyro += 65.5 * np.array(rate_dps)  # counts at 500 deg/s
    counts = [*accel, temp, *gyro]
    limited = [min(max(round(float(value)), -32768), 32767) for value in counts]
    return frame._replace(data=pack(">7h", *limited))


def lying_on_its_side() -> Stream:
    """The box lies on another face than `imu.mount` says."""
    for item in sound(120.0):
        if isinstance(item, Frame) and item.source is Source.IMU:
            item = turned(item, about(0, 90.0))
        yield item


def turned_about_the_vertical() -> Stream:
    """The box looks to the side instead of ahead."""
    for item in sound(420.0):
        if isinstance(item, Frame) and item.source is Source.IMU:
            item = turned(item, about(2, 60.0))
        yield item


def loose_box() -> Stream:
    """The box tips over in its mount at bumps, and rattles: both turn the gyro, too."""
    rng = np.random.default_rng(SEED)
    rest_deg, before_deg = np.zeros(2), np.zeros(2)  # about chip x and y
    next_ns, is_moving = 0, False
    for item in sound():
        if isinstance(item, Frame) and item.source is Source.GPS:
            fields = item.data.split(b",")
            if fields[0].endswith(b"RMC") and fields[7]:
                is_moving = float(fields[7]) > 6.0  # knots
        if isinstance(item, Frame) and item.source is Source.IMU:
            if is_moving and item.t_ns >= next_ns:
                next_ns = item.t_ns + int(rng.uniform(2e9, 8e9))
                rest_deg = rng.uniform(-25.0, 25.0, 2)
            now_deg = rest_deg + is_moving * rng.normal(0.0, 0.3, 2)
            turn = about(0, now_deg[0]) @ about(1, now_deg[1])
            rate_dps = (now_deg - before_deg) * RATE_HZ
            before_deg = now_deg
            item = turned(item, turn, (-rate_dps[0], -rate_dps[1], 0.0))
        yield item


def turned_once(deg: float) -> Stream:
    """The box is knocked over while it drives off, and stays so."""
    is_turned = False
    for item in sound():
        if isinstance(item, Frame) and item.source is Source.IMU:
            is_turned = is_turned or item.t_ns - START_NS > 60e9
            yield turned(item, about(0, deg)) if is_turned else item
        else:
            yield item


def slow_line() -> Stream:
    """Ten fixes a second over 9600 baud."""
    drive = simulate(
        "drive",
        seed=SEED,
        duration_s=90.0,
        rate_hz=RATE_HZ,
        gps_every_s=0.1,
        baud=9600,
    )
    yield drive.header
    yield from drive.frames


def cold_clone() -> Stream:
    """A chip that drifts as it warms up, is noisy, and has a wrong scale."""
    errors = TYPICAL_CHIP._replace(
        gyro_per_degc_sigma_radps=0.25 * DPS,
        gyro_bias_sigma_radps=4.0 * DPS,
        warm_up_degc=25.0,
        warm_up_tau_s=120.0,
        gyro_noise_radps_rthz=0.03 * DPS,
        accel_scale_sigma=0.05,
    )
    drive = simulate(
        "drive", seed=SEED, duration_s=300.0, rate_hz=RATE_HZ, errors=errors
    )
    yield drive.header
    yield from drive.frames


def bad_antenna_cable(*, tells_signals: bool) -> Stream:
    """Few satellites, weak ones, and no fix for some seconds again and again."""
    rng = np.random.default_rng(SEED)
    lost_until_ns = 0
    for item in sound(240.0):
        if isinstance(item, SessionHeader) or item.source is not Source.GPS:
            yield item
            continue
        since_s = (item.t_ns - START_NS) * 1e-9
        if since_s > 30.0 and item.t_ns > lost_until_ns and rng.random() < 0.05:
            lost_until_ns = item.t_ns + int(rng.uniform(3e9, 9e9))
        yield item._replace(data=_weak(item.data, is_lost=item.t_ns < lost_until_ns))
        if tells_signals and b"GGA" in item.data:
            yield item._replace(
                data=sentence(
                    "GPGSV,1,1,04,02,35,291,19,03,09,129,21,05,14,305,18,07,38,126,22"
                )
            )


def _weak(line: bytes, *, is_lost: bool) -> bytes:
    """Rewrite a sentence of a receiver with four satellites, or of one without fix."""
    fields = line.decode().partition("*")[0][1:].split(",")
    if fields[0].endswith("RMC") and is_lost:
        fields[2:9] = ["V", "", "", "", "", "", ""]
    if fields[0].endswith("GGA"):
        if is_lost:
            fields[2:10] = ["", "", "", "", "0", "02", "99.99", ""]
        elif fields[6] == "1":
            fields[7:9] = ["04", "4.10"]
    return sentence(",".join(fields))


def sentence(body: str) -> bytes:
    """Put the checksum behind a sentence."""
    return f"${body}*{reduce(xor, body.encode()):02X}".encode()


def without(stream: Iterable[SessionHeader | Frame], source: Source) -> Stream:
    """Leave a source out."""
    for item in stream:
        if isinstance(item, SessionHeader) or item.source is not source:
            yield item


def half_dead(stream: Iterable[SessionHeader | Frame], from_s: float) -> Stream:
    """Let an axis of the gyro stand from some second on."""
    from_ns = START_NS + round(from_s * 1e9)
    for item in stream:
        is_imu = isinstance(item, Frame) and item.source is Source.IMU
        if isinstance(item, Frame) and is_imu and item.t_ns >= from_ns:
            data = item.data[:10] + pack(">h", 7) + item.data[12:]
            item = item._replace(data=data)
        yield item
