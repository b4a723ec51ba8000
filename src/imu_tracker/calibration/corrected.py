"""Counts to SI body axes, with what a calibration knows of the chip and its mounting.

`counts.CountsModel` takes every chip for the datasheet's; this model takes it for
itself. Both turn one burst into one `ImuSample`.
"""

from struct import Struct
from typing import NamedTuple, TypeAlias

import numpy as np

from imu_tracker.calibration.counts import (
    COUNTS_PER_DPS,
    COUNTS_PER_G,
    STANDARD_GRAVITY_MPS2,
    TEMP_COUNTS_PER_DEGC,
    TEMP_OFFSET_DEGC,
    parse_mount,
)
from imu_tracker.calibration.readings import Array, Readings
from imu_tracker.errors import CalibrationError, shown
from imu_tracker.samples import ImuSample, Mount, SessionHeader, Vec3

Matrix: TypeAlias = tuple[Vec3, Vec3, Vec3]

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

_BURST = Struct(">7h")
_MAX_COUNT, _MIN_COUNT = 32767, -32768


class Corrections(NamedTuple):
    """What one chip in one box is like; as it stands here, it corrects nothing.

    A reading is `gain @ truth + bias`, in the chip's axes. `rotation` takes the axes
    that `mount` names to the body's: the small rest that the names leave.
    """

    chip: str = ""
    accel_bias_mps2: Vec3 = (0.0, 0.0, 0.0)
    accel_gain: Matrix = IDENTITY
    gyro_bias_radps: Vec3 = (0.0, 0.0, 0.0)  # at `gyro_temp_degc`
    gyro_temp_degc: float = 25.0
    gyro_radps_per_degc: Vec3 = (0.0, 0.0, 0.0)
    gyro_temps_degc: tuple[float, float] = (25.0, 25.0)  # what the slope was seen over
    mount: Mount | None = None
    rotation: Matrix = IDENTITY


class CorrectedModel:
    """Counts of one chip to SI in body axes, corrected.

    Parameters
    ----------
    header : SessionHeader
        Ranges and chip.
    mount : Mount
        Which chip axis points along body x, y and z.
    corrections : Corrections

    Raises
    ------
    CalibrationError
        When they are those of another kind of chip, or of another mounting.

    Notes
    -----
    f_b = C_bs @ inv(G_a) @ (reading - b_a); w_b = C_bs @ R @ (reading - b_w), with R
    the rotation in inv(G_a): what looks like cross-axis sensitivity on the faces of a
    box is, for its greater part, a chip that lies askew in the box. Its gyroscope lies
    as askew. What is left of inv(G_a) is symmetric, and the accelerometer's own.
    """

    def __init__(
        self, header: SessionHeader, mount: Mount, corrections: Corrections
    ) -> None:
        known = corrections
        if known.chip and known.chip != header.chip:
            raise CalibrationError(
                f"made for the chip {shown(known.chip)}, this one is {header.chip}: "
                "calibrate this one"
            )
        if known.mount is not None and tuple(known.mount) != tuple(mount):
            raise CalibrationError(
                f"its mounting was measured with imu.mount = {list(known.mount)}, now "
                f"it is {list(mount)}: run `imu-tracker calibrate mount` again"
            )
        to_body = np.array(known.rotation) @ mount_matrix(mount)
        straight = np.linalg.inv(np.array(known.accel_gain))
        accel = to_body @ straight
        gyro = to_body @ nearest_rotation(straight)
        accel_unit = STANDARD_GRAVITY_MPS2 / COUNTS_PER_G[header.accel_range_g]
        gyro_unit = np.radians(1.0) / COUNTS_PER_DPS[header.gyro_range_dps]
        self._accel = _flat(accel * accel_unit, accel @ known.accel_bias_mps2)
        self._gyro = _flat(gyro * gyro_unit, gyro @ known.gyro_bias_radps)
        sx, sy, sz = (gyro @ known.gyro_radps_per_degc).tolist()
        self._slope = (sx, sy, sz)
        self._temp_degc = known.gyro_temp_degc
        self._coldest_degc, self._warmest_degc = known.gyro_temps_degc

    def decode(self, t_ns: int, raw: bytes) -> ImuSample:
        """Decode one 14-byte burst from register 0x3B on."""
        counts = _BURST.unpack(raw)
        x, y, z, temp, p, q, r = counts
        a, b, c, d, e, f, g, h, i, u, v, w = self._accel
        accel = (
            a * x + b * y + c * z - u,
            d * x + e * y + f * z - v,
            g * x + h * y + i * z - w,
        )
        temp_degc = temp / TEMP_COUNTS_PER_DEGC + TEMP_OFFSET_DEGC
        known_degc = min(max(temp_degc, self._coldest_degc), self._warmest_degc)
        warmth = known_degc - self._temp_degc
        sx, sy, sz = self._slope
        a, b, c, d, e, f, g, h, i, u, v, w = self._gyro
        gyro = (
            a * p + b * q + c * r - u - warmth * sx,
            d * p + e * q + f * r - v - warmth * sy,
            g * p + h * q + i * r - w - warmth * sz,
        )
        is_saturated = _MAX_COUNT in counts or _MIN_COUNT in counts
        return ImuSample(t_ns, accel, gyro, temp_degc, is_saturated)


def mount_matrix(mount: Mount) -> Array:
    """Return the rotation from chip axes to the axes that a mount names."""
    matrix = np.zeros((3, 3))
    for body, (chip, sign) in enumerate(parse_mount(mount)):
        matrix[body, chip] = sign
    return matrix


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotation that a matrix near one holds, by polar decomposition."""
    left, _, right = np.linalg.svd(matrix)
    rotation: Array = left @ right
    return rotation


def _flat(gain: Array, offset: Array) -> tuple[float, ...]:
    """Nine gains and three offsets as plain numbers: a sample costs 2 us with them."""
    return (*gain.ravel().tolist(), *offset.tolist())


def corrected_arrays(readings: Readings, corrections: Corrections) -> Readings:
    """Correct many readings at once, in the chip's own axes."""
    known = corrections
    straight = np.linalg.inv(np.array(known.accel_gain))
    rotation = nearest_rotation(straight)
    warmth = np.clip(readings.temp_degc, *known.gyro_temps_degc) - known.gyro_temp_degc
    bias = known.gyro_bias_radps + np.outer(warmth, known.gyro_radps_per_degc)
    return readings._replace(
        accel_mps2=(readings.accel_mps2 - known.accel_bias_mps2) @ straight.T,
        gyro_radps=(readings.gyro_radps - bias) @ rotation.T,
    )
