# ruff: noqa: E501 - texts of the product are quoted as they stand there
"""Trap, protection, test: each protection can be taken out, and its test then fails.

    python -m faults.protections      take out one after the other, and say what fell

A protection is named by the text that makes it; `without` is what stands there when it
is taken out. What a newcomer gets wrong: a test that passes proves nothing before it
has been seen to fail.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parent.parent.parent
CELL: Final = (
    "tests/faults/test_campaign.py::test_the_daemon_survives_and_tells_the_truth"
)


class Protection(NamedTuple):
    """One of them; `tests` are node ids, or cells of the campaign in brackets."""

    trap: str
    protection: str
    file: str
    text: str
    without: str
    test: str

    @property
    def node(self) -> str:
        return f"{CELL}{self.test}" if self.test.startswith("[") else self.test


PROTECTIONS: Final = (
    Protection(
        *("one NACK ends the program", "a failed transfer is tried again"),
        *(
            "sensors/imu/reader.py",
            "                if has_failed:\n",
            "                if True:\n",
        ),
        "tests/unit/test_imu_reader.py",
    ),
    Protection(
        *("OSError 121 ends the program", "the reader catches it and opens again"),
        *(
            "sensors/imu/reader.py",
            "except (TrackerError, OSError) as error",
            "except KeyError as error",
        ),
        "[NACK for 10 s-moving]",
    ),
    Protection(
        *("the bus comes back, the driver does not", "attempts at most 0.5 s apart"),
        *(
            "sensors/imu/reader.py",
            "LAST_RETRY_NS: Final = 500 * M",
            "LAST_RETRY_NS: Final = 60_000 * M",
        ),
        "[NACK for 10 s-moving]",
    ),
    Protection(
        *(
            "a dead file descriptor after an unplugged adapter",
            "the bus is opened anew",
        ),
        *(
            "sensors/imu/reader.py",
            "with closing(self._open_bus()) as bus:",
            "self._b = bus = getattr(self, '_b', None) or self._open_bus()\n        if True:",
        ),
        "[adapter unplugged for 10 s-moving]",
    ),
    Protection(
        *("another chip under the same name", "WHO_AM_I is checked"),
        *(
            "sensors/imu/mpu6050.py",
            "if who_am_i not in CHIPS and not self._allow_unknown:",
            "if False:",
        ),
        "[another WHO_AM_I for 10 s-moving]",
    ),
    Protection(
        *("a brown-out puts the ranges back", "registers are read back twice a second"),
        *("sensors/imu/reader.py", "if not imu.is_configured():", "if False:"),
        "[ranges back to default-moving]",
    ),
    Protection(
        *("a brown-out is noticed late", "twice a second, not each second"),
        *(
            "sensors/imu/reader.py",
            "SCRUB_NS: Final = 500 * M",
            "SCRUB_NS: Final = 1000 * M",
        ),
        "[ranges back to default-moving]",
    ),
    Protection(
        *("a repaired brown-out that nobody hears of", "the event imu_reset"),
        *("sensors/imu/reader.py", 'self._tell("reset", self._reset_reason)', "pass"),
        "[brown-out-moving]",
    ),
    Protection(
        *("a chip that repeats its last sample", "frames are compared"),
        *(
            "sensors/imu/sources.py",
            "if max(self._silent_looks, self._same_looks) < self._patience:",
            "if True:",
        ),
        "[chip repeats itself-moving]",
    ),
    Protection(
        *("FIFO overflow, plausible nonsense", "the overflow bit and the count"),
        *(
            "sensors/imu/fifo.py",
            "if FIFO_OFLOW_INT.get(status) or count >= self._chip.fifo_bytes:",
            "if False:",
        ),
        "[FIFO overflow: host stalls 1.2 s-moving]",
    ),
    Protection(
        *("a FIFO shifted by a byte", "whole frames only"),
        *(
            "sensors/imu/fifo.py",
            "        if count % FRAME_BYTES:\n            return",
            "        if False:\n            return",
        ),
        "tests/unit/test_fifo.py",
    ),
    Protection(
        *("a read of the FIFO that broke off", "then it is emptied"),
        *(
            "sensors/imu/fifo.py",
            "self._is_in_doubt = True  # until",
            "self._is_in_doubt = False  # until",
        ),
        "tests/unit/test_fifo.py",
    ),
    Protection(
        *("frames that are shifted look plausible", "the temperature cannot jump"),
        *("sensors/imu/fifo.py", "if not self._is_aligned(frames):", "if False:"),
        "tests/unit/test_fifo.py",
    ),
    Protection(
        *("register writes that are lost", "each is read back"),
        *(
            "sensors/imu/mpu6050.py",
            "            self.registers.put(register, value)\n        self._sleep_ms(_GYRO",
            "            self.registers.write(register, value)\n        self._sleep_ms(_GYRO",
        ),
        "tests/unit/test_mpu6050.py",
    ),
    Protection(
        *("settings that another program left", "a device reset at the start"),
        *("sensors/imu/mpu6050.py", "        self.reset()\n", ""),
        "tests/unit/test_mpu6050.py",
    ),
    Protection(
        *("an axis that stands", "its counts are compared with those of the others"),
        *(
            "motion/stuck_axes.py",
            "        if self._stuck:\n            self.counters",
            "        if False:\n            self.counters",
        ),
        "[axis stuck for 10 s: gyro z-outage]",
    ),
    Protection(
        *("an axis at the end of its range", "after 0.2 s the IMU is not used"),
        *(
            "motion/stuck_axes.py",
            "        if sample.t_ns - self._clipped_ns < CLIPPED_NS:",
            "        if True:",
        ),
        "[axis clipped for 10 s: accel x-outage]",
    ),
    Protection(
        *("a chip that is 2 % fast", "its clock is fitted to the host's"),
        *("sensors/imu/sample_clock.py", "self._p += gain_p * innovation", "pass"),
        "tests/unit/test_sample_clock.py",
    ),
    Protection(
        *("an unplugged receiver ends the process", "the port is opened again"),
        *(
            "sensors/gnss/reader.py",
            "except FAULTS as error:",
            "except KeyError as error:",
        ),
        "[GPS unplugged for 10 s-moving]",
    ),
    Protection(
        *("the wrong baud rate", "all are tried in turn"),
        *(
            "sensors/gnss/baud.py",
            "            self.baud = self._candidate\n",
            "            pass\n",
        ),
        "[GPS at another baud-moving]",
    ),
    Protection(
        *(
            "noise sends the search for the speed away",
            "the known one gets every other turn",
        ),
        *(
            "sensors/gnss/baud.py",
            "if self.known is not None and self.baud != self.known:",
            "if False:",
        ),
        "[GPS: noise for 10 s-moving]",
    ),
    Protection(
        *("a sentence cut off, without a checksum", "a checksum is mandatory"),
        *("sensors/gnss/lines.py", "if not start or not star:", "if not start:"),
        "tests/unit/test_nmea_lines.py",
    ),
    Protection(
        *("garbage that looks like a sentence", "the checksum is compared"),
        *(
            "sensors/gnss/lines.py",
            'if digits.upper() not in (b"%02X" % expected, b"%X" % expected):',
            "if False:",
        ),
        "tests/unit/test_nmea_lines.py",
    ),
    Protection(
        *("a line without an end fills the memory", "lines end after 255 bytes"),
        *(
            "sensors/gnss/lines.py",
            "self._tail = whole[-MAX_LINE:]",
            "self._tail = whole",
        ),
        "tests/unit/test_nmea_lines.py",
    ),
    Protection(
        *("RMC with status V is read as a fix", "status A alone counts"),
        *(
            "sensors/gnss/sentences.py",
            "has_fix=has_fix_by_status(status, mode),\n        lat_lon_rad=position(*place),\n        vel",
            "has_fix=True,\n        lat_lon_rad=position(*place),\n        vel",
        ),
        "tests/unit/test_nmea_sentences.py",
    ),
    Protection(
        *("0 N 0 E reaches the log", "such a place is none"),
        *("sensors/gnss/fields.py", "or lat_deg == lon_deg == 0:", "or False:"),
        "[GPS at 0 N 0 E for 10 s-start]",
    ),
    Protection(
        *("dates 1024 weeks back", "weeks are added until they are not"),
        *(
            "sensors/gnss/calendar.py",
            "    return max(0, ceil((earliest_utc_s - LATE_DATE_S - sent_utc_s)",
            "    return 0 and ((earliest_utc_s - LATE_DATE_S - sent_utc_s)",
        ),
        "[date 1024 weeks back-start]",
    ),
    Protection(
        *("an epoch that comes twice counts twice", "those given are remembered"),
        *(
            "sensors/gnss/epoch_reader.py",
            "if epoch.tod_s in self._given:",
            "if False:",
        ),
        "tests/unit/test_nmea.py",
    ),
    Protection(
        *("a wild fix moves the track", "a gate on the innovation"),
        *("estimation/receiver/gate.py", "if nis <= NIS_LIMIT:", "if True:"),
        "[50 km away for 5 s-moving]",
    ),
    Protection(
        *("the gate locks the receiver out", "rejected fixes that agree win"),
        *(
            "estimation/receiver/gate.py",
            "            self._streak.clear()\n            return True\n        return False\n\n    def _agree",
            "            return False\n        return False\n\n    def _agree",
        ),
        "[first fixes 50 km away-start]",
    ),
    Protection(
        *("a receiver that is led astray", "places against its own velocities"),
        *(
            "estimation/receiver/spoofing.py",
            "        drawn_m = self._drawn_by_position(fix)\n",
            "        drawn_m = 0.0\n",
        ),
        "[places drawn away at 1 m/s-moving]",
    ),
    Protection(
        *("a receiver that is led astray, parked", "places against a resting IMU"),
        *(
            "estimation/receiver/spoofing.py",
            "        rested_m = self._drawn_at_rest(fix)\n",
            "        rested_m = 0.0\n",
        ),
        "[places and speed drawn away, parked-still]",
    ),
    Protection(
        *("a receiver sends more than its line carries", "arrival less UTC is watched"),
        *(
            "estimation/receiver/backlog.py",
            "if not self._is_overloaded and self._grows(waited_ns):",
            "if False:",
        ),
        "[10 Hz over 9600 baud, drops epochs-start]",
    ),
    Protection(
        *("late fixes drag the track back", "they count at their own instant"),
        *(
            "estimation/tracker.py",
            "instant_ns = fix.t_ns - self._latency_ns\n",
            "instant_ns = fix.t_ns\n",
        ),
        "tests/unit/test_tracker.py",
    ),
    Protection(
        *(
            "a leap second dates fixes wrong",
            "whole seconds are in doubt, then believed",
        ),
        *("estimation/receiver/utc.py", " < STALE_NS and not is_leap:", " < STALE_NS:"),
        "[a leap second-moving]",
    ),
    Protection(
        *("rows follow a leap second slowly", "r95 grows by what they are dated wrong"),
        *("estimation/tracker.py", "believed.r95_m + way_m,", "believed.r95_m,"),
        "tests/unit/test_tracker.py",
    ),
    Protection(
        *(
            "what a dead chip says is no number",
            "a gap is as warm as the sample before",
        ),
        *(
            "motion/preintegration.py",
            "math.nan if last is None else last.temp_degc",
            "math.nan",
        ),
        "tests/unit/test_memory.py",
    ),
    Protection(
        *("a full queue blocks or is hidden", "refused frames are counted and told"),
        *("sources/live.py", "if len(self._queue) < MAX_WAITING:", "if True:"),
        "[queue overrun-moving]",
    ),
    Protection(
        *("a full disk loses rows", "rows wait in memory"),
        *("storage/append_file.py", "        self._waiting.append(records)\n", ""),
        "[disk full for 10 s-moving]",
    ),
    Protection(
        *("a log that is deleted or moved goes on unseen", "its inode is compared"),
        *(
            "storage/append_file.py",
            "if not self._is_in_place():",
            "if self._fd is None:",
        ),
        "[log file deleted-moving]",
    ),
    Protection(
        *("a power cut costs half a minute", "fsync each sync_s"),
        *(
            "storage/append_file.py",
            "                os.fsync(self._fd)\n                self._is_synced",
            "                self._is_synced",
        ),
        "tests/faults/test_kills.py",
    ),
    Protection(
        *("a torn tail after a power cut", "it is cut off at the start"),
        *(
            "storage/append_file.py",
            "            os.ftruncate(fd, size)\n",
            "            pass\n",
        ),
        "tests/unit/test_appendfile.py",
    ),
    Protection(
        *("a state file that is half written", "sync before the rename"),
        *("storage/atomic.py", "            os.fsync(file.fileno())\n", ""),
        "tests/faults/test_kills.py",
    ),
    Protection(
        *("a system clock that jumps", "only CLOCK_MONOTONIC is read"),
        *("sensors/clock.py", "return time.monotonic_ns()", "return time.time_ns()"),
        "tests/unit/test_clock.py",
    ),
)


def fails_without(protection: Protection) -> str:
    """Take it out, run its test; return what ails the check, or "" when it fell."""
    with tempfile.TemporaryDirectory(prefix="without-") as directory:
        source = Path(directory) / "src"
        shutil.copytree(ROOT / "src", source)
        path = source / "imu_tracker" / protection.file
        text = path.read_text()
        if text.count(protection.text) != 1:
            return f"{text.count(protection.text)} times in {protection.file}"
        path.write_text(text.replace(protection.text, protection.without))
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "pytest",
                "-x",
                "-q",
                "-p",
                "no:cacheprovider",
                protection.node,
            ],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(source)},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode == 1 and "failed" in done.stdout:
        return ""
    return f"its test ends with {done.returncode}: {done.stdout[-300:]}{done.stderr[-300:]}"


def main() -> None:
    """Take out each in turn."""
    held = 0
    for protection in PROTECTIONS:
        problem = fails_without(protection)
        held += not problem
        print(
            f"{'falls' if not problem else 'STANDS'}: {protection.protection} {problem}",
            flush=True,
        )
    print(f"{held} of {len(PROTECTIONS)} protections are held by a test")


if __name__ == "__main__":
    main()
