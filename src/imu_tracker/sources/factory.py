"""From the configuration to the sensors: who reads what, and the header of it."""

from collections.abc import Callable

from imu_tracker.config import Config
from imu_tracker.samples import Frame, SessionHeader
from imu_tracker.sensors.clock import Clock
from imu_tracker.sensors.gnss.reader import GpsReader
from imu_tracker.sensors.imu.i2c import OpenI2CBus, open_bus
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.reader import ImuReader
from imu_tracker.sensors.imu.setup import ImuSettings

Put = Callable[[Frame], None]


def imu_settings(config: Config) -> ImuSettings:
    """Say how the chip shall measure."""
    imu = config.imu
    return ImuSettings(
        imu.rate_hz, imu.accel_range_g, imu.gyro_range_dps, float(imu.bandwidth_hz)
    )


def open_imu_bus(config: Config) -> OpenI2CBus:
    """Open the bus of the chip."""
    return open_bus(config.imu.bus)


def imu_driver(config: Config, bus: OpenI2CBus, clock: Clock) -> Mpu6050:
    """Return the driver of the chip on an open bus."""
    return Mpu6050(
        bus, config.imu.address, clock, allow_unknown=config.imu.allow_unknown_chip
    )


def imu_reader(config: Config, put: Put, clock: Clock) -> ImuReader:
    """Return the thread that will read the chip."""
    return ImuReader(
        lambda: open_imu_bus(config),
        put,
        clock,
        address=config.imu.address,
        settings=imu_settings(config),
        read=config.imu.read,
        allow_unknown=config.imu.allow_unknown_chip,
    )


def gps_reader(config: Config, put: Put, clock: Clock) -> GpsReader:
    """Return the thread that will listen to the receiver."""
    return GpsReader(config.gps.port, config.gps.baud, put, clock)


def live_header(config: Config, chip: str = "MPU-6050") -> SessionHeader:
    """Return the header of what the sensors will deliver."""
    return SessionHeader(
        config.imu.accel_range_g,
        config.imu.gyro_range_dps,
        config.imu.rate_hz,
        config.imu.mount,
        None if config.filter.profile == "auto" else config.filter.profile,
        chip=chip,
    )
