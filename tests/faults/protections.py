"""Trap, protection, test: each protection can be taken out, and its test then fails.

    python -m faults.protections      take out one after the other, and say what fell

A test that passes proves nothing before it has been seen to fail.
"""

from typing import Final

from faults.removal import Protection, fails_without
from imu_tracker.estimation.receiver.backlog import Backlog
from imu_tracker.estimation.receiver.gate import Gate
from imu_tracker.estimation.receiver.spoofing import SpoofingMonitor
from imu_tracker.estimation.receiver.utc import UtcClock
from imu_tracker.estimation.tracker import Tracker
from imu_tracker.motion.preintegration import Preintegrator
from imu_tracker.motion.stuck_axes import StuckAxes
from imu_tracker.sensors.clock import MonotonicClock
from imu_tracker.sensors.gnss import fields, sentences
from imu_tracker.sensors.gnss.baud import BaudSearch
from imu_tracker.sensors.gnss.calendar import rollovers_before
from imu_tracker.sensors.gnss.epoch_reader import EpochReader
from imu_tracker.sensors.gnss.lines import LineSplitter, checked_text
from imu_tracker.sensors.gnss.reader import GpsReader
from imu_tracker.sensors.imu import reader
from imu_tracker.sensors.imu.fifo import Fifo
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.reader import ImuReader
from imu_tracker.sensors.imu.sample_clock import SampleClock
from imu_tracker.sensors.imu.sources import FrameWatch
from imu_tracker.sources.live import HardwareFeed
from imu_tracker.storage.append_file import AppendFile
from imu_tracker.storage.atomic import replace_file

PROTECTIONS: Final = (
    Protection(
        trap="one NACK ends the program",
        protection="a failed transfer is tried again",
        where=ImuReader._read,
        line="if has_failed",
        without="if True",
        test="tests/unit/sensors/imu/test_reader.py",
    ),
    Protection(
        trap="OSError 121 ends the program",
        protection="the reader catches it and opens again",
        where=ImuReader.run,
        line="(TrackerError, OSError)",
        without="KeyError",
        test="[NACK for 10 s-moving]",
    ),
    Protection(
        trap="the bus comes back, the driver does not",
        protection="attempts at most 0.5 s apart",
        where=reader,
        line="LAST_RETRY_NS",
        without="60 * 10**9",
        test="[NACK for 10 s-moving]",
    ),
    Protection(
        trap="a dead file descriptor after an unplugged adapter",
        protection="the bus is opened anew",
        where=ImuReader._hold_bus,
        line="closing(self._open_bus())",
        without=(
            "__import__('contextlib').nullcontext(vars(self).get('_one_bus')"
            " or vars(self).setdefault('_one_bus', self._open_bus()))"
        ),
        test="[adapter unplugged for 10 s-moving]",
    ),
    Protection(
        trap="another chip under the same name",
        protection="WHO_AM_I is checked",
        where=Mpu6050.probe,
        line="if who_am_i not in CHIPS and not self._allow_unknown",
        without="if False",
        test="[another WHO_AM_I for 10 s-moving]",
    ),
    Protection(
        trap="a brown-out puts the ranges back",
        protection="registers are read back twice a second",
        where=ImuReader._read,
        line="if not imu.is_configured()",
        without="if False",
        test="[ranges back to default-moving]",
    ),
    Protection(
        trap="a brown-out is noticed late",
        protection="twice a second, not each second",
        where=reader,
        line="SCRUB_NS",
        without="10**9",
        test="[ranges back to default-moving]",
    ),
    Protection(
        trap="a repaired brown-out that nobody hears of",
        protection="the event imu_reset",
        where=ImuReader._deliver,
        line='self._tell("reset", self._reset_reason)',
        without="pass",
        test="[brown-out-moving]",
    ),
    Protection(
        trap="a chip that repeats its last sample",
        protection="frames are compared",
        where=FrameWatch.look,
        line="if max(self._silent_looks, self._same_looks) < self._patience",
        without="if True",
        test="[chip repeats itself-moving]",
    ),
    Protection(
        trap="FIFO overflow, plausible nonsense",
        protection="the overflow bit and the count",
        where=Fifo.drain,
        line="if FIFO_OFLOW_INT.get(status) or count >= self._chip.fifo_bytes",
        without="if False",
        test="[FIFO overflow: host stalls 1.2 s-moving]",
    ),
    Protection(
        trap="a FIFO shifted by a byte",
        protection="whole frames only",
        where=Fifo.drain,
        line=(
            "if count % FRAME_BYTES:\n"
            "    return self._restarted(DrainOutcome.MISALIGNED)"
        ),
        without="pass",
        test="tests/unit/sensors/imu/test_fifo.py",
    ),
    Protection(
        trap="a read of the FIFO that broke off",
        protection="then it is emptied",
        where=Fifo._take,
        line="self._is_in_doubt = True",
        without="self._is_in_doubt = False",
        test="tests/unit/sensors/imu/test_fifo.py",
    ),
    Protection(
        trap="frames that are shifted look plausible",
        protection="the temperature cannot jump",
        where=Fifo.drain,
        line="if not self._is_aligned(frames)",
        without="if False",
        test="tests/unit/sensors/imu/test_fifo.py",
    ),
    Protection(
        trap="register writes that are lost",
        protection="each is read back",
        where=Mpu6050.configure,
        line="self.registers.put(register, value)",
        without="self.registers.write(register, value)",
        test="tests/unit/sensors/imu/test_mpu6050.py",
    ),
    Protection(
        trap="settings that another program left",
        protection="a device reset at the start",
        where=Mpu6050.configure,
        line="self.reset()",
        without="pass",
        test="tests/unit/sensors/imu/test_mpu6050.py",
    ),
    Protection(
        trap="an axis that stands",
        protection="its counts are compared with those of the others",
        where=StuckAxes.look,
        line="if self._stuck",
        without="if False",
        test="[axis stuck for 10 s: gyro z-outage]",
    ),
    Protection(
        trap="an axis at the end of its range",
        protection="after 0.2 s the IMU is not used",
        where=StuckAxes.clips,
        line="if sample.t_ns - self._clipped_ns < CLIPPED_NS",
        without="if True",
        test="[axis clipped for 10 s: accel x-outage]",
    ),
    Protection(
        trap="a chip that is 2 % fast",
        protection="its clock is fitted to the host's",
        where=SampleClock._update,
        line="self._p += gain_p * innovation",
        without="pass",
        test="tests/unit/sensors/imu/test_sample_clock.py",
    ),
    Protection(
        trap="an unplugged receiver ends the process",
        protection="the port is opened again",
        where=GpsReader._visit,
        line="FAULTS",
        without="KeyError",
        test="[GPS unplugged for 10 s-moving]",
    ),
    Protection(
        trap="the wrong baud rate",
        protection="all are tried in turn",
        where=BaudSearch._switch,
        line="self.baud = self._candidate",
        without="pass",
        test="[GPS at another baud-moving]",
    ),
    Protection(
        trap="noise sends the search for the speed away",
        protection="the known one gets every other turn",
        where=BaudSearch._switch,
        line="if self.known is not None and self.baud != self.known",
        without="if False",
        test="[GPS: noise for 10 s-moving]",
    ),
    Protection(
        trap="a sentence cut off, without a checksum",
        protection="a checksum is mandatory",
        where=checked_text,
        line="if not start or not star",
        without="if not start",
        test="tests/unit/sensors/gnss/test_lines.py",
    ),
    Protection(
        trap="garbage that looks like a sentence",
        protection="the checksum is compared",
        where=checked_text,
        line='if digits.upper() not in (b"%02X" % expected, b"%X" % expected)',
        without="if False",
        test="tests/unit/sensors/gnss/test_lines.py",
    ),
    Protection(
        trap="a line without an end fills the memory",
        protection="lines end after 255 bytes",
        where=LineSplitter._extend,
        line="whole[-MAX_LINE:]",
        without="whole",
        test="tests/unit/sensors/gnss/test_lines.py",
    ),
    Protection(
        trap="RMC with status V is read as a fix",
        protection="status A alone counts",
        where=sentences._read_rmc,
        line="has_fix_by_status(status, mode)",
        without="True",
        test="tests/unit/sensors/gnss/test_sentences.py",
    ),
    Protection(
        trap="0 N 0 E reaches the log",
        protection="such a place is none",
        where=fields.position,
        line="lat_deg == lon_deg == 0",
        without="False",
        test="[GPS at 0 N 0 E for 10 s-start]",
    ),
    Protection(
        trap="dates 1024 weeks back",
        protection="weeks are added until they are not",
        where=rollovers_before,
        line="max(0, ceil((earliest_utc_s - LATE_DATE_S - sent_utc_s) / ROLLOVER_S))",
        without="0",
        test="[date 1024 weeks back-start]",
    ),
    Protection(
        trap="an epoch that comes twice counts twice",
        protection="those given are remembered",
        where=EpochReader._close,
        line="if epoch.tod_s in self._given",
        without="if False",
        test="tests/unit/sensors/gnss/test_epoch_reader.py",
    ),
    Protection(
        trap="a wild fix moves the track",
        protection="a gate on the innovation",
        where=Gate.passes,
        line="if nis <= NIS_LIMIT",
        without="if True",
        test="[50 km away for 5 s-moving]",
    ),
    Protection(
        trap="the gate locks the receiver out",
        protection="rejected fixes that agree win",
        where=Gate.reject,
        line="return True",
        without="return False",
        test="[first fixes 50 km away-start]",
    ),
    Protection(
        trap="a receiver that is led astray",
        protection="places against its own velocities",
        where=SpoofingMonitor.add_fix,
        line="self._drawn_by_position(fix)",
        without="0.0",
        test="[places drawn away at 1 m/s-moving]",
    ),
    Protection(
        trap="a receiver that is led astray, parked",
        protection="places against a resting IMU",
        where=SpoofingMonitor.add_fix,
        line="self._drawn_at_rest(fix)",
        without="0.0",
        test="[places and speed drawn away, parked-still]",
    ),
    Protection(
        trap="a receiver sends more than its line carries",
        protection="arrival less UTC is watched",
        where=Backlog._relieve,
        line="if not self._is_overloaded and self._grows(waited_ns)",
        without="if False",
        test="[10 Hz over 9600 baud, drops epochs-start]",
    ),
    Protection(
        trap="late fixes drag the track back",
        protection="they count at their own instant",
        where=UtcClock.instant_of,
        line="min(instant_ns, fix.t_ns)",
        without="fix.t_ns",
        test=(
            "tests/unit/estimation/test_tracker.py::"
            "test_the_latency_does_not_drag_the_track_back"
        ),
    ),
    Protection(
        trap="late fixes without a date drag the track back",
        protection="they count before their arrival, by the latency",
        where=UtcClock.instant_of,
        line="fix.t_ns - self.latency_ns",
        without="fix.t_ns",
        test=(
            "tests/unit/estimation/test_tracker.py::"
            "test_a_fix_without_a_date_counts_before_its_arrival"
        ),
    ),
    Protection(
        trap="a leap second dates fixes wrong",
        protection="whole seconds are in doubt, then believed",
        where=UtcClock.add_epoch,
        line="not is_leap",
        without="True",
        test="[a leap second-moving]",
    ),
    Protection(
        trap="rows follow a leap second slowly",
        protection="r95 grows by what they are dated wrong",
        where=Tracker._row,
        line="estimate.r95_m + way_m",
        without="estimate.r95_m",
        test="tests/unit/estimation/test_tracker.py",
    ),
    Protection(
        trap="what a dead chip says is no number",
        protection="a gap is as warm as the sample before",
        where=Preintegrator._gap,
        line="math.nan if last is None else last.temp_degc",
        without="math.nan",
        test="tests/unit/estimation/error_state/test_warm_start.py",
    ),
    Protection(
        trap="a full queue blocks or is hidden",
        protection="refused frames are counted and told",
        where=HardwareFeed._put,
        line="if len(self._queue) < MAX_WAITING",
        without="if True",
        test="[queue overrun-moving]",
    ),
    Protection(
        trap="a full disk loses rows",
        protection="rows wait in memory",
        where=AppendFile._keep,
        line="self._waiting.append(records)",
        without="pass",
        test="[disk full for 10 s-moving]",
    ),
    Protection(
        trap="a log that is deleted or moved goes on unseen",
        protection="its inode is compared",
        where=AppendFile.sync,
        line="if not self._is_in_place()",
        without="if self._fd is None",
        test="[log file deleted-moving]",
    ),
    Protection(
        trap="a power cut costs half a minute",
        protection="fsync each sync_s",
        where=AppendFile.sync,
        line="os.fsync(self._fd)",
        without="pass",
        test="tests/faults/test_kills.py",
    ),
    Protection(
        trap="a torn tail after a power cut",
        protection="it is cut off at the start",
        where=AppendFile._cut,
        line="os.ftruncate(fd, size)",
        without="pass",
        test="tests/unit/storage/test_append_file.py",
    ),
    Protection(
        trap="a state file that is half written",
        protection="sync before the rename",
        where=replace_file,
        line="os.fsync(file.fileno())",
        without="pass",
        test="tests/faults/test_kills.py",
    ),
    Protection(
        trap="a system clock that jumps",
        protection="only CLOCK_MONOTONIC is read",
        where=MonotonicClock.now_ns,
        line="time.monotonic_ns()",
        without="time.time_ns()",
        test="tests/unit/sensors/test_clock.py",
    ),
)


def main() -> None:
    """Take out each in turn."""
    held = 0
    for protection in PROTECTIONS:
        problem = fails_without(protection)
        held += not problem
        fate = "falls" if not problem else "STANDS"
        print(f"{fate}: {protection.protection} {problem}", flush=True)
    print(f"{held} of {len(PROTECTIONS)} protections are held by a test")


if __name__ == "__main__":
    main()
