"""The factory trim and the self-test response of the fake chip."""

from typing import TypeAlias

Vec3: TypeAlias = tuple[float, float, float]

UNRECORDED_CODE = 10  # an axis without trim works; only nobody wrote it down


class SelfTest:
    """What pushing the proof masses electrically does: PS 6.1, 6.2 and RM 4.1.

    Attributes
    ----------
    trim : dict of str to int
        Factory codes by axis: "xa", "ya", "za", "xg", "yg", "zg"; 0: never trimmed.
    health : dict of str to float
        Response by axis, 1.0 as the factory measured it.
    """

    def __init__(self) -> None:
        self.trim = {"xa": 14, "ya": 15, "za": 16, "xg": 12, "yg": 13, "zg": 14}
        self.health = dict.fromkeys(self.trim, 1.0)

    def registers(self) -> bytes:
        """Return 0x0D to 0x10: gyro codes with the upper accel bits, then the lower."""
        trim = self.trim
        rows = [(trim[f"{axis}a"] >> 2) << 5 | trim[f"{axis}g"] for axis in "xyz"]
        low = (trim["xa"] & 3) << 4 | (trim["ya"] & 3) << 2 | trim["za"] & 3
        return bytes([*rows, low])

    def accel_g(self, accel_config: int) -> Vec3:
        """Return what the axes feel on top that ACCEL_CONFIG has in test."""
        x, y, z = (
            self.health[name] * 0.34 * (0.92 / 0.34) ** ((code - 1) / 30) * in_test
            for name, code, in_test in self._axes("a", accel_config)
        )
        return x, y, z

    def gyro_dps(self, gyro_config: int) -> Vec3:
        """Return what the axes feel on top that GYRO_CONFIG has in test."""
        x, y, z = (
            self.health[name] * 25 * 1.046 ** (code - 1) * in_test
            for name, code, in_test in self._axes("g", gyro_config)
        )
        return x, -y, z

    def _axes(self, kind: str, config: int) -> list[tuple[str, int, int]]:
        """For x, y, z: name, trim code, and whether bits 7, 6, 5 put it in test."""
        return [
            (axis + kind, self.trim[axis + kind] or UNRECORDED_CODE, config >> bit & 1)
            for axis, bit in (("x", 7), ("y", 6), ("z", 5))
        ]
