"""The calibration file: what `calibrate` learns of one chip, and every reader checks.

One JSON object with up to three parts, each made by its own command and kept when
another is made anew. What a newcomer gets wrong: a file that is nearly right is worse
than none. Whatever is not finite, not plausible or not a rotation is refused as a
whole, and the daemon goes on uncalibrated.
"""

import json
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from imu_tracker.config.values import Exact, MountAxes
from imu_tracker.errors import CalibrationError, InputMissingError, OutputError, shown

if TYPE_CHECKING:
    from imu_tracker.calibration.corrected import Corrections

VERSION: Final = 1

MOST_BYTES: Final = 1_000_000

_MAX_GYRO_BIAS: Final = 1.0  # rad/s: 57 deg/s; PS-MPU-6000A 6.1 allows 40
_MAX_ACCEL_BIAS: Final = 3.0  # m/s^2: 0.3 g; 6.2 allows 0.14
_MAX_GAIN_ERROR: Final = 0.2  # 6.2 allows 0.03
_MAX_LEAN: Final = math.radians(60.0)  # of a mounting from the named axes
_ORTHOGONAL: Final = 1e-6


def _tuple(value: object) -> object:
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


def _variances(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    if any(rows[i][i] < 0 for i in range(len(rows))):
        raise ValueError("a variance is below zero")
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            limit = math.sqrt(rows[i][i] * rows[j][j])
            if not math.isclose(value, rows[j][i], rel_tol=1e-6, abs_tol=1e-18):
                raise ValueError("a covariance is symmetric")
            if abs(value) > limit * (1 + 1e-6) + 1e-18:
                raise ValueError("correlations lie between -1 and 1")
    return rows


def _rotation(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    a, b, c = rows
    products = (
        (a, a, 1.0),
        (b, b, 1.0),
        (c, c, 1.0),
        (a, b, 0.0),
        (b, c, 0.0),
        (a, c, 0.0),
    )
    for u, v, expected in products:
        if abs(sum(x * y for x, y in zip(u, v, strict=True)) - expected) > _ORTHOGONAL:
            raise ValueError("not a rotation")
    volume = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    if volume < 0:
        raise ValueError("a mirror image, not a rotation")
    if (a[0] + b[1] + c[2] - 1.0) / 2.0 < math.cos(_MAX_LEAN):
        raise ValueError("turns by more than 60 deg: that is imu.mount's to say")
    return rows


def _gain(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            if abs(value - (i == j)) > _MAX_GAIN_ERROR:
                raise ValueError("a gain is 1, and 0 beside the diagonal, within 0.2")
    return rows


def _utc(text: str) -> str:
    return _utc_text(datetime.fromisoformat(text).timestamp())


def _utc_text(utc_s: float) -> str:
    text = datetime.fromtimestamp(utc_s, UTC).isoformat(timespec="seconds")
    return text.replace("+00:00", "Z")


_Row = tuple[float, float, float]
_GyroBias = Annotated[float, Field(ge=-_MAX_GYRO_BIAS, le=_MAX_GYRO_BIAS)]
_AccelBias = Annotated[float, Field(ge=-_MAX_ACCEL_BIAS, le=_MAX_ACCEL_BIAS)]
_Temp = Annotated[float, Field(ge=-60.0, le=150.0)]
_Utc = Annotated[str, AfterValidator(_utc)]
_Matrix = Annotated[tuple[_Row, _Row, _Row], BeforeValidator(_tuple)]
_Row4 = tuple[float, float, float, float]
_Matrix4 = Annotated[tuple[_Row4, _Row4, _Row4, _Row4], BeforeValidator(_tuple)]


class _Part(BaseModel):
    """What all parts share: strict, and nothing that is not known."""

    model_config = ConfigDict(
        frozen=True, strict=True, extra="forbid", allow_inf_nan=False
    )


class GyroPart(_Part):
    """The gyroscope's bias, chip axes.

    `radps_per_degc` is null when no slope was found; `temps_degc` is what it was
    looked for over, and beyond it is not used.
    """

    bias_radps: Annotated[
        tuple[_GyroBias, _GyroBias, _GyroBias], BeforeValidator(_tuple)
    ]
    covariance: Annotated[_Matrix, AfterValidator(_variances)]
    temp_degc: _Temp
    temps_degc: Annotated[tuple[_Temp, _Temp], BeforeValidator(_tuple)]
    radps_per_degc: Annotated[
        tuple[_GyroBias, _GyroBias, _GyroBias] | None, BeforeValidator(_tuple)
    ] = None
    still_s: Annotated[float, Field(gt=0)]
    utc: _Utc | None = None

    @model_validator(mode="after")
    def _lies_between(self) -> Self:
        low, high = self.temps_degc
        if not low <= self.temp_degc <= high:
            raise ValueError("temp_degc: must lie between temps_degc")
        return self


class AccelPart(_Part):
    """The accelerometer by six faces, chip axes: a reading is `gain @ f + bias`.

    `covariance` is that of the bias and the three gains, the same for each axis;
    `residuals_mps2` are those of +z, -z, +x, -x, +y, -y up.
    """

    bias_mps2: Annotated[
        tuple[_AccelBias, _AccelBias, _AccelBias], BeforeValidator(_tuple)
    ]
    gain: Annotated[_Matrix, AfterValidator(_gain)]
    covariance: Annotated[_Matrix4, AfterValidator(_variances)]
    residuals_mps2: Annotated[
        tuple[_Row, _Row, _Row, _Row, _Row, _Row], BeforeValidator(_tuple)
    ]
    gravity_mps2: Annotated[float, Field(ge=9.7, le=9.9)]
    temp_degc: _Temp
    utc: _Utc | None = None


class MountPart(_Part):
    """The rotation from the axes that `imu.mount` named to the body's.

    `yaw_sigma_deg` is null when yaw was not measured.
    """

    mount: MountAxes
    rotation: Annotated[_Matrix, AfterValidator(_rotation)]
    yaw_sigma_deg: Annotated[float, Field(ge=0, le=180)] | None = None
    temp_degc: _Temp
    utc: _Utc | None = None


class Calibration(_Part):
    """The whole file."""

    version: Annotated[Literal[1], Exact] = VERSION
    chip: Annotated[str, Field(min_length=1, max_length=100)]
    gyro: GyroPart | None = None
    accel: AccelPart | None = None
    mount: MountPart | None = None

    def corrections(self) -> "Corrections":
        """Return what a decoder needs of it."""
        from imu_tracker.calibration.corrected import Corrections

        known = Corrections(chip=self.chip)
        if self.accel is not None:
            known = known._replace(
                accel_bias_mps2=self.accel.bias_mps2, accel_gain=self.accel.gain
            )
        if self.gyro is not None:
            known = known._replace(
                gyro_bias_radps=self.gyro.bias_radps,
                gyro_temp_degc=self.gyro.temp_degc,
                gyro_radps_per_degc=self.gyro.radps_per_degc or (0.0, 0.0, 0.0),
                gyro_temps_degc=self.gyro.temps_degc,
            )
        if self.mount is not None:
            known = known._replace(mount=self.mount.mount, rotation=self.mount.rotation)
        return known


def utc_text(utc_s: float | None) -> str | None:
    """Return an instant as the file writes it; None stays None."""
    return None if utc_s is None else _utc_text(utc_s)


def read_calibration(path: Path) -> Calibration:
    """Read and check a calibration file.

    Raises
    ------
    CalibrationError
        When it is damaged, with what and where.
    InputMissingError
        When there is none, or it cannot be read.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputMissingError(f"{path}: {error.strerror or error}") from error
    try:
        if len(data) > MOST_BYTES:
            raise ValueError("more than a megabyte")
        value = json.loads(data)
        return Calibration.model_validate(value)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = shown(".".join(map(str, problem["loc"]))) or "as a whole"
        said = problem["msg"].removeprefix("Value error, ")
        more = len(error.errors()) - 1
        rest = f", and {more} more" if more else ""
        raise CalibrationError(f"{path}: {where}: {said}{rest}; {_ADVICE}") from error
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise CalibrationError(f"{path}: not JSON: {reason}; {_ADVICE}") from error


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Replace a calibration file as a whole.

    Raises
    ------
    OutputError
        When the disk refuses; what stood there before still stands.
    """
    from imu_tracker.storage.atomic import make_directories, replace_file

    text = json.dumps(calibration.model_dump(), indent=1, allow_nan=False)
    try:
        make_directories(path.parent)
        replace_file(path, f"{text}\n".encode())
    except OSError as error:
        raise OutputError(f"{path}: {error.strerror or error}") from error


_ADVICE: Final = "calibrate again, or remove it"
