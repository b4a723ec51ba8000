"""What the samples of the IMU say of the chip and its mounting, second by second."""

import itertools
import math
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.counts import STANDARD_GRAVITY_MPS2, parse_mount
from imu_tracker.calibration.readings import Array, Window, decode, windows
from imu_tracker.calibration.still import Stretch, still_stretches
from imu_tracker.recording.sensor_report import mount_by_gravity
from imu_tracker.report.measures.series import Series
from imu_tracker.samples import DEFAULT_MOUNT, Mount, SessionHeader

GAP_S: Final = 0.25
"""Without samples for longer the tracker goes on without the IMU (0.4 s), or nearly."""

DRIVING_MPS: Final = 4.0
"""Faster than this, vibration is the road's and not that of a manoeuvre."""


UNMOVED_MPS2: Final = 0.06
"""Where the accelerometer shows less than this, a datasheet's own noise twice, no
engine shakes the gyro: what it shows is its own."""

LEAST_K: Final = 3.0
"""A slope by temperature is told from so much warmth on."""

TURNED_DEG: Final = 10.0
"""Two stops differ by the slopes of the road, 3 deg and seldom 6; not by more."""


class ImuFigures(NamedTuple):
    """What was measured; NaN where there was nothing to measure it on.

    `tilts_deg` are the angles of gravity at each stop from the first one's, and
    `tilt_changes` how often it changed by more than a slope from stop to stop;
    `wrong_mount` the axes that gravity asks for, where the configured ones are wrong.
    """

    chip: str
    nominal_hz: float
    rate_hz: float
    jitter_s: float
    samples: int
    seconds: float
    gaps: int
    longest_gap_s: float
    missing_share: float
    clipped: int
    temps_degc: tuple[float, float]
    vibration_mps2: float  # driving
    rattle_dps: float
    stops: int
    tilts_deg: list[float]
    tilt_changes: int
    lean_deg: float  # of the first stop from level
    wrong_mount: Mount | None
    gravity_g: float
    bias_dps: float
    bias_dps_per_degc: float
    bias_change_dps: float
    noise_dps: float


class ImuLog:
    """Takes bursts as they come.

    Attributes
    ----------
    vibration, temperature, rate : Series
        For charts: m/s^2, deg C, Hz.
    """

    def __init__(self) -> None:
        self.vibration, self.temperature, self.rate = Series(), Series(), Series()
        self._header: SessionHeader | None = None
        self._mount: Mount = DEFAULT_MOUNT
        self._second = -1
        self._times: list[float] = []
        self._bursts: list[bytes] = []
        self._windows: list[Window] = []
        self._rattles_dps: list[float] = []
        self._n = self._clipped = self._gaps = 0
        self._last_s: float | None = None
        self._longest_gap_s = self._active_s = self._missing_s = 0.0
        self._intervals_s: list[float] = []
        self._jitters_s: list[float] = []

    def begin(self, header: SessionHeader, mount: Mount) -> None:
        """Begin a session."""
        self._end_second()
        self._header, self._mount = header, mount
        self._last_s = None

    def add(self, t_s: float, burst: bytes) -> None:
        """Take a burst at seconds since the beginning of the recording."""
        if int(t_s) != self._second:
            self._end_second()
            self._second = int(t_s)
        if self._last_s is not None:
            step_s = t_s - self._last_s
            self._active_s += step_s
            if step_s > GAP_S:
                self._gaps += 1
                self._missing_s += step_s
                self._longest_gap_s = max(self._longest_gap_s, step_s)
        self._last_s = t_s
        self._times.append(t_s)
        self._bursts.append(burst)

    def _end_second(self) -> None:
        times, bursts, header = self._times, self._bursts, self._header
        self._times, self._bursts = [], []
        if header is None or len(times) < 2:
            return
        ranges = header.accel_range_g, header.gyro_range_dps
        readings = decode(times, bursts, *ranges)
        first, self._n = self._n, self._n + readings.n
        self._clipped += int(readings.is_clipped.any(axis=1).sum())
        steps_s = np.diff(readings.t_s)
        self._intervals_s.append(float(np.median(steps_s)))
        self._jitters_s.append(float(steps_s.std()))
        self.rate.add(times[0], readings.n)
        self.temperature.add(times[0], float(readings.temp_degc.mean()))
        self.vibration.add(times[0], float(np.sqrt(readings.accel_mps2.var(0).sum())))
        for window in windows(readings, readings.n):
            here = window._replace(start=first, stop=self._n)
            self._windows.append(here)
            # Differences from sample to sample leave turns out, and keep jolts.
            jolts = np.diff(readings.gyro_radps, axis=0).std() / math.sqrt(2.0)
            self._rattles_dps.append(math.degrees(float(jolts)))

    def figures(self, speeds: list[tuple[float, float]]) -> ImuFigures | None:
        """Measure; `speeds` are (t_s, m/s) by the receiver. None without samples."""
        self._end_second()
        if self._header is None or not self._intervals_s:
            return None
        stops = still_stretches(self._windows, speeds)
        moving = self._driving(speeds)
        means = [_mean(stop, "accel_mps2") for stop in stops]
        wrong_mount, lean_deg = None, math.nan
        if means:
            down_b = self._in_body(means[0])
            lean_deg = _angle_deg(down_b, np.array([0.0, 0.0, -1.0]))
            mount, comment = mount_by_gravity(self._mount, means[0])
            wrong_mount = mount if comment else None
        temps = [window.temp_degc for window in self._windows] or [math.nan]
        interval_s = float(np.median(self._intervals_s))
        bias_dps, per_degc, change_dps = _bias(stops)
        return ImuFigures(
            chip=self._header.chip,
            nominal_hz=self._header.imu_rate_hz,
            rate_hz=1.0 / interval_s if interval_s > 0.0 else math.nan,
            jitter_s=float(np.median(self._jitters_s)),
            samples=self._n,
            seconds=self._active_s,
            gaps=self._gaps,
            longest_gap_s=self._longest_gap_s,
            missing_share=self._missing_s / max(self._active_s, 1.0),
            clipped=self._clipped,
            temps_degc=(min(temps), max(temps)),
            vibration_mps2=_median(
                [float(np.linalg.norm(self._windows[i].accel_std_mps2)) for i in moving]
            ),
            rattle_dps=_median([self._rattles_dps[i] for i in moving]),
            stops=len(stops),
            tilts_deg=[_angle_deg(mean, means[0]) for mean in means],
            tilt_changes=sum(
                _angle_deg(one, other) > TURNED_DEG
                for one, other in itertools.pairwise(means)
            ),
            lean_deg=lean_deg,
            wrong_mount=wrong_mount,
            gravity_g=_median([float(np.linalg.norm(m)) for m in means])
            / STANDARD_GRAVITY_MPS2,
            bias_dps=bias_dps,
            bias_dps_per_degc=per_degc,
            bias_change_dps=change_dps,
            noise_dps=math.degrees(
                _median(
                    [
                        float(window.gyro_std_radps.max())
                        for stop in stops
                        for window in stop.windows
                        if window.accel_std_mps2.max() < UNMOVED_MPS2
                    ]
                )
            ),
        )

    def _driving(self, speeds: list[tuple[float, float]]) -> list[int]:
        """Numbers of the seconds in which the receiver says that it drives."""
        if not speeds:
            return []
        at_s, mps = np.array(speeds).T
        seconds = np.array([window.t_s for window in self._windows])
        return np.flatnonzero(np.interp(seconds, at_s, mps) > DRIVING_MPS).tolist()

    def _in_body(self, chip: Array) -> Array:
        axes = parse_mount(self._mount)
        return np.array([sign * chip[axis] for axis, sign in axes])


def _mean(stop: Stretch, field: str) -> Array:
    mean: Array = np.mean([getattr(window, field) for window in stop.windows], axis=0)
    return mean


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else math.nan


def _angle_deg(one: Array, other: Array) -> float:
    cosine = one @ other / (np.linalg.norm(one) * np.linalg.norm(other))
    return math.degrees(math.acos(min(max(float(cosine), -1.0), 1.0)))


def _bias(stops: list[Stretch]) -> tuple[float, float, float]:
    """Return the gyro's bias, its slope by temperature, and by how much it changed.

    The slope is of the worst axis, NaN below `LEAST_K`; all in deg/s.
    """
    still = [window for stop in stops for window in stop.windows]
    if not still:
        return math.nan, math.nan, math.nan
    dps = np.degrees([window.gyro_radps for window in still])
    degc = np.array([window.temp_degc for window in still])
    change = float(np.abs(dps[-5:].mean(axis=0) - dps[:5].mean(axis=0)).max())
    slope = math.nan
    if float(np.ptp(degc)) >= LEAST_K:
        slope = float(np.abs(np.polyfit(degc, dps, 1)[0]).max())
    return float(np.linalg.norm(np.median(dps, axis=0))), slope, change
