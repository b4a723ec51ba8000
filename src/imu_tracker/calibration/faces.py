"""The accelerometer by six faces: lay the box on each, and gravity does the rest.

`FaceGuide` watches second after second, recognises the face, and refuses what would
spoil the fit; `fit_faces` finds bias, scale and cross-axis sensitivity. What a newcomer
gets wrong: the faces are the reference. The axes come out square to them, and a table
that leans shows in the residuals.
"""

import math
from collections.abc import Mapping
from enum import Enum, auto
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.counts import STANDARD_GRAVITY_MPS2
from imu_tracker.calibration.readings import Array, Window
from imu_tracker.calibration.still import is_quiet, is_steady
from imu_tracker.errors import CalibrationError

HOLD_WINDOWS: Final = 6
"""Seconds on each face. The first and the last do not count: a hand lets go in the
one, and may come back in the other."""

HOLD_S: Final = 7
"""What people are told: seconds begin when the chip says so."""

HELD_WINDOWS: Final = 20
"""So many seconds of trembling are no turn: somebody waits with the box in a hand."""

MAX_LEAN_RAD: Final = math.radians(20.0)
GRAVITY_LIMITS_G: Final = (0.70, 1.36)
"""Between gravity and a chip axis on a face, and |f| at rest: clones are sold with
250 mg of bias, on two axes perhaps, and 3 % of scale."""

DATASHEET_BIAS_MG: Final = (50.0, 50.0, 80.0)
DATASHEET_SCALE: Final = 0.03
"""Zero-g output and sensitivity tolerance: PS-MPU-6000A section 6.2."""

MAX_RESIDUAL_MPS2: Final = 0.025 * STANDARD_GRAVITY_MPS2
"""A table that leans by 1.4 deg, or a finger below an edge."""

_PARAMETERS: Final = 4  # of each axis: its bias, and its gain along x, y, z


class Face(NamedTuple):
    """Which chip axis points up."""

    axis: int
    sign: int

    def __str__(self) -> str:
        return f"{'+' if self.sign > 0 else '-'}{'xyz'[self.axis]} up"


FACES: Final = tuple(Face(axis, sign) for axis in (2, 0, 1) for sign in (1, -1))


class Kind(Enum):
    """What a note is about."""

    MEASURED = auto()
    MOVED = auto()
    HELD = auto()
    AGAIN = auto()
    ASKEW = auto()
    NOT_GRAVITY = auto()


class Note(NamedTuple):
    """Something to tell whoever turns the box."""

    t_s: float
    kind: Kind
    text: str


class FacesFit(NamedTuple):
    """What the accelerometer is like: a reading is `gain @ f + bias`, chip axes.

    Attributes
    ----------
    bias_mps2 : ndarray, shape (3,)
    gain : ndarray, shape (3, 3)
        1 + scale error on its diagonal, cross-axis sensitivity beside.
    covariance : ndarray, shape (4, 4)
        Of bias and the three gains, the same for each axis.
    residuals_mps2 : ndarray, shape (6, 3)
        Reading less fit, in the order of `FACES`.
    temp_degc : float
    gravity_mps2 : float
        What was taken for gravity.
    """

    bias_mps2: Array
    gain: Array
    covariance: Array
    residuals_mps2: Array
    temp_degc: float
    gravity_mps2: float


class FaceGuide:
    """Collects the six faces, second after second.

    Attributes
    ----------
    measured : dict of Face to list of Window
    """

    def __init__(self) -> None:
        self.measured: dict[Face, list[Window]] = {}
        self._run: list[Window] = []
        self._trembling = 0  # seconds
        self._lies_on: Face | None = None  # and has not left since it was measured

    @property
    def missing(self) -> list[Face]:
        """The faces that are still to come."""
        return [face for face in FACES if face not in self.measured]

    def feed(self, window: Window) -> Note | None:
        """Take the next second; return what there is to say."""
        if self._lies_on is not None and _face_of(window) != self._lies_on:
            self._lies_on = None
        self._trembling = 0 if is_quiet(window) else self._trembling + 1
        if self._trembling == HELD_WINDOWS:
            text = "does not lie still: put it on a table, not in a hand, and let go"
            return Note(window.t_s, Kind.HELD, text)
        is_same = bool(self._run) and all(
            is_steady(window, known) for known in (self._run[0], self._run[-1])
        )
        if not is_quiet(window) or (self._run and not is_same):
            lasted = len(self._run)
            self._run = [window] if is_quiet(window) else []
            if 1 < lasted < HOLD_WINDOWS and self._lies_on is None:
                text = f"moved after {lasted} s: hold it still for {HOLD_S} s"
                return Note(window.t_s, Kind.MOVED, text)
            return None
        self._run.append(window)
        if len(self._run) != HOLD_WINDOWS or self._lies_on is not None:
            return None
        return self._look(self._run[1:-1])

    def _look(self, windows: list[Window]) -> Note:
        t_s = windows[-1].t_s
        mean = np.mean([window.accel_mps2 for window in windows], axis=0)
        size_g = float(np.linalg.norm(mean)) / STANDARD_GRAVITY_MPS2
        low_g, high_g = GRAVITY_LIMITS_G
        if not low_g <= size_g <= high_g:
            text = f"feels {size_g:.2f} g, not 1 g: something is wrong with the chip"
            return Note(t_s, Kind.NOT_GRAVITY, text)
        face = _face_of_mean(mean)
        if face is None:
            lean_deg = math.degrees(
                math.acos(np.abs(mean).max() / np.linalg.norm(mean))
            )
            text = f"stands askew by {lean_deg:.0f} deg: lay it flat on a face"
            return Note(t_s, Kind.ASKEW, text)
        self._lies_on = face
        if face in self.measured:
            text = f"{face} was measured already: turn it to {self._wanted()}"
            return Note(t_s, Kind.AGAIN, text)
        self.measured[face] = windows
        rest = f"now {self._wanted()}" if self.missing else "all faces are measured"
        return Note(t_s, Kind.MEASURED, f"{face} is measured: {rest}")

    def _wanted(self) -> str:
        return " or ".join(map(str, self.missing)) or "nothing more"


def fit_faces(
    measured: Mapping[Face, list[Window]], gravity_mps2: float = STANDARD_GRAVITY_MPS2
) -> FacesFit:
    """Find bias, scale and cross-axis sensitivity from all six faces.

    Parameters
    ----------
    measured : mapping of Face to list of Window
    gravity_mps2 : float
        Gravity where it was measured.

    Raises
    ------
    CalibrationError
        When a face is missing, or the faces do not fit to one another.

    Notes
    -----
    For each axis of the chip, reading = bias + gain . f, with f = +-g along one axis on
    each face: six equations for four unknowns, by least squares. What the twelve
    unknowns cannot explain tells how far the faces were from square and level.
    """
    if missing := [str(face) for face in FACES if face not in measured]:
        raise CalibrationError(
            f"not measured: {', '.join(missing)}; lay the box on each face once, "
            f"{HOLD_S} s each"
        )
    readings = np.array(
        [np.mean([w.accel_mps2 for w in measured[face]], axis=0) for face in FACES]
    )
    design = np.zeros((len(FACES), _PARAMETERS))
    design[:, 0] = 1.0
    for row, face in enumerate(FACES):
        design[row, 1 + face.axis] = face.sign * gravity_mps2
    solved, *_ = np.linalg.lstsq(design, readings, rcond=None)
    residuals = readings - design @ solved
    worst = int(np.argmax(np.abs(residuals).max(axis=1)))
    most = float(np.abs(residuals[worst]).max())
    if most > MAX_RESIDUAL_MPS2:
        raise CalibrationError(
            f"{FACES[worst]} does not fit to the other faces by "
            f"{1e3 * most / STANDARD_GRAVITY_MPS2:.0f} mg: lay the box flat on a level "
            "table, square sides down, and begin again"
        )
    freedom = 3 * (len(FACES) - _PARAMETERS)
    variance = float(np.sum(residuals**2)) / freedom
    covariance: Array = variance * np.asarray(np.linalg.inv(design.T @ design), float)
    temps = [window.temp_degc for windows in measured.values() for window in windows]
    return FacesFit(
        bias_mps2=solved[0],
        gain=solved[1:].T,
        covariance=covariance,
        residuals_mps2=residuals,
        temp_degc=float(np.mean(temps)),
        gravity_mps2=gravity_mps2,
    )


def grade(fit: FacesFit) -> tuple[str, str, str]:
    """Say of each axis whether bias and scale are within the datasheet."""
    grades = []
    for axis, limit_mg in enumerate(DATASHEET_BIAS_MG):
        bias_mg = 1e3 * abs(float(fit.bias_mps2[axis])) / STANDARD_GRAVITY_MPS2
        scale_error = abs(float(fit.gain[axis][axis]) - 1.0)
        is_good = bias_mg <= limit_mg and scale_error <= DATASHEET_SCALE
        limits = f"{limit_mg:.0f} mg, {100 * DATASHEET_SCALE:.0f} %"
        grades.append("good" if is_good else f"beyond the datasheet's {limits}")
    return grades[0], grades[1], grades[2]


def _face_of(window: Window) -> Face | None:
    return _face_of_mean(window.accel_mps2)


def _face_of_mean(accel_mps2: Array) -> Face | None:
    size = float(np.linalg.norm(accel_mps2))
    axis = int(np.argmax(np.abs(accel_mps2)))
    if abs(accel_mps2[axis]) < math.cos(MAX_LEAN_RAD) * size or size == 0.0:
        return None
    return Face(axis, 1 if accel_mps2[axis] > 0 else -1)
