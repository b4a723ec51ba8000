"""What the registers shall hold for what the user asked for.

Pure arithmetic on the tables of the register map (RM-MPU-6000A-00 rev. 4.2). What a
newcomer gets wrong: the divider divides 1 kHz, but 8 kHz when the low-pass filter
is open.
"""

from typing import Final, NamedTuple

from imu_tracker.errors import ConfigError
from imu_tracker.sensors.imu.chips import Chip, LowPass
from imu_tracker.sensors.imu.registers import (
    A_DLPF_CFG,
    AFS_SEL,
    CLKSEL,
    DLPF_CFG,
    FIFO_OFLOW_EN,
    FS_SEL,
    Reg,
)

ACCEL_RANGES_G: Final = (2, 4, 8, 16)  # in the order of AFS_SEL
GYRO_RANGES_DPS: Final = (250, 500, 1000, 2000)  # in the order of FS_SEL

_PLL_WITH_X_GYRO: Final = 1  # section 4.28: highly recommended


class ImuSettings(NamedTuple):
    """How the chip shall measure."""

    rate_hz: float = 100.0
    accel_range_g: int = 4
    gyro_range_dps: int = 500
    bandwidth_hz: float = 42.0


class Setup(NamedTuple):
    """What a chip will do, and the registers that make it, in order of writing."""

    low_pass: LowPass
    rate_hz: float  # by the chip's clock
    registers: dict[Reg, int]


def plan(chip: Chip, settings: ImuSettings) -> Setup:
    """Translate settings into registers.

    The bandwidth and the rate become the nearest ones that the chip can do.

    Raises
    ------
    ConfigError
        When the chip cannot do anything like it.
    """
    low_pass = _low_pass(chip, settings)
    divider = round(low_pass.internal_hz / settings.rate_hz) - 1
    accel_range = _index(ACCEL_RANGES_G, "accel_range_g", settings.accel_range_g)
    gyro_range = _index(GYRO_RANGES_DPS, "gyro_range_dps", settings.gyro_range_dps)
    registers = {
        Reg.PWR_MGMT_1: CLKSEL.put(_PLL_WITH_X_GYRO),  # and awake
        Reg.PWR_MGMT_2: 0,  # no axis on standby
        Reg.SMPLRT_DIV: divider,
        Reg.CONFIG: DLPF_CFG.put(low_pass.dlpf_cfg),
        Reg.GYRO_CONFIG: FS_SEL.put(gyro_range),
        Reg.ACCEL_CONFIG: AFS_SEL.put(accel_range),
        Reg.INT_PIN_CFG: 0,
        Reg.INT_ENABLE: FIFO_OFLOW_EN.put(1),
    }
    if chip.family.value.has_own_accel_filter:
        registers[Reg.ACCEL_CONFIG_2] = A_DLPF_CFG.put(low_pass.dlpf_cfg)
    return Setup(low_pass, low_pass.internal_hz / (divider + 1), registers)


def _low_pass(chip: Chip, settings: ImuSettings) -> LowPass:
    """Choose the nearest bandwidth among the filters that allow the rate."""
    table = chip.family.value.low_pass
    able = [
        row for row in table if 1 <= round(row.internal_hz / settings.rate_hz) <= 256
    ]
    if not able:
        raise ConfigError(f"imu.rate_hz = {settings.rate_hz:g}: must be 4 to 1000")
    return min(able, key=lambda row: abs(row.bandwidth_hz - settings.bandwidth_hz))


def _index(allowed: tuple[int, ...], key: str, value: int) -> int:
    if value not in allowed:
        raise ConfigError(f"imu.{key} = {value}: must be one of {allowed}")
    return allowed.index(value)
