"""What the fake chip feels."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

Vec3: TypeAlias = tuple[float, float, float]


class Feeling(NamedTuple):
    """Specific force, rate of turn and temperature, in the axes of the chip."""

    accel_g: Vec3 = (0.0, 0.0, 1.0)
    gyro_dps: Vec3 = (0.0, 0.0, 0.0)
    temp_degc: float = 25.0


class World:
    """Lies flat at room temperature until `feel` says otherwise."""

    def __init__(self) -> None:
        self._feeling: Callable[[float], Feeling] = lambda _: Feeling()

    def feel(
        self,
        accel_g: Vec3 = (0.0, 0.0, 1.0),
        gyro_dps: Vec3 = (0.0, 0.0, 0.0),
        temp_degc: float = 25.0,
    ) -> None:
        """Feel the same from now on."""
        feeling = Feeling(accel_g, gyro_dps, temp_degc)
        self._feeling = lambda _: feeling

    def follow(self, feeling: Callable[[float], Feeling]) -> None:
        """Feel what `feeling` returns for the seconds of the clock."""
        self._feeling = feeling

    def at(self, t_s: float) -> Feeling:
        return self._feeling(t_s)
