"""The driver on the strict fake: identity, configuration, bursts, faults."""

import errno
from struct import unpack

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from imu_tracker.errors import BusError, ConfigError, DeviceNotFoundError
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.setup import ImuSettings
from support.fake_clock import FakeClock


class Bench:
    """A chip, its bus and a driver on it."""

    def __init__(
        self, address: int = 0x68, *, allow_unknown: bool = False, who_am_i: int = 0x68
    ) -> None:
        self.clock = FakeClock()
        self.chip = FakeMpu6050(self.clock, who_am_i=who_am_i, noise_counts=0)
        self.bus = FakeBus(self.clock, {address: self.chip})
        self.imu = Mpu6050(self.bus, address, self.clock, allow_unknown=allow_unknown)

    def register(self, number: int) -> int:
        return self.chip.read(number, 1)[0]


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize("address", [0x68, 0x69])
def test_it_works_at_both_addresses(address: int) -> None:
    bench = Bench(address)
    bench.imu.configure(ImuSettings())
    assert bench.imu.chip.name == "MPU-6050"
    assert len(bench.imu.read_burst()) == 14


def test_no_other_address_is_accepted() -> None:
    with pytest.raises(ConfigError, match="0x70"):
        Mpu6050(Bench().bus, 0x70, FakeClock())


@pytest.mark.parametrize(
    ("who_am_i", "name"),
    [(0x70, "MPU-6500"), (0x71, "MPU-9250"), (0x98, "ICM-20689"), (0xAF, "ICM-20608")],
)
def test_relatives_are_named_and_configured(who_am_i: int, name: str) -> None:
    bench = Bench(who_am_i=who_am_i)
    bench.imu.configure(ImuSettings())
    assert bench.imu.chip.name == name
    assert bench.register(0x1D) == 3  # their accelerometer has a filter of its own


@pytest.mark.parametrize("who_am_i", [0x70, 0x98])
def test_the_temperature_of_relatives_becomes_the_mpu6050s(who_am_i: int) -> None:
    bench = Bench(who_am_i=who_am_i)
    bench.chip.world.feel(temp_degc=31.5)
    bench.imu.configure(ImuSettings())
    counts = unpack(">7h", bench.imu.read_burst())
    assert counts[3] / 340 + 36.53 == pytest.approx(31.5, abs=0.005)
    assert counts[:3] == (0, 0, 8192)


def test_nobody_at_the_address_is_told_from_a_neighbour() -> None:
    bench = Bench(0x69)
    lost = Mpu6050(bench.bus, 0x68, bench.clock)
    with pytest.raises(DeviceNotFoundError, match="something answers at 0x69"):
        lost.probe()
    bench.bus.chips.clear()
    with pytest.raises(DeviceNotFoundError, match="check wiring") as caught:
        lost.probe()
    assert isinstance(caught.value.__cause__, BusError)


def test_a_hung_bus_is_no_missing_chip(bench: Bench) -> None:
    bench.bus.fail_between(0, 10**18, errno.ETIMEDOUT)
    with pytest.raises(BusError, match="register 0x75"):
        bench.imu.probe()


@pytest.mark.parametrize("who_am_i", [0x00, 0xFF])
def test_a_dead_bus_is_called_one_even_where_unknown_chips_are_welcome(
    who_am_i: int,
) -> None:
    with pytest.raises(DeviceNotFoundError, match="wiring"):
        Bench(who_am_i=who_am_i, allow_unknown=True).imu.probe()


def test_an_unknown_chip_is_refused_with_the_key_that_allows_it() -> None:
    with pytest.raises(DeviceNotFoundError, match=r"0x72 .*allow_unknown_chip"):
        Bench(who_am_i=0x72).imu.probe()


def test_an_allowed_unknown_chip_has_to_feel_gravity() -> None:
    bench = Bench(who_am_i=0x72, allow_unknown=True)
    bench.imu.configure(ImuSettings())
    assert bench.imu.chip.name == "unknown chip 0x72"
    assert bench.register(0x19) == 9  # the scratch patterns are gone
    bench.chip.world.feel(accel_g=(0, 0, 0.1))
    with pytest.raises(DeviceNotFoundError, match=r"0\.10 g, not 1 g"):
        bench.imu.configure(ImuSettings())


def test_every_register_holds_what_was_asked_for(bench: Bench) -> None:
    bench.imu.configure(ImuSettings(200, 16, 1000, 20))
    assert bench.register(0x6B) == 0x01  # awake, PLL with the X gyro
    assert bench.register(0x6C) == 0x00
    assert bench.register(0x19) == 4
    assert bench.register(0x1A) == 4
    assert bench.register(0x1B) == 2 << 3
    assert bench.register(0x1C) == 3 << 3
    assert bench.imu.setup.rate_hz == 200


@pytest.mark.parametrize(
    ("bandwidth_hz", "dlpf"),
    [(260, 0), (256, 0), (188, 1), (184, 1), (94, 2), (44, 3), (42, 3), (5, 6)],
)
def test_the_bandwidth_selects_the_nearest_filter(
    bench: Bench, bandwidth_hz: float, dlpf: int
) -> None:
    bench.imu.configure(ImuSettings(bandwidth_hz=bandwidth_hz))
    assert bench.register(0x1A) == dlpf
    assert bench.chip.period_ns == pytest.approx(10_000_000)


def test_a_6500_is_never_set_to_where_its_divider_is_dead() -> None:
    bench = Bench(who_am_i=0x70)
    bench.imu.configure(ImuSettings(bandwidth_hz=256))
    assert bench.chip.period_ns == pytest.approx(10_000_000)


def test_a_slow_rate_takes_the_widest_filter_that_can_be_divided(bench: Bench) -> None:
    bench.imu.configure(ImuSettings(rate_hz=20, bandwidth_hz=256))
    assert bench.imu.setup.low_pass.bandwidth_hz == 188
    assert bench.chip.period_ns == pytest.approx(50_000_000)


def test_a_rate_between_two_dividers_becomes_the_nearest(bench: Bench) -> None:
    bench.imu.configure(ImuSettings(rate_hz=30))
    assert bench.imu.setup.rate_hz == pytest.approx(1000 / 33)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (ImuSettings(rate_hz=3), "rate_hz"),
        (ImuSettings(rate_hz=20000), "rate_hz"),
        (ImuSettings(accel_range_g=3), "accel_range_g"),
        (ImuSettings(gyro_range_dps=300), "gyro_range_dps"),
    ],
)
def test_what_the_chip_cannot_do_is_a_configuration_error(
    bench: Bench, settings: ImuSettings, key: str
) -> None:
    with pytest.raises(ConfigError, match=rf"imu\.{key} = .*must be"):
        bench.imu.configure(settings)


def test_configuring_removes_what_another_program_left(bench: Bench) -> None:
    bench.imu.configure(ImuSettings())
    bench.chip.write(0x6C, 0x07)  # gyro on standby, as motion detectors leave it
    bench.chip.write(0x6A, 0x40)
    bench.imu.configure(ImuSettings())
    assert bench.register(0x6C) == bench.register(0x6A) == 0


def test_the_first_burst_is_free_of_the_gyros_start_up(bench: Bench) -> None:
    bench.imu.configure(ImuSettings())
    assert unpack(">7h", bench.imu.read_burst())[4:] == (0, 0, 0)


def test_a_write_that_did_not_happen_is_noticed(bench: Bench) -> None:
    settings = ImuSettings(200, 16, 1000, 20)  # nothing but zeros is a default
    before = bench.bus.transfers
    bench.imu.configure(settings)
    transfers = range(bench.bus.transfers - before)
    noticed = []
    for nth in transfers:
        bench.imu.reset()
        bench.bus.lose(after=nth)
        try:
            bench.imu.configure(settings)
        except BusError as error:
            noticed.append(error.register)
        else:
            assert bench.imu.is_configured()
    assert noticed == [0x6B, 0x19, 0x1A, 0x1B, 0x1C, 0x38]


def test_a_read_back_that_differs_says_what_it_found(bench: Bench) -> None:
    bench.bus.flip(0, 7, after=5)
    with pytest.raises(BusError, match="PWR_MGMT_1 is 0x81, not 0x01"):
        bench.imu.configure(ImuSettings())


def test_a_nack_is_reported_once_and_the_next_read_succeeds(bench: Bench) -> None:
    bench.imu.configure(ImuSettings())
    bench.bus.nack()
    with pytest.raises(BusError, match="address 0x68, register 0x3B") as caught:
        bench.imu.read_burst()
    assert isinstance(caught.value.__cause__, OSError)
    assert len(bench.imu.read_burst()) == 14


def test_a_nack_anywhere_in_the_configuration_names_its_register(bench: Bench) -> None:
    bench.imu.configure(ImuSettings())
    for nth in range(1, 15):  # the first one is the probe
        bench.bus.nack(after=nth)
        with pytest.raises(BusError, match=r"address 0x68, register 0x[0-9A-F]{2}"):
            bench.imu.configure(ImuSettings())
    bench.imu.configure(ImuSettings())
    assert bench.imu.is_configured()


def test_a_burst_is_one_instant_and_single_reads_are_not() -> None:
    # Counting frames: all seven words of a sample are equal.
    clock = FakeClock()
    frames = [n.to_bytes(2, "big") * 7 for n in range(2000)]
    chip = FakeMpu6050(clock, bursts=frames)
    bus = FakeBus(clock, {0x68: chip}, hz=100_000)
    imu = Mpu6050(bus, 0x68, clock)
    imu.configure(ImuSettings(rate_hz=1000, bandwidth_hz=188))
    for _ in range(50):
        assert len(set(unpack(">7h", imu.read_burst()))) == 1
    words = [bus.read_i2c_block_data(0x68, 0x3B + 2 * i, 2) for i in range(7)]
    assert len({tuple(word) for word in words}) > 1


def test_a_brown_out_is_seen_by_the_check_of_the_configuration(bench: Bench) -> None:
    bench.imu.configure(ImuSettings())
    assert bench.imu.is_configured()
    bench.chip.brown_out()
    assert len(bench.imu.read_burst()) == 14  # it answers as if nothing had happened
    assert not bench.imu.is_configured()


def test_a_chip_that_never_comes_out_of_reset_is_an_error(bench: Bench) -> None:
    bench.clock.sleep_until_ns = lambda t_ns, stop=None: False  # type: ignore[method-assign]
    with pytest.raises(BusError, match="reset failed"):
        bench.imu.configure(ImuSettings())
