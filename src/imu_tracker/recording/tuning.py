"""Settings that explain recordings best, and how sure.

What the filter learns by itself (mounting, latency, profile, noise, biases) is taken
from its last estimate. What it does not learn, the lever arm, is found from its
innovations: a recording is tracked once as it is and once with each axis of the lever
arm changed, and the change that makes the innovations smallest is solved for.

Source: the prediction error method, Ljung 1999, System Identification, section 7.2.
"""

import contextlib
from collections.abc import Iterable, Sequence
from itertools import permutations, product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imu_tracker.calibration.counts import parse_mount
from imu_tracker.config import Config
from imu_tracker.errors import ConfigError
from imu_tracker.estimation.error_state.smoothing.entries import (
    Correction,
    Entry,
    Mark,
)
from imu_tracker.estimation.error_state.smoothing.history import History
from imu_tracker.estimation.error_state.states import RECEIVER, VELOCITY_DELAY
from imu_tracker.estimation.error_state.warm_start import LearnedParameters
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.geometry.rotation import matrix
from imu_tracker.pipeline import Pipeline
from imu_tracker.recording.replay import Replay
from imu_tracker.samples import DEFAULT_MOUNT, Frame, Mount, NavState, SessionHeader

Array = NDArray[np.floating[Any]]

COLLECT_S: Final = 300.0
"""So often innovations are taken out of the history, which is then let go."""

STEP_M: Final = 0.5
"""By so much a lever arm is changed to see what that does."""

WILD_NIS: Final = 25.0
"""Innovations beyond say nothing of a lever arm."""

MOST_CHI2: Final = 6.6
"""Of one degree of freedom, 99 %: recordings that differ by more differ in fact."""

CORRELATED: Final = 2.0
"""A safety margin on the sigmas, not a validated factor. Innovations of a minute share
their errors, and the filter adapts to a wrong lever arm, so that values scatter more
than their covariance says; five simulated drives are all that it was looked at with."""

_POSITION, _VELOCITY = "position", "velocity"


class Estimate(NamedTuple):
    """A value and its standard deviation."""

    value: float
    sigma: float


class Innovation(NamedTuple):
    """What a fix differed by from what was foretold."""

    z: Array
    S_inv: Array


class Trial(Replay):
    """A replay that keeps the innovations of the fixes.

    Attributes
    ----------
    innovations : dict
        By session, instant, kind and number within the instant.
    learnt : LearnedParameters or None
        Of the last session.
    header : SessionHeader or None
    settings : TrackerSettings or None
    """

    def __init__(self, config: Config, **changes: object) -> None:
        super().__init__(config)
        self._changes = changes
        self._history = History()
        self._collected_ns: int | None = None
        self.innovations: dict[tuple[int, int, str, int], Innovation] = {}
        self.header: SessionHeader | None = None
        self.settings: TrackerSettings | None = None

    def run(self, stream: Iterable[SessionHeader | Frame]) -> "Trial":
        """Track a recording."""
        for _ in self.rows(stream):
            pass
        return self

    @property
    def learnt(self) -> LearnedParameters | None:
        """What the last session ended with; None: nothing."""
        return None if self._pipeline is None else self._pipeline.learned_parameters()

    @property
    def latency_s(self) -> Estimate:
        """From the instant that a fix describes to its arrival."""
        if self.learnt is None:
            return Estimate(0.0, np.inf)
        return Estimate(self.learnt.latency_s, self.learnt.latency_sigma_s)

    def pipeline(self, header: SessionHeader, settings: TrackerSettings) -> Pipeline:
        """Make the pipeline of a session, with what this trial changes."""
        self._history, self._collected_ns = History(), None
        settings = settings._replace(**self._changes)  # type: ignore[arg-type]
        self.header, self.settings = header, settings
        return super().pipeline(header, settings._replace(history=self._history))

    def finished(self, due: list[NavState]) -> list[NavState]:
        """Collect now and then; rows are of no interest."""
        if not due:
            return due
        now_ns = due[-1].t_ns
        if self._collected_ns is None:
            self._collected_ns = now_ns
        if now_ns - self._collected_ns > COLLECT_S * 1e9:
            self._collected_ns = now_ns
            self._collect(now_ns - 100_000_000_000)  # trials of hypotheses take 60 s
        return due

    def remaining(self) -> list[NavState]:
        """Collect the rest."""
        self._collect(None)
        return []

    def _tell(self, *, is_over: bool = False) -> None:
        """Say nothing: a recording is tracked several times, and replay says it."""

    def _collect(self, until_ns: int | None) -> None:
        """Take the innovations of what is settled, oldest first."""
        entries: list[Entry] = []
        entry = self._history.newest
        while entry is not None:
            entries.append(entry)
            entry = entry.before
        t_ns, count = 0, 0
        for entry in reversed(entries):
            if isinstance(entry, Mark):
                if until_ns is not None and entry.t_ns > until_ns:
                    break
                t_ns, count = entry.t_ns, 0
            elif isinstance(entry, Correction) and (kind := _kind(entry)):
                key = (self._sessions, t_ns, kind, count)
                self.innovations[key] = Innovation(entry.z, entry.S_inv)
                count += kind == _VELOCITY
        if t_ns:
            self._history.let_go(t_ns)


def _kind(entry: Correction) -> str:
    """Return which part of a fix it is; empty: no fix."""
    if entry.H.shape[0] != 2:
        return ""
    if entry.H[0, RECEIVER.start] == 1.0:
        return _POSITION
    return _VELOCITY if entry.H[:, VELOCITY_DELAY].any() else ""


def lever_arm(
    as_it_is: Trial, moved: Sequence[Trial], step_m: float = STEP_M
) -> list[Estimate]:
    """How far the antenna is from where the first trial took it to be, an axis each.

    Notes
    -----
    z(l) = z(0) + J l, J by differences; l = -(J' W J)^-1 J' W z with W = S^-1, and the
    covariance (J' W J)^-1, larger by as much as the innovations are.
    """
    n = len(moved)
    information, told = np.zeros((n, n)), np.zeros(n)
    nis_sum, count = 0.0, 0
    for key, (z, S_inv) in as_it_is.innovations.items():
        others = [trial.innovations.get(key) for trial in moved]
        nis = float(z @ S_inv @ z)
        if nis > WILD_NIS or any(other is None for other in others):
            continue
        J = np.array([(other.z - z) / step_m for other in others if other is not None])
        if np.abs(J).max() > 5.0:
            continue  # another hypothesis led then
        information += J @ S_inv @ J.T
        told += J @ S_inv @ z
        nis_sum, count = nis_sum + nis, count + len(z)
    if count == 0 or np.linalg.cond(information) > 1e9:
        return [Estimate(0.0, np.inf)] * n
    covariance = np.linalg.inv(information) * max(nis_sum / count, 1.0)
    covariance *= CORRELATED**2
    values = -np.linalg.inv(information) @ told
    sigmas = np.sqrt(covariance.diagonal())
    return [
        Estimate(value, sigma)
        for value, sigma in zip(values.tolist(), sigmas.tolist(), strict=True)
    ]


class Seat(NamedTuple):
    """How a box sits: the mount that comes nearest, and what is left."""

    mount: Mount
    off_deg: float


def seat(learnt: LearnedParameters, mount: Mount) -> Seat | None:
    """Return how the chip sits in its vehicle; None: it has no mounting."""
    if learnt.q_vb is None:
        return None
    C_vs = matrix(learnt.q_vb) @ np.array(mount_matrix(mount))
    nearest = max(all_mounts(), key=lambda m: float(np.sum(mount_matrix(m) * C_vs)))
    cosine = 0.5 * (float(np.sum(mount_matrix(nearest) * C_vs)) - 1.0)
    return Seat(nearest, float(np.degrees(np.arccos(min(max(cosine, -1.0), 1.0)))))


def mount_matrix(mount: Mount) -> Array:
    """Return C_bs, shape (3, 3): takes the chip's axes to the body's."""
    C_bs = np.zeros((3, 3))
    for row, (column, sign) in enumerate(parse_mount(mount)):
        C_bs[row, column] = sign
    return C_bs


def all_mounts() -> list[Mount]:
    """Return the 24 right-handed ways to sit along the axes."""
    found: list[Mount] = []
    for axes in permutations("xyz"):
        for signs in product("+-", repeat=3):
            x, y, z = (sign + axis for sign, axis in zip(signs, axes, strict=True))
            with contextlib.suppress(ConfigError):  # a mirror image
                parse_mount((x, y, z))
                found.append((x, y, z))
    return found


def mount_of(trial: Trial) -> Mount:
    """Return the mount that a trial used."""
    assert trial.header is not None
    assert trial.settings is not None
    return trial.settings.mount or trial.header.mount or DEFAULT_MOUNT


def together(estimates: Sequence[Estimate]) -> Estimate | None:
    """Combine what recordings say of one value; None: they contradict each other."""
    told = [each for each in estimates if np.isfinite(each.sigma)]
    if not told:
        return Estimate(0.0, np.inf)
    weights = np.array([each.sigma**-2 for each in told])
    values = np.array([each.value for each in told])
    mean = float(weights @ values / weights.sum())
    chi2 = float(weights @ (values - mean) ** 2)
    if len(told) > 1 and chi2 / (len(told) - 1) > MOST_CHI2:
        return None
    return Estimate(mean, float(weights.sum() ** -0.5))
