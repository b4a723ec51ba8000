"""The vocabulary of the stream: what the wires bring, what it means, what we say.

Plain named tuples, time first: a frame costs 0.2 us to make, and every producer
and consumer of the program agrees on these types alone.
"""

from enum import StrEnum
from typing import Final, NamedTuple, TypeAlias

Vec3: TypeAlias = tuple[float, float, float]
Quat: TypeAlias = tuple[float, float, float, float]
Mount: TypeAlias = tuple[str, str, str]

FIRST_YEAR: Final = 1980  # of GPS
LAST_YEAR: Final = 2999
"""What says to be of another year is no date."""

DEFAULT_MOUNT: Mount = ("+x", "-y", "-z")
"""The chip lies flat, its x forward and its z up."""


class Source(StrEnum):
    """Where a frame comes from; the value is its letter in a recording."""

    IMU = "I"
    GPS = "G"
    EVENT = "E"


class Frame(NamedTuple):
    """Bytes off a wire, and when.

    `data` is, by source: IMU, a 14-byte burst from register 0x3B on; GPS, one line
    of the receiver without CR LF; EVENT, a word and a text.
    """

    t_ns: int
    source: Source
    data: bytes


class SessionHeader(NamedTuple):
    """What must be known to decode a stream of frames; starts each session of it."""

    accel_range_g: int
    gyro_range_dps: int
    imu_rate_hz: float
    mount: Mount | None = None
    profile: str | None = None
    start_utc_s: float | None = None
    chip: str = "MPU-6050"
    name: str = ""


class ImuSample(NamedTuple):
    """One reading of the IMU, calibrated, in body axes (FRD).

    `accel_mps2` is specific force: at rest and level it reads (0, 0, -9.81).
    A saturated sample has at least one axis at the end of its range.
    """

    t_ns: int
    accel_mps2: Vec3
    gyro_radps: Vec3
    temp_degc: float
    is_saturated: bool = False


class GpsFix(NamedTuple):
    """One validated epoch of the receiver, however many sentences it came in.

    A `GpsFix` that exists is valid: "no fix" is the absence of one. It describes
    the instant `utc_s`; `t_ns` is when its first sentence began to arrive.
    """

    t_ns: int
    utc_s: float | None  # None: the receiver sends no date, and none was configured
    lat_rad: float
    lon_rad: float
    alt_m: float | None  # above mean sea level
    vel_ne_mps: tuple[float, float] | None
    sigma_h_m: float  # of the horizontal position, per axis
    quality: int  # GGA: 1 autonomous, 2 differential, 4 RTK fixed, 5 RTK float


class UtcTime(NamedTuple):
    """The receiver knows the time but not the place."""

    t_ns: int
    utc_s: float


Event: TypeAlias = ImuSample | GpsFix | UtcTime


class Mode(StrEnum):
    """How a row of the log came about; the first that holds."""

    GPSONLY = "gpsonly"  # the IMU is unavailable
    STILL = "still"  # standing still by the IMU's word
    GPS = "gps"  # a fix was used just now
    DR = "dr"  # dead reckoning


class NavState(NamedTuple):
    """The estimate at one instant, built at the output rate."""

    t_ns: int
    utc_s: float
    lat_rad: float
    lon_rad: float
    alt_m: float | None  # above mean sea level
    v_n_mps: Vec3
    q_nb: Quat
    r95_m: float  # radius that holds the true horizontal position with 95 %
    mode: Mode
    is_date_sure: bool = True  # enough epochs agree on UTC
