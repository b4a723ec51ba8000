"""Axes of the IMU that do not move any more while the others do, or stay clipped.

A chip with a broken axis answers, its registers hold, no two frames are equal. What a
newcomer gets wrong: a constant axis is no sign by itself. A quiet chip with a coarse
range repeats a value for seconds; but then its other axes do so too.
"""

from collections import Counter
from struct import Struct
from typing import Final

from imu_tracker.samples import ImuSample

BLOCK_SAMPLES: Final = 80
BLOCK_NS: Final = 500_000_000
"""An axis is judged by so many samples, and by so much time."""

LIVING_SHARE: Final = 0.1
"""Noise turns round at two samples of three, a vibration of 5 Hz at one of ten, motion
at one of a hundred. Two axes that do so at a tenth of them and a third one that never
moves, 80 times: not by chance."""

CLIPPED_NS: Final = 200_000_000
"""An impact clips for some hundredths of a second, and the estimators can carry that.
What lasts longer says nothing of the motion: at 4 g it would be 8 m/s by now."""

QUIET_NS: Final = 60_000_000_000
"""Vibration clips in bursts: it is told once, then at most once in this time."""

_RAILS: Final = (-32768, 32767)
_NAMES: Final = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")
_AXES: Final = (0, 2, 4, 8, 10, 12)  # bytes of a burst
_COUNTS: Final = Struct(">3h2x3h")


class StuckAxes:
    """Watches the bursts of one session.

    Attributes
    ----------
    counters : Counter
        `stuck_samples`, `clipped_samples`: of no use, because an axis stood, or
        stayed at the end of its range.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._block: list[bytes] = []
        self._begin_ns = 0
        self._stuck: tuple[int, ...] = ()
        self._clipped_ns: int | None = None  # since when
        self._is_clipped = False
        self._bursts = 0  # not told yet
        self._told_ns: int | None = None
        self._notices: list[str] = []

    def look(self, t_ns: int, burst: bytes) -> bool:
        """Take a burst; return whether an axis stands and the burst is of no use."""
        block = self._block
        if not block:
            self._begin_ns = t_ns
        block.append(burst)
        if len(block) >= BLOCK_SAMPLES and t_ns - self._begin_ns >= BLOCK_NS:
            self._judge(block)
            self._block = []
        if self._stuck:
            self.counters["stuck_samples"] += 1
            return True
        return False

    def clips(self, sample: ImuSample) -> bool:
        """Take a decoded burst; return whether clipping has lasted too long."""
        if not sample.is_saturated:
            self._is_clipped, self._clipped_ns = False, None
            self._tell_bursts(sample.t_ns)
            return False
        if self._clipped_ns is None:
            self._clipped_ns = sample.t_ns
        if sample.t_ns - self._clipped_ns < CLIPPED_NS:
            return False
        if not self._is_clipped:
            self._is_clipped = True
            self._bursts += 1
            self._tell_bursts(sample.t_ns)
        self.counters["clipped_samples"] += 1
        return True

    def _tell_bursts(self, t_ns: int) -> None:
        """Tell of clipping at once, and then at most once a minute with a count."""
        if self._told_ns is not None and t_ns - self._told_ns < QUIET_NS:
            return
        if not self._bursts:
            if self._told_ns is not None:
                self._told_ns = None
                self._notices.append("imu: no axis was clipped for a minute")
            return
        times = "" if self._told_ns is None else f" ({self._bursts} times in a minute)"
        self._notices.append(
            f"imu: an axis stays at the end of its range{times}; the IMU is not used "
            "meanwhile: damp the mount, or set imu.accel_range_g higher"
        )
        self._bursts, self._told_ns = 0, t_ns

    @property
    def stuck(self) -> tuple[str, ...]:
        """The axes that stand now."""
        return tuple(_NAMES[axis] for axis in self._stuck)

    def take_notices(self) -> list[str]:
        """Transitions since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def _judge(self, block: list[bytes]) -> None:
        glances = block[:: BLOCK_SAMPLES // 4]
        standing = [
            axis
            for axis, at in enumerate(_AXES)
            if len({burst[at : at + 2] for burst in glances}) == 1
        ]
        stuck = self._confirmed(block, standing) if standing else ()
        if stuck != self._stuck:
            self._stuck = stuck
            self._notices.append(
                f"imu: stuck: {', '.join(self.stuck)}; the IMU is not used: run "
                "imu-tracker selftest; if that fails too, the chip is broken"
                if stuck
                else "imu: all axes move again"
            )

    def _confirmed(self, block: list[bytes], standing: list[int]) -> tuple[int, ...]:
        columns = list(zip(*map(_COUNTS.unpack, block), strict=True))
        stuck = []
        for axis in standing:
            column = columns[axis]
            if column[0] in _RAILS or any(value != column[0] for value in column):
                continue
            sensor = range(3) if axis < 3 else range(3, 6)
            others_live = all(_lives(columns[i]) for i in sensor if i != axis)
            # Once stuck, only moving itself redeems an axis: the others may rest.
            if axis in self._stuck or others_live:
                stuck.append(axis)
        return tuple(stuck)


def _lives(column: tuple[int, ...]) -> bool:
    """Whether a series turns round as often as noise does."""
    triples = zip(column, column[1:], column[2:], strict=False)
    turns = sum((b - a) * (c - b) < 0 for a, b, c in triples)
    return turns >= LIVING_SHARE * len(column)
