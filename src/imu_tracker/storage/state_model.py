"""What a state file may hold: each value with its plausible range."""

import math
from datetime import UTC, datetime
from typing import Annotated, Any, Final, Literal, NamedTuple, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    field_serializer,
)

from imu_tracker.config.values import MountAxes
from imu_tracker.errors import shown
from imu_tracker.estimation.error_state.warm_start import LearnedParameters, Place
from imu_tracker.samples import Mount
from imu_tracker.wheels.orders import N_STRENGTHS, KeptWheels

FORMAT: Final = "imu-tracker state"
VERSION: Final = 3

_LEAST_SIGMA: Final = 1e-9  # no covariance of a filter may begin at zero
_UNIT: Final = 1e-6


def _tuple(value: object) -> object:
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


def _unit(q: tuple[float, ...]) -> tuple[float, ...]:
    if abs(math.hypot(*q) - 1.0) > _UNIT:
        raise ValueError("not a rotation")
    return q


def _instant(value: object) -> object:
    if not isinstance(value, str):
        return value
    instant = datetime.fromisoformat(value)
    if instant.tzinfo is None:
        raise ValueError("without a time zone")
    return instant.timestamp()


def _within(limit: float) -> Any:
    """Declare a number between two limits."""
    return Field(ge=-limit, le=limit)


def _sigma(most: float) -> Any:
    """Declare a standard deviation."""
    return Field(ge=_LEAST_SIGMA, le=most)


_Component = Annotated[float, _within(1.0 + _UNIT)]
_Quat = Annotated[
    tuple[_Component, _Component, _Component, _Component],
    BeforeValidator(_tuple),
    AfterValidator(_unit),
]
# PS-MPU-6000A 6.1 allows 40 deg/s over all temperatures, 6.2 1.1 m/s^2.
_Bias = Annotated[float, _within(3.0)]
_BiasSigma = Annotated[float, _sigma(3.0)]
_Biases = Annotated[tuple[_Bias, _Bias, _Bias], BeforeValidator(_tuple)]
_BiasSigmas = Annotated[
    tuple[_BiasSigma, _BiasSigma, _BiasSigma], BeforeValidator(_tuple)
]
_Gain = Annotated[float, _within(0.2)]
_GyroGain = Annotated[
    tuple[_Gain, _Gain, _Gain, _Gain, _Gain, _Gain, _Gain, _Gain, _Gain],
    BeforeValidator(_tuple),
]
_Of = Annotated[float, _sigma(0.2)]
_GyroGainSigma = Annotated[
    tuple[_Of, _Of, _Of, _Of, _Of, _Of, _Of, _Of, _Of], BeforeValidator(_tuple)
]
_MountSigma = Annotated[float, Field(ge=0, le=10)]  # zero: there is no mounting
_Vibration = Annotated[float, Field(ge=1e-6, le=1000.0)]
_Level = tuple[bool, _Vibration, _Vibration]
_Strength = Annotated[float, Field(ge=0, le=1e6)]
_Utc = Annotated[float, Field(ge=0, le=1e11)]


class _Part(BaseModel):
    """Strict, nothing that is not known, nothing that is not a number."""

    model_config = ConfigDict(
        frozen=True, strict=True, extra="forbid", allow_inf_nan=False
    )


class PlacePart(_Part):
    """Where the run ended, and how the box lay; `q_nb` takes body axes to NED."""

    lat_rad: float = _within(math.pi / 2)
    lon_rad: float = _within(2 * math.pi)
    sigma_m: float = _sigma(1e8)
    q_nb: _Quat
    yaw_sigma_rad: float = _sigma(10.0)
    is_at_rest: bool


class WheelsPart(_Part):
    """`wheels.orders.KeptWheels`."""

    circumference_m: float = Field(ge=1.0, le=4.0)
    circumference_sigma_m: float = _sigma(1.0)
    strength: Annotated[
        tuple[_Strength, ...],
        Field(min_length=N_STRENGTHS, max_length=N_STRENGTHS),
        BeforeValidator(_tuple),
    ]


class LearntPart(_Part):
    """`warm_start.LearnedParameters`, with what is plausible of each value."""

    profile: Literal["free", "vehicle", "walker"]
    noise_level: int = Field(ge=0, le=9)  # the estimator knows which levels there are
    gyro_bias_radps: _Biases
    gyro_bias_sigma_radps: _BiasSigmas
    accel_bias_mps2: _Biases
    accel_bias_sigma_mps2: _BiasSigmas
    gyro_gain: _GyroGain
    gyro_gain_sigma: _GyroGainSigma
    q_vb: _Quat | None
    mounting_sigma_rad: Annotated[
        tuple[_MountSigma, _MountSigma], BeforeValidator(_tuple)
    ]
    axle_m: float = _within(30.0)
    axle_sigma_m: float = _sigma(30.0)
    latency_s: float = _within(10.0)
    latency_sigma_s: float = _sigma(10.0)
    velocity_latency_s: float = _within(10.0)
    velocity_latency_sigma_s: float = _sigma(10.0)
    temp_degc: float | None = _within(150.0)
    place: PlacePart | None
    still_levels: Annotated[
        tuple[_Level, ...], Field(max_length=2), BeforeValidator(_tuple)
    ]
    wheels: WheelsPart | None = None  # states of before had none


class State(_Part):
    """The whole file: what was learnt, of which sensor, and when."""

    format: Literal["imu-tracker state"] = FORMAT
    version: Literal[3] = VERSION
    saved_utc: Annotated[_Utc | None, BeforeValidator(_instant)]  # null: never told
    chip: Annotated[str, Field(max_length=100)]
    mount: MountAxes
    calibration: Annotated[str, Field(max_length=100)]
    learnt: LearntPart

    @field_serializer("saved_utc")
    def _iso(self, utc_s: float | None) -> str | None:
        if utc_s is None:
            return None
        text = datetime.fromtimestamp(utc_s, UTC).isoformat(timespec="seconds")
        return text.replace("+00:00", "Z")

    @classmethod
    def of(cls, learnt: LearnedParameters, sensor: "Sensor") -> Self:
        """Put together what is to be written.

        Raises
        ------
        ValidationError
            When the estimator has gone astray: what it says is not plausible.
        """
        values = learnt._asdict()
        values["place"] = learnt.place and learnt.place._asdict()
        values["wheels"] = learnt.wheels and learnt.wheels._asdict()
        utc_s = values.pop("utc_s")
        return cls.model_validate(
            {"saved_utc": utc_s, **sensor._asdict(), "learnt": values}
        )

    def to_learnt(self) -> LearnedParameters:
        """Return what an estimator begins with."""
        values = self.learnt.model_dump()
        place, wheels = values.pop("place"), values.pop("wheels")
        return LearnedParameters(
            **values,
            utc_s=self.saved_utc,
            place=Place(**place) if place else None,
            wheels=KeptWheels(**wheels) if wheels else None,
        )


class Sensor(NamedTuple):
    """Whose biases they are, and in which axes; "" is any chip, or no calibration."""

    chip: str
    mount: Mount
    calibration: str

    def refusal(self, state: State) -> str:
        """Say why a state is not of this sensor, or ""."""
        if self.chip and state.chip and self.chip != state.chip:
            return f"of another chip, {shown(state.chip)}; this one is {self.chip}"
        if self.mount != state.mount:
            return f"learnt with imu.mount = {list(state.mount)}"
        if self.calibration != state.calibration:
            return "learnt with another calibration"
        return ""
