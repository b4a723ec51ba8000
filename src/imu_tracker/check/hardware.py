"""What a real Pi shows that no fake can: bus, timing, load, errors, the chip at rest.

Measures with the driver that the daemon uses and returns plain numbers for a JSON file.
Positions are not in it. What a newcomer gets wrong: the time of a burst on the wire is
the least part of it; what a busy computer adds shows in the slowest of them.
"""

import contextlib
import errno
import os
import platform
import statistics
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from imu_tracker import __version__
from imu_tracker.calibration.measures import AxisMeasures
from imu_tracker.check.sensors import Finding, check_gps
from imu_tracker.config import Config
from imu_tracker.errors import BusError, TrackerError
from imu_tracker.recording.capture import capture
from imu_tracker.recording.sensor_report import report_of
from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS, Clock
from imu_tracker.sensors.imu.selftest import self_test
from imu_tracker.sources import factory as hardware
from imu_tracker.sources.polled import for_seconds, live_frames

BURSTS_NS: Final = 5 * SECOND_NS
WIRE_NS: Final = 20 * SECOND_NS
WIRE_PERIOD_NS: Final = 20 * MILLISECOND_NS

_DEVICE_TREE: Final = Path("/proc/device-tree/model")
_THERMAL: Final = Path("/sys/class/thermal/thermal_zone0/temp")
_GOVERNOR: Final = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
_MOUNTS: Final = Path("/proc/self/mounts")

_DURABLE: Final = ("ext4", "btrfs", "f2fs", "xfs")


def computer(config: Config) -> dict[str, Any]:
    """Return what this computer is, and how it was started."""
    uptime_s = time.clock_gettime(time.CLOCK_BOOTTIME)
    return {
        "imu_tracker": __version__,
        "python": platform.python_version(),
        "model": _text(_DEVICE_TREE).rstrip("\0"),
        "machine": platform.machine(),
        "kernel": platform.release(),
        "system": platform.freedesktop_os_release().get("PRETTY_NAME", ""),
        "governor": _text(_GOVERNOR),
        "start_s": _round(uptime_s - _started_s()),
        "uptime_s": round(uptime_s),
        "load": [_round(load) for load in os.getloadavg()],
        "cpu_degc": cpu_degc(),
        "i2c_clock_hz": _i2c_clock_hz(config.imu.bus),
        "power_cut": power_cut(config.log.path),
    }


def cpu_degc() -> float | None:
    """Return the temperature of the processor; None when the kernel does not say."""
    with contextlib.suppress(ValueError):
        return int(_text(_THERMAL)) / 1000.0
    return None


def power_cut(log: Path, mounts: str | None = None) -> dict[str, str]:
    """Return what the log's file system is, and what that means for a power cut."""
    best, kind, options = Path("/"), "", ""
    for line in (mounts or _text(_MOUNTS)).splitlines():
        _, place, name, flags, *_ = [*line.split(), "", "", "", ""]
        here = Path(place)
        if log.absolute().is_relative_to(here) and len(place) >= len(str(best)):
            best, kind, options = here, name, flags
    if kind in _DURABLE:
        advice = (
            "at most log.sync_s of rows are lost, as far as the card keeps its word"
        )
    elif kind in ("tmpfs", "ramfs", "overlay"):
        advice = "nothing outlasts a power cut here: put log.path on the card"
    else:
        advice = "not tried: a journalling file system such as ext4 is safer"
    return {"file_system": kind, "options": options, "advice": advice}


def bursts(config: Config, clock: Clock) -> dict[str, Any]:
    """Read bursts as fast as the bus goes, and the chip's own test before that.

    Raises
    ------
    BusError, DeviceNotFoundError
        When the chip does not answer.
    """
    with contextlib.closing(hardware.open_imu_bus(config)) as bus:
        imu = hardware.imu_driver(config, bus, clock)
        chip = imu.probe()
        axes = self_test(imu, clock)
        imu.configure(hardware.imu_settings(config))
        took_us, failed = [], 0
        end_ns = clock.now_ns() + BURSTS_NS
        while (begin_ns := clock.now_ns()) < end_ns:
            try:
                imu.read_burst()
            except BusError:
                failed += 1
                clock.sleep_until_ns(begin_ns + MILLISECOND_NS)
                continue
            took_us.append((clock.now_ns() - begin_ns) / 1000.0)
    return {
        "chip": chip.name,
        "who_am_i": f"0x{chip.who_am_i:02X}",
        "self_test": {
            axis.axis: {"verdict": str(axis.verdict), "change": axis.change}
            for axis in axes
        },
        "bursts_per_s": _round(len(took_us) * SECOND_NS / BURSTS_NS),
        "burst_us": _spread(took_us),
        "failed": failed,
    }


def at_rest(config: Config, clock: Clock, seconds: float) -> dict[str, Any]:
    """Take samples as the daemon does, and say how they came and how they scatter.

    Raises
    ------
    BusError, DeviceNotFoundError, CalibrationError
        When the chip does not answer, or was not at rest for long enough.
    """
    before_degc, cpu_s, begin_ns = cpu_degc(), _cpu_s(), clock.now_ns()
    with contextlib.closing(live_frames(config, clock)) as live:
        taken = capture(for_seconds(live, seconds))
    elapsed_s = (clock.now_ns() - begin_ns) / SECOND_NS
    used_s = _cpu_s() - cpu_s
    report = report_of(taken)
    return {
        "seconds": _round(report.length_s),
        "still_s": _round(report.still_s),
        "rate_hz": _round(report.rate_hz),
        "rate_error": _round(report.rate_error),
        "jitter_us": _round(report.jitter_s * 1e6),
        "missing": report.missing,
        "chip_degc": [_round(temp) for temp in report.temps_degc],
        "cpu_degc": [before_degc, cpu_degc()],
        "cpu_share": _round(used_s / elapsed_s) if elapsed_s > 0 else None,
        "axes": {axis.name: _axis(axis) for axis in report.axes},
    }


def pulled_wire(config: Config, clock: Clock) -> dict[str, Any]:
    """Read on while somebody pulls a wire, and count which errors the kernel gives.

    Raises
    ------
    BusError, DeviceNotFoundError
        When the chip does not answer at the beginning.
    """
    found: Counter[str] = Counter()
    slowest_ns, last_failure_ns, good = 0, 0, 0
    with contextlib.closing(hardware.open_imu_bus(config)) as bus:
        imu = hardware.imu_driver(config, bus, clock)
        imu.configure(hardware.imu_settings(config))
        end_ns = clock.now_ns() + WIRE_NS
        while (begin_ns := clock.now_ns()) < end_ns:
            try:
                imu.read_burst()
                good += 1
            except BusError as error:
                found[_name_of(error)] += 1
                last_failure_ns = clock.now_ns()
            slowest_ns = max(slowest_ns, clock.now_ns() - begin_ns)
            clock.sleep_until_ns(begin_ns + WIRE_PERIOD_NS)
        is_configured = False
        with contextlib.suppress(BusError):
            is_configured = imu.is_configured()
    return {
        "read": good,
        "errors": dict(found),
        "slowest_ms": _round(slowest_ns / MILLISECOND_NS),
        "answers_again": bool(found) and end_ns - last_failure_ns > SECOND_NS,
        "still_configured": is_configured,  # else it lost its power, not its wire
    }


def receiver(config: Config, clock: Clock) -> list[str]:
    """Return what `check` finds of the receiver; no position is in it."""
    return [_line(finding) for finding in check_gps(config, clock)]


def attempted(part: Callable[[], Any]) -> Any:
    """Return what a part found, or the error that ended it: the rest goes on."""
    try:
        return part()
    except TrackerError as error:
        return {"error": str(error)}


def _line(finding: Finding) -> str:
    return f"{finding.verdict} {finding.what}: {finding.text}"


def _axis(axis: AxisMeasures) -> dict[str, Any]:
    return {"mean": axis.mean, "std": axis.std, "verdict": str(axis.verdict)}


def _name_of(error: BusError) -> str:
    cause = error.__cause__
    number = cause.errno if isinstance(cause, OSError) else None
    return errno.errorcode.get(number, str(number)) if number else "unknown"


def _spread(values: list[float]) -> dict[str, float]:
    """Return median, 99th percentile and greatest of some times."""
    if not values:
        return {}
    ordered = sorted(values)
    return {
        "p50": _round(statistics.median(ordered)),
        "p99": _round(ordered[min(len(ordered) - 1, len(ordered) * 99 // 100)]),
        "max": _round(ordered[-1]),
    }


def _round(value: float) -> float:
    return float(f"{value:.4g}")


def _text(path: Path) -> str:
    try:
        return path.read_text("utf-8", "replace").strip()
    except OSError:
        return ""


def _started_s() -> float:
    """Return when this process was started, in seconds after the computer's start."""
    fields = _text(Path("/proc/self/stat")).rpartition(")")[2].split()
    return int(fields[19]) / os.sysconf("SC_CLK_TCK")  # starttime, field 22 of proc(5)


def _cpu_s() -> float:
    used = os.times()
    return used.user + used.system


def _i2c_clock_hz(bus: int) -> int | None:
    node = Path(f"/sys/bus/i2c/devices/i2c-{bus}/of_node/clock-frequency")
    with contextlib.suppress(OSError):
        return int.from_bytes(node.read_bytes(), "big")
    return None
