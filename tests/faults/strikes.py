"""What befalls a bench: each strikes at a second of the drive."""

import errno
import os
import random
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from fake_i2c import FakeMpu6050
from fake_i2c.world import Feeling
from faults import sentences
from faults.bench import Bench
from faults.drives import S, Said, clock_ns
from imu_tracker.samples import Frame, Source
from imu_tracker.sources.live import MAX_WAITING
from imu_tracker.storage.latlong import HEADER
from support.small_disk import SmallDisk

# ------------------------------------------------------------------- the bus, the chip


def nack_once(bench: Bench, at_s: float) -> None:
    bench.at(at_s, bench.bus.nack)


def bus_fails(seconds: float, error: int, hang_s: float = 0.0) -> Callable[..., None]:
    def strike(bench: Bench, at_s: float) -> None:
        end_s = min(at_s + seconds, 1e6)
        bench.bus.fail_between(clock_ns(at_s), clock_ns(end_s), error, hang_s=hang_s)

    return strike


def unplugged_adapter(bench: Bench, at_s: float) -> None:
    bench.at(at_s, bench.bus.unplug)
    bench.at(at_s + 10, bench.bus.plug)


def another_chip(bench: Bench, at_s: float) -> None:
    own = bench.chip

    def swap() -> None:
        bench.bus.chips[0x68] = FakeMpu6050(bench.clock, who_am_i=0x72)

    def swap_back() -> None:
        own.power_on()
        bench.bus.chips[0x68] = own

    bench.at(at_s, swap)
    bench.at(at_s + 10, swap_back)


def brown_out(bench: Bench, at_s: float) -> None:
    bench.at(at_s, bench.chip.brown_out)


def other_ranges(bench: Bench, at_s: float) -> None:
    """Put only the ranges back to their defaults: the chip goes on delivering."""
    bench.at(at_s, lambda: bench.chip.write(0x1B, 0))
    bench.at(at_s, lambda: bench.chip.write(0x1C, 0))


def stalled_host(bench: Bench, at_s: float) -> None:
    """Give nobody a turn for so long that the FIFO runs over (730 ms at 100 Hz)."""
    bench.at(at_s, lambda: bench.clock.stall(round(1.2 * S)))


def shifted_fifo(bench: Bench, at_s: float) -> None:
    bench.at(at_s + 0.035, lambda: bench.chip.read(0x74, 1))


def wedged(bench: Bench, at_s: float) -> None:
    bench.at(at_s, lambda: setattr(bench.chip, "is_wedged", True))


def bit_flips(bench: Bench, at_s: float) -> None:
    rng = random.Random(5)

    def flip() -> None:
        byte, bit = rng.randrange(70), rng.randrange(8)
        bench.bus.flip(byte, bit, after=rng.randrange(3))

    for number in range(40):
        bench.at(at_s + number / 4, flip)


def axis(
    name: str, seconds: float, value: float | None = None
) -> Callable[[Bench, float], None]:
    """Let an axis show a value (its own of that moment) for some seconds."""
    field, index = ("accel_g" if name[0] == "a" else "gyro_dps"), "xyz".index(name[1])

    def strike(bench: Bench, at_s: float) -> None:
        feel = bench.chip.world.at
        start_s = clock_ns(at_s) / S
        stands = getattr(feel(start_s), field)[index] if value is None else value

        def broken(t_s: float) -> Feeling:
            felt = bench.drive.feel(t_s)
            if not start_s <= t_s < start_s + seconds:
                return felt
            axes = list(getattr(felt, field))
            axes[index] = stands
            x, y, z = axes
            if field == "accel_g":
                return felt._replace(accel_g=(x, y, z))
            return felt._replace(gyro_dps=(x, y, z))

        bench.chip.world.follow(broken)

    return strike


def clips_in_bursts(bench: Bench, at_s: float) -> None:
    """Vibrate to the end of the range for 0.8 s of each 1.2 s, 20 s long."""
    start_s = clock_ns(at_s) / S

    def shaken(t_s: float) -> Feeling:
        felt = bench.drive.feel(t_s)
        if not start_s <= t_s < start_s + 20.0 or (t_s - start_s) % 1.2 > 0.8:
            return felt
        return felt._replace(accel_g=(9.0, *felt.accel_g[1:]))

    bench.chip.world.follow(shaken)


# ----------------------------------------------------------------------- the receiver


def said(change: sentences.Change, seconds: float = 10.0) -> Callable[..., list[Said]]:
    return lambda lines, at_s: sentences.changed(lines, at_s, at_s + seconds, change)


def silent(lines: list[Said], at_s: float) -> list[Said]:
    return sentences.without(lines, at_s, at_s + 10)


def silent_for_ever(lines: list[Said], at_s: float) -> list[Said]:
    return sentences.without(lines, at_s, 1e6)


def noise(bench: Bench, at_s: float) -> None:
    rng = random.Random(3)
    bench.at(at_s, lambda: setattr(bench.line, "hear", lambda b: rng.randbytes(len(b))))
    bench.at(at_s + 10, lambda: setattr(bench.line, "hear", lambda b: b))


def other_baud(bench: Bench, at_s: float) -> None:
    bench.at(at_s, lambda: setattr(bench.line, "baud", 38400))


def unplugged_receiver(bench: Bench, at_s: float) -> None:
    bench.at(at_s, bench.line.unplug)
    bench.at(at_s + 10, bench.line.plug)


def doubled(lines: list[Said], at_s: float) -> list[Said]:
    first, end = clock_ns(at_s), clock_ns(at_s + 10)
    return [
        again
        for line in lines
        for again in ([line, line] if first <= line.t_ns < end else [line])
    ]


def disordered(lines: list[Said], at_s: float) -> list[Said]:
    """Hold every other epoch back until the next one is out."""
    epochs = sentences.epochs(lines)
    first, end = clock_ns(at_s), clock_ns(at_s + 10)
    for index in range(0, len(epochs) - 1, 2):
        early, late = epochs[index : index + 2]
        if first <= early[0].t_ns and late[-1].t_ns < end:
            held = [Said(late[-1].t_ns + 1, line.line) for line in early]
            epochs[index : index + 2] = [late, held]
    return [line for epoch in epochs for line in epoch]


# ------------------------------------------------------------------- the host, the disk


def stepped_clock(bench: Bench, at_s: float) -> None:
    """Step the system clock, first hours ahead and then back to 1970."""
    real, real_ns = time.time, time.time_ns  # noqa: TID251

    def step(by_s: float) -> None:
        bench.monkeypatch.setattr(time, "time", lambda: max(0.0, real() + by_s))
        bench.monkeypatch.setattr(
            time, "time_ns", lambda: max(0, real_ns() + round(by_s * S))
        )

    bench.at(at_s, lambda: step(5 * 3600))
    bench.at(at_s + 5, lambda: step(-2e9))


def full_disk(bench: Bench, at_s: float) -> None:
    disk = SmallDisk(bench.monkeypatch)
    bench.at(at_s, lambda: setattr(disk, "free_bytes", 30))
    bench.at(at_s + 10, lambda: setattr(disk, "free_bytes", 1_000_000_000))


def failing_disk(bench: Bench, at_s: float) -> None:
    disk = SmallDisk(bench.monkeypatch)
    bench.at(at_s, lambda: setattr(disk, "fails", True))
    bench.at(at_s + 10, lambda: setattr(disk, "fails", False))


def read_only(bench: Bench, at_s: float) -> None:
    """Mount the directory of the log read-only, as ext4 does on errors."""
    real_open, real_write = os.open, os.write
    is_read_only = [False]

    def refuse() -> NoReturn:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    def opened(path: Any, flags: int, *rest: Any, **named: Any) -> int:
        is_ours = str(path).startswith(str(bench.log.parent))
        if is_read_only[0] and is_ours and flags & (os.O_RDWR | os.O_WRONLY):
            refuse()
        return real_open(path, flags, *rest, **named)

    def written(fd: int, data: bytes, /) -> int:
        if is_read_only[0] and "latlong" in str(Path(f"/proc/self/fd/{fd}").readlink()):
            refuse()
        return real_write(fd, data)

    bench.monkeypatch.setattr(os, "open", opened)
    bench.monkeypatch.setattr(os, "write", written)
    bench.at(at_s, lambda: is_read_only.__setitem__(0, True))
    bench.at(at_s + 10, lambda: is_read_only.__setitem__(0, False))


def future_log(bench: Bench, _: float) -> None:
    """Find a log that a receiver of wrong date has written."""
    row = "2030-01-01T00:00:00.000Z,51.99000000,4.37000000,5.2,0.00,,3.90,gps"
    bench.log.parent.mkdir()
    bench.log.write_text(f"{HEADER}\n{row}\n", encoding="ascii")


def deleted_log(bench: Bench, at_s: float) -> None:
    bench.at(at_s, lambda: bench.log.unlink(missing_ok=True))


def deleted_directory(bench: Bench, at_s: float) -> None:
    bench.at(at_s, lambda: shutil.rmtree(bench.log.parent))


def sighup(bench: Bench, at_s: float) -> None:
    bench.at(at_s, bench.signals.reopen)


def flood(bench: Bench, at_s: float) -> None:
    """Put more lines into the queue than it holds, in one go."""

    def put() -> None:
        frame = Frame(bench.clock.now_ns(), Source.GPS, b"flood")
        for _ in range(MAX_WAITING + 500):
            bench.put(frame)

    bench.at(at_s, put)
