"""A box with an accelerometer, laid on a table by hand: readings by the datasheet.

An oracle of its own: 8192 counts per g at 4 g and 65.5 counts per deg/s at 500 deg/s
(PS-MPU-6000A sections 6.1, 6.2), and a reading is `gain @ force + bias`.
"""

import math
from struct import pack
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from imu_tracker.samples import Frame, SessionHeader, Source

Array: TypeAlias = NDArray[np.float64]
Vec3: TypeAlias = tuple[float, float, float]

G_MPS2 = 9.80665
RATE_HZ = 50

Z_UP, Z_DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
X_UP, X_DOWN = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
Y_UP, Y_DOWN = (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)
SIX = (Z_UP, X_UP, Z_DOWN, Y_UP, X_DOWN, Y_DOWN)


class Box:
    """Records what its chip feels while it is held and turned."""

    def __init__(
        self,
        gain: Array | None = None,
        bias_g: Vec3 = (0.0, 0.0, 0.0),
        *,
        gyro_bias_dps: Vec3 = (0.0, 0.0, 0.0),
        seed: int = 1,
    ) -> None:
        self.gain = np.eye(3) if gain is None else gain
        self.bias_g, self.gyro_bias_dps = np.array(bias_g), np.array(gyro_bias_dps)
        self.rng = np.random.default_rng(seed)
        self.temp_degc = 25.0
        self.frames: list[Frame] = []

    @property
    def stream(self) -> list[SessionHeader | Frame]:
        return [SessionHeader(4, 500, RATE_HZ), *self.frames]

    def lie(self, up: Vec3, seconds: float) -> "Box":
        """Lie still, with the chip's own noise."""
        return self._feel(np.tile(up, (round(seconds * RATE_HZ), 1)), 0.003, 0.05)

    def be_held(self, up: Vec3, seconds: float) -> "Box":
        """Tremble in a hand."""
        return self._feel(np.tile(up, (round(seconds * RATE_HZ), 1)), 0.03, 3.0)

    def be_turned(self, before: Vec3, after: Vec3, seconds: float = 2.0) -> "Box":
        """Go from one face to another in a hand."""
        share = np.linspace(0.0, 1.0, round(seconds * RATE_HZ))[:, None]
        detour = np.roll(before, 1)
        way = (
            (1 - share) * before
            + share * np.array(after)
            + share * (1 - share) * detour
        )
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        return self._feel(way, 0.05, 60.0)

    def be_laid_on(self, *faces: Vec3, seconds: float = 8.0) -> "Box":
        """Lie on one face after another."""
        before: Vec3 | None = None
        for face in faces:
            if before is not None:
                self.be_turned(before, face)
            self.lie(face, seconds)
            before = face
        return self

    def _feel(self, up: Array, noise_g: float, noise_dps: float) -> "Box":
        force = up @ self.gain.T + self.bias_g
        force += noise_g * self.rng.standard_normal(up.shape)
        rate = self.gyro_bias_dps + noise_dps * self.rng.standard_normal(up.shape)
        temp = round((self.temp_degc - 36.53) * 340)
        for a, w in zip(np.rint(force * 8192), np.rint(rate * 65.5), strict=True):
            counts = [*a.astype(int).tolist(), temp, *w.astype(int).tolist()]
            t_ns = 10**9 + len(self.frames) * 10**9 // RATE_HZ
            self.frames.append(Frame(t_ns, Source.IMU, pack(">7h", *counts)))
        return self


def leaning(up: Vec3, deg: float) -> Vec3:
    """Lean away from a face towards the next axis."""
    x, y, z = math.cos(math.radians(deg)) * np.array(up) + math.sin(
        math.radians(deg)
    ) * np.roll(up, 1)
    return float(x), float(y), float(z)
