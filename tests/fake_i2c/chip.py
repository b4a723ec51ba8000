"""The register map of the MPU-6050, obeying the datasheet."""

from collections import deque
from collections.abc import Iterable, Iterator
from random import Random
from struct import pack
from typing import Protocol

from fake_i2c.self_test import SelfTest
from fake_i2c.world import World

# RM section 4: the bits of each register that may be written.
WRITABLE = {
    0x19: 0xFF,  # SMPLRT_DIV
    0x1A: 0x3F,  # CONFIG
    0x1B: 0xF8,  # GYRO_CONFIG
    0x1C: 0xF8,  # ACCEL_CONFIG
    0x23: 0xFF,  # FIFO_EN
    0x37: 0xFE,  # INT_PIN_CFG
    0x38: 0x19,  # INT_ENABLE
    0x68: 0x07,  # SIGNAL_PATH_RESET
    0x6A: 0x67,  # USER_CTRL; bit 4 must stay 0 on the MPU-6050
    0x6B: 0xEF,  # PWR_MGMT_1
    0x6C: 0xFF,  # PWR_MGMT_2
}
TRIMS = range(7)  # reserved; a driver may look, to tell a clock chip apart
READ_ONLY = {*TRIMS, *range(0x0D, 0x11), *range(0x3A, 0x49), 0x72, 0x73, 0x74, 0x75}
SELF_CLEARING = {0x68: 0x07, 0x6A: 0x07}

MPU6500_IDS = {0x70, 0x71, 0x73, 0x74, 0x78}  # also: ACCEL_CONFIG2, awake after reset
ICM20608_IDS = {0x98, 0xAF, 0xAE, 0xA6, 0xA9, 0x11, 0x12}

# RM section 4.3, by DLPF_CFG; the MPU-9250's section 4.5 for the 6500 family.
GYRO_DELAY_MS = (0.98, 1.9, 2.8, 4.8, 8.3, 13.4, 18.6, 0.0)
GYRO_DELAY_MS_6500 = (0.97, 2.9, 3.9, 5.9, 9.9, 17.85, 33.48, 0.17)

RESET_NS = 50_000_000  # RM 4.28 asks to wait twice as long
GYRO_START_NS = 30_000_000  # PS 6.1
GYRO_START_ERROR_DPS = 60.0
RC_OSCILLATOR_ERROR = 0.03  # PS 6.6 allows 5 %
FIFO_BYTE_NS = 500


class DatasheetError(AssertionError):
    """Something was asked of the chip that its datasheet forbids."""


class Clock(Protocol):
    """What the chip needs of a clock."""

    def now_ns(self) -> int: ...


class FakeMpu6050:
    """One chip.

    Parameters
    ----------
    clock
        Anything with `now_ns`; samples come into being when time has passed.
    who_am_i
        What WHO_AM_I says; known relatives behave as their family does.
    fifo_bytes
        1024, or 512 for the 6500 family.
    clock_error
        By how much the chip's clock is fast: 0.015 is 1.5 %.
    noise_counts
        Standard deviation of white noise on every axis, from a fixed seed.
    bursts
        Raw 14-byte frames, one a sample, instead of the physical `world`. The
        last one stays when there are no more.

    Attributes
    ----------
    world : World
        What the chip feels, in its own axes; may be changed at any time.
    self_test : SelfTest
        Factory trim (read at power-on) and response.
    is_wedged : bool
        Deliver the same sample for ever, until a device reset.
    samples : deque of (t_ns, frame)
        The newest samples with the instant at which they were taken.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        who_am_i: int = 0x68,
        fifo_bytes: int | None = None,
        clock_error: float = 0.0,
        noise_counts: float = 3.0,
        bursts: Iterable[bytes] | None = None,
    ) -> None:
        self._clock, self._id, self._clock_error = clock, who_am_i, clock_error
        self._is_6500 = who_am_i in MPU6500_IDS | ICM20608_IDS
        self._fifo_size = fifo_bytes or (512 if self._is_6500 else 1024)
        self._writable = WRITABLE | ({0x1D: 0xCF} if self._is_6500 else {})
        self._noise_counts, self._random = noise_counts, Random(6050)
        self._bursts: Iterator[bytes] | None = iter(bursts) if bursts else None
        self.world = World()
        self.self_test = SelfTest()
        self.is_wedged = False
        self.samples: deque[tuple[int, bytes]] = deque(maxlen=4096)
        self.power_on()

    # What happens to the chip.

    def power_on(self) -> None:
        """Start as after power-on, or after a brown-out: asleep, all defaults."""
        self._registers = bytearray(128)
        self._registers[0x6B] = 0x01 if self._id in MPU6500_IDS else 0x40
        self._registers[0x75] = self._id
        self._registers[0x0D:0x11] = self.self_test.registers()
        self._frame = bytes(14)
        self._fifo: deque[int] = deque()
        self._incoming: deque[tuple[float, int]] = deque()
        self._last_fifo_byte = self._latched_count = self._reset_until_ns = 0
        self._woke_ns = self._clock.now_ns()
        self._restart_sampling()

    brown_out = power_on

    @property
    def is_asleep(self) -> bool:
        return bool(self._registers[0x6B] & 0x40)

    @property
    def period_ns(self) -> float:
        """The true time between samples."""
        config, divider = self._registers[0x1A] & 7, self._registers[0x19]
        is_open = config in (0, 7)
        if is_open and self._is_6500:
            divider = 0  # the divider works with the filter on only
        is_rc = self._registers[0x6B] & 7 == 0 and not self._is_6500
        error = RC_OSCILLATOR_ERROR if is_rc else self._clock_error
        return 1e9 * (divider + 1) / (8000 if is_open else 1000) / (1 + error)

    # The bus side: called by the bus when the chip is addressed.

    def write(self, register: int, value: int) -> None:
        self._advance()
        if self._clock.now_ns() < self._reset_until_ns:
            return  # acknowledged, and lost
        if register not in self._writable:
            raise DatasheetError(f"register 0x{register:02X} cannot be written")
        if value & ~self._writable[register]:
            raise DatasheetError(
                f"0x{value:02X} sets reserved bits of register 0x{register:02X}"
            )
        if register == 0x6B and value & 0x80:
            self._device_reset()
            return
        if register == 0x6A and value & 0x04:
            if self._registers[0x6A] & 0x40:  # RM 4.27
                raise DatasheetError("FIFO_RESET while FIFO_EN is 1")
            self._empty_fifo()
        if register == 0x6A and value & 0x01:
            self._frame = bytes(14)  # SIG_COND_RESET clears the sensor registers
        was_asleep = self.is_asleep
        self._registers[register] = value & ~SELF_CLEARING.get(register, 0)
        if was_asleep and not self.is_asleep:
            self._woke_ns = self._clock.now_ns()
        if register in (0x19, 0x1A, 0x6B):
            self._restart_sampling()

    def read(self, register: int, length: int) -> bytes:
        """Read `length` bytes from `register` on, as of one instant."""
        self._advance()
        data = bytearray()
        for _ in range(length):
            data.append(self._read_byte(register))
            register += register != 0x74  # a burst stays at the FIFO
        if self._registers[0x37] & 0x10:  # INT_RD_CLEAR: any read clears
            self._registers[0x3A] = 0
        return bytes(data)

    def _read_byte(self, register: int) -> int:
        if register not in READ_ONLY and register not in self._writable:
            raise DatasheetError(f"register 0x{register:02X} is not documented")
        if 0x3B <= register <= 0x48:
            return self._frame[register - 0x3B]
        if register == 0x72:
            self._latched_count = len(self._fifo)
            return self._latched_count >> 8
        if register == 0x73:
            return self._latched_count & 0xFF
        if register == 0x74:
            if self._fifo:
                self._last_fifo_byte = self._fifo.popleft()
            return self._last_fifo_byte
        value = self._registers[register]
        if register == 0x3A:
            self._registers[0x3A] = 0
        if register == 0x6B and self._clock.now_ns() < self._reset_until_ns:
            value |= 0x80
        return value

    # Inside the chip.

    def _device_reset(self) -> None:
        self.is_wedged = False
        self.power_on()
        self._reset_until_ns = self._clock.now_ns() + RESET_NS

    def _empty_fifo(self) -> None:
        self._fifo.clear()
        self._incoming.clear()

    def _restart_sampling(self) -> None:
        self._epoch_ns, self._sampled = self._clock.now_ns(), 0

    def _advance(self) -> None:
        """Take the samples that fell due since the last look."""
        now_ns = self._clock.now_ns()
        if self.is_asleep:
            self._restart_sampling()
        due = int((now_ns - self._epoch_ns) // self.period_ns)
        if self._bursts is None:  # nobody misses what neither FIFO nor registers hold
            is_kept = self._registers[0x6A] & 0x40 and self._registers[0x23]
            kept = self._fifo_size if is_kept else 1
            self._sampled = max(self._sampled, due - kept)
        while self._sampled < due:
            self._sampled += 1
            self._sample(self._epoch_ns + self._sampled * self.period_ns)
        while self._incoming and self._incoming[0][0] <= now_ns:
            self._push(self._incoming.popleft()[1])

    def _sample(self, t_ns: float) -> None:
        if not self.is_wedged:
            standby = self._registers[0x6C]
            fresh = self._measure(t_ns)
            words = [fresh[i : i + 2] for i in range(0, 14, 2)]
            for word, bit in enumerate((5, 4, 3, None, 2, 1, 0)):
                if bit is not None and standby >> bit & 1:
                    words[word] = self._frame[2 * word : 2 * word + 2]
            self._frame = b"".join(words)
        self.samples.append((round(t_ns), self._frame))
        if self._registers[0x38] & 0x01:
            self._registers[0x3A] |= 0x01
        if self._registers[0x6A] & 0x40:
            selected = self._selected(self._registers[0x23])
            for index, byte in enumerate(selected, 1):
                self._incoming.append((t_ns + index * FIFO_BYTE_NS, byte))

    def _selected(self, fifo_en: int) -> bytes:
        """Return the parts of a sample that FIFO_EN asks for, in register order."""
        parts = ((3, 0, 6), (7, 6, 8), (6, 8, 10), (5, 10, 12), (4, 12, 14))
        return b"".join(self._frame[a:b] for bit, a, b in parts if fifo_en >> bit & 1)

    def _push(self, byte: int) -> None:
        if len(self._fifo) == self._fifo_size:
            self._fifo.popleft()
            self._registers[0x3A] |= self._registers[0x38] & 0x10
        self._fifo.append(byte)

    def _measure(self, t_ns: float) -> bytes:
        if self._bursts is not None:
            return next(self._bursts, self._frame)
        delays_ms = GYRO_DELAY_MS_6500 if self._is_6500 else GYRO_DELAY_MS
        felt_s = t_ns / 1e9 - delays_ms[self._registers[0x1A] & 7] / 1e3
        accel_g, gyro_dps, temp_degc = self.world.at(felt_s)
        accel_per_g = 16384 >> (self._registers[0x1C] >> 3 & 3)
        gyro_per_dps = (131.0, 65.5, 32.8, 16.4)[self._registers[0x1B] >> 3 & 3]
        test_g = self.self_test.accel_g(self._registers[0x1C])
        test_dps = self.self_test.gyro_dps(self._registers[0x1B])
        start_dps = GYRO_START_ERROR_DPS * (t_ns - self._woke_ns < GYRO_START_NS)
        values = [
            *((a + b) * accel_per_g for a, b in zip(accel_g, test_g, strict=True)),
            self._temperature_counts(temp_degc),
            *(
                (a + b + start_dps) * gyro_per_dps
                for a, b in zip(gyro_dps, test_dps, strict=True)
            ),
        ]
        noisy = (value + self._random.gauss(0, self._noise_counts) for value in values)
        return pack(">7h", *(min(max(round(v), -32768), 32767) for v in noisy))

    def _temperature_counts(self, temp_degc: float) -> float:
        if self._id in MPU6500_IDS:
            return (temp_degc - 21) * 333.87
        if self._id in ICM20608_IDS:
            return (temp_degc - 25) * 326.8
        return (temp_degc - 36.53) * 340  # RM 4.18
