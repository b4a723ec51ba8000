"""The state file: what a run learnt, for the next one to begin with.

One JSON object, replaced as a whole (`storage.atomic`). What a newcomer gets wrong: a
state that is nearly right is worse than none. Whatever is damaged, not finite, not
plausible, of another chip, mounted or calibrated otherwise, is refused as a whole; the
daemon then learns anew.
"""

import hashlib
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from imu_tracker.calibration.corrected import Corrections
from imu_tracker.errors import OutputError, StateError, shown
from imu_tracker.estimation.error_state.warm_start import LearnedParameters
from imu_tracker.samples import Mount
from imu_tracker.storage.state_model import Sensor, State

MOST_BYTES: Final = 65_536
"""A state has some 2 kB."""


def sensor_of(chip: str, mount: Mount, corrections: Corrections | None) -> Sensor:
    """Say whose state it will be; calibrations are told apart by what they hold."""
    mark = ""
    if corrections is not None:
        mark = hashlib.sha256(repr(corrections).encode()).hexdigest()[:16]
    return Sensor(chip, mount, mark)


def read_state(path: Path, sensor: Sensor) -> LearnedParameters | None:
    """Read and check a state file; None when there is none yet.

    Raises
    ------
    StateError
        When it is damaged, or of another sensor: in one line.
    """
    try:
        if path.exists() and not path.is_file():
            raise StateError(f"{path}: not a file")
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise StateError(f"{path}: {error.strerror or error}") from error
    if len(data) > MOST_BYTES:
        raise StateError(f"{path}: not a state of imu-tracker: more than 64 kB")
    try:
        state = State.model_validate_json(data)
    except ValidationError as error:
        problem = error.errors(include_url=False, include_input=False)[0]
        where = shown(".".join(map(str, problem["loc"])))
        said = " ".join(problem["msg"].split()).removeprefix("Value error, ")
        what = f"{where}: {said}" if where else said
        raise StateError(f"{path}: not a state of imu-tracker: {what}") from error
    if reason := sensor.refusal(state):
        raise StateError(f"{path}: {reason}")
    return state.to_learnt()


def write_state(path: Path, learnt: LearnedParameters, sensor: Sensor) -> None:
    """Replace the state file as a whole.

    Raises
    ------
    OutputError
        When the disk refuses; what stood there before still stands.
    StateError
        When what was learnt is not plausible, and must not be begun with.
    """
    from imu_tracker.storage.atomic import make_directories, replace_file

    try:
        state = State.of(learnt, sensor)
    except ValidationError as error:
        problem = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, problem["loc"]))
        raise StateError(f"{path}: not kept: {where} is not plausible") from error
    try:
        make_directories(path.parent)
        replace_file(path, f"{state.model_dump_json(indent=1)}\n".encode())
    except OSError as error:
        raise OutputError(f"{path}: {error.strerror or error}") from error


class StateFile:
    """The state file of a run that may have several sessions.

    Each session begins with what the one before it learnt, the first with the file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._sensor: Sensor | None = None
        self._learnt: LearnedParameters | None = None

    def begin(self, sensor: Sensor) -> LearnedParameters | None:
        """Return what a session begins with; None: nothing is known of its sensor.

        Raises
        ------
        StateError
            When the file cannot be begun with.
        """
        if self._learnt is not None and sensor == self._sensor:
            return self._learnt
        self._sensor, self._learnt = sensor, None
        self._learnt = read_state(self._path, sensor)
        return self._learnt

    def set_learned(self, learnt: LearnedParameters | None, chip: str = "") -> None:
        """Hear what the session has learnt, and of which chip when that is news."""
        if learnt is not None and self._sensor is not None:
            self._learnt = learnt
            self._sensor = self._sensor._replace(chip=chip or self._sensor.chip)

    def write(self) -> bool:
        """Replace the file; return whether there was anything to keep.

        Raises
        ------
        OutputError
        StateError
        """
        if self._learnt is None or self._sensor is None:
            return False
        write_state(self._path, self._learnt, self._sensor)
        return True
