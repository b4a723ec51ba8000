"""Counts of the MPU-6050 to SI in body axes, and back.

The only place where the chip's own axes exist: range and mounting fold into one
gain per axis, so that a sample costs a few multiplications.
"""

import math
from struct import Struct

from imu_tracker.errors import ConfigError
from imu_tracker.samples import DEFAULT_MOUNT, ImuSample, Mount, Vec3

STANDARD_GRAVITY_MPS2 = 9.80665
"""One g, the unit of the datasheet."""

COUNTS_PER_G = {2: 16384.0, 4: 8192.0, 8: 4096.0, 16: 2048.0}
"""Accelerometer sensitivity by range in g (PS-MPU-6000A section 6.2)."""

COUNTS_PER_DPS = {250: 131.0, 500: 65.5, 1000: 32.8, 2000: 16.4}
"""Gyro sensitivity by range in deg/s (PS-MPU-6000A section 6.1)."""

TEMP_COUNTS_PER_DEGC = 340.0  # register map, section 4.18
TEMP_OFFSET_DEGC = 36.53
_MAX_COUNT, _MIN_COUNT = 32767, -32768

_BURST = Struct(">7h")  # ax ay az temp gx gy gz, registers 0x3B to 0x48

_AXES = {"x": 0, "y": 1, "z": 2}


def parse_mount(mount: Mount) -> tuple[tuple[int, float], ...]:
    """For each body axis, which chip axis points along it and with which sign.

    Parameters
    ----------
    mount : Mount
        Chip axes along body x, y, z, such as `("+x", "-y", "-z")`.

    Returns
    -------
    tuple of (chip axis 0..2, sign), one for body x, y, z

    Raises
    ------
    ConfigError
        When the axes are not a right-handed rotation of the chip's.
    """
    axes = []
    for text in mount:
        if len(text) != 2 or text[0] not in "+-" or text[1] not in _AXES:
            raise ConfigError(f"mount axis {text!r}: must be one of +x -x +y -y +z -z")
        axes.append((_AXES[text[1]], 1.0 if text[0] == "+" else -1.0))
    order = [axis for axis, _ in axes]
    if sorted(order) != [0, 1, 2]:
        raise ConfigError(f"mount {list(mount)!r}: must name each chip axis once")
    is_even = order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])
    if math.prod(sign for _, sign in axes) * (1.0 if is_even else -1.0) < 0:
        raise ConfigError(
            f"mount {list(mount)!r}: is a mirror image; turn the sign of one axis"
        )
    return tuple(axes)


class CountsModel:
    """Counts <-> SI body axes of one chip, at its ranges and as it is mounted.

    Parameters
    ----------
    accel_range_g : int
        2, 4, 8 or 16.
    gyro_range_dps : int
        250, 500, 1000 or 2000.
    mount : Mount
        Which chip axis points along body x, y and z.
    """

    def __init__(
        self, accel_range_g: int, gyro_range_dps: int, mount: Mount = DEFAULT_MOUNT
    ) -> None:
        if accel_range_g not in COUNTS_PER_G:
            raise ConfigError(f"accel range {accel_range_g} g: must be 2, 4, 8 or 16")
        if gyro_range_dps not in COUNTS_PER_DPS:
            raise ConfigError(
                f"gyro range {gyro_range_dps} deg/s: must be 250, 500, 1000 or 2000"
            )
        accel = STANDARD_GRAVITY_MPS2 / COUNTS_PER_G[accel_range_g]
        gyro = math.radians(1.0) / COUNTS_PER_DPS[gyro_range_dps]
        (self._ix, sx), (self._iy, sy), (self._iz, sz) = parse_mount(mount)
        self._accel_gain = (sx * accel, sy * accel, sz * accel)
        self._gyro_gain = (sx * gyro, sy * gyro, sz * gyro)

    def decode(self, t_ns: int, raw: bytes) -> ImuSample:
        """Decode one 14-byte burst from register 0x3B on."""
        counts = _BURST.unpack(raw)
        ix, iy, iz = self._ix, self._iy, self._iz
        ax, ay, az = self._accel_gain
        gx, gy, gz = self._gyro_gain
        # The temperature field never comes near the ends: one test serves all seven.
        is_saturated = _MAX_COUNT in counts or _MIN_COUNT in counts
        return ImuSample(
            t_ns,
            (counts[ix] * ax, counts[iy] * ay, counts[iz] * az),
            (counts[4 + ix] * gx, counts[4 + iy] * gy, counts[4 + iz] * gz),
            counts[3] / TEMP_COUNTS_PER_DEGC + TEMP_OFFSET_DEGC,
            is_saturated,
        )

    def encode(self, accel_mps2: Vec3, gyro_radps: Vec3, temp_degc: float) -> bytes:
        """Encode body-axes SI values as the chip would: rounded, clipped to 16 bit."""
        values = [0.0] * 7
        values[3] = (temp_degc - TEMP_OFFSET_DEGC) * TEMP_COUNTS_PER_DEGC
        for body, chip in enumerate((self._ix, self._iy, self._iz)):
            values[chip] = accel_mps2[body] / self._accel_gain[body]
            values[4 + chip] = gyro_radps[body] / self._gyro_gain[body]
        clipped = (min(max(round(v), _MIN_COUNT), _MAX_COUNT) for v in values)
        return _BURST.pack(*clipped)
