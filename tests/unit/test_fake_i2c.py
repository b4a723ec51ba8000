"""The fake against the facts of the datasheet: no driver here.

Sections: RM-MPU-6000A-00 rev. 4.2, PS-MPU-6000A-00 rev. 3.4.
"""

import errno
from struct import unpack

import pytest
from smbus2 import i2c_msg

from fake_i2c import DatasheetError, FakeBus, FakeMpu6050
from imu_tracker.errors import DeviceNotFoundError
from imu_tracker.sensors.imu.i2c import OpenI2CBus
from support.fake_clock import FakeClock

AT = 0x68


class Desk:
    """A chip on a bus whose transfers take no time, and what one does to it."""

    def __init__(self, **options: float) -> None:
        self.clock = FakeClock()
        self.chip = FakeMpu6050(self.clock, noise_counts=0, **options)  # type: ignore[arg-type]
        self.bus = FakeBus(self.clock, {AT: self.chip}, hz=10**12)

    def wake(self) -> "Desk":
        self.write(0x6B, 0x01)
        self.clock.advance(ms=100)
        return self

    def write(self, register: int, value: int) -> None:
        self.bus.write_byte_data(AT, register, value)

    def read(self, register: int) -> int:
        return self.bus.read_i2c_block_data(AT, register, 1)[0]

    def burst(self) -> tuple[int, ...]:
        return unpack(">7h", bytes(self.bus.read_i2c_block_data(AT, 0x3B, 14)))

    def count(self) -> int:
        high, low = self.bus.read_i2c_block_data(AT, 0x72, 2)
        return high << 8 | low

    def drain(self, length: int) -> bytes:
        reader = i2c_msg.read(AT, length)
        self.bus.i2c_rdwr(i2c_msg.write(AT, [0x74]), reader)
        return bytes(reader)

    def run_fifo(self) -> None:
        self.write(0x19, 9)  # 100 Hz
        self.write(0x1A, 3)
        self.write(0x38, 0x10)
        self.write(0x23, 0xF8)
        self.write(0x6A, 0x40)


@pytest.fixture
def desk() -> Desk:
    return Desk().wake()


def test_the_fake_bus_and_its_handles_look_like_smbus2() -> None:
    bus = Desk().bus
    buses: list[OpenI2CBus] = [bus, handle := bus.open()]
    assert bus.open_handles == 1
    handle.close()
    assert bus.open_handles == 0
    assert len(buses) == 2


def test_it_powers_on_asleep_and_names_itself() -> None:
    asleep = Desk()
    assert asleep.read(0x6B) == 0x40  # section 3: the one reset value but WHO_AM_I
    assert asleep.read(0x75) == 0x68
    assert all(asleep.read(r) == 0 for r in (0x19, 0x1A, 0x1B, 0x1C, 0x23, 0x37, 0x6A))


def test_ad0_moves_the_address_but_not_the_name() -> None:
    desk = Desk()
    desk.bus.chips = {0x69: desk.chip}
    assert desk.bus.read_i2c_block_data(0x69, 0x75, 1) == [0x68]
    with pytest.raises(OSError, match="Remote I/O") as caught:
        desk.read(0x75)
    assert caught.value.errno == errno.EREMOTEIO


def test_data_registers_are_frozen_while_asleep() -> None:
    asleep = Desk()
    asleep.clock.advance(s=1)
    assert asleep.burst() == (0,) * 7
    asleep.wake()
    before = asleep.burst()
    assert before != (0,) * 7
    asleep.write(0x6B, 0x41)
    asleep.chip.world.feel(accel_g=(1, 0, 0))
    asleep.clock.advance(s=1)
    assert asleep.burst() == before


@pytest.mark.parametrize("register", [0x0D, 0x3A, 0x3B, 0x48, 0x72, 0x74, 0x75])
def test_what_is_read_only_refuses_writes(desk: Desk, register: int) -> None:
    with pytest.raises(DatasheetError, match="cannot be written"):
        desk.write(register, 0)


@pytest.mark.parametrize(
    ("register", "value"), [(0x1A, 0x80), (0x1B, 0x01), (0x6A, 0x10), (0x6B, 0x10)]
)
def test_reserved_bits_are_refused(desk: Desk, register: int, value: int) -> None:
    with pytest.raises(DatasheetError, match="reserved"):
        desk.write(register, value)


def test_registers_of_other_chips_do_not_exist(desk: Desk) -> None:
    with pytest.raises(DatasheetError, match="not documented"):
        desk.read(0x76)
    with pytest.raises(DatasheetError):
        desk.write(0x1D, 3)  # ACCEL_CONFIG2 is the 6500's


def test_a_reset_clears_itself_and_loses_what_comes_too_early(desk: Desk) -> None:
    desk.write(0x19, 9)
    desk.write(0x6B, 0x80)
    assert desk.read(0x6B) & 0x80
    desk.write(0x19, 7)  # acknowledged, and lost
    desk.clock.advance(ms=100)
    assert desk.read(0x6B) == 0x40
    assert desk.read(0x19) == 0


@pytest.mark.parametrize(
    ("dlpf", "divider", "rate_hz"),
    [(0, 7, 1000), (7, 79, 100), (1, 0, 1000), (3, 9, 100), (6, 4, 200)],
)  # section 4.2: 8 kHz when DLPF_CFG is 0 or 7, else 1 kHz
def test_the_sample_rate_is_the_gyro_rate_divided(
    desk: Desk, dlpf: int, divider: int, rate_hz: int
) -> None:
    desk.write(0x1A, dlpf)
    desk.write(0x19, divider)
    assert desk.chip.period_ns == pytest.approx(1e9 / rate_hz)


def test_the_clock_may_be_off_and_is_worse_without_the_pll() -> None:
    desk = Desk(clock_error=0.02).wake()
    assert desk.chip.period_ns == pytest.approx(1e9 / 8000 / 1.02)
    desk.write(0x6B, 0x00)
    assert desk.chip.period_ns == pytest.approx(1e9 / 8000 / 1.03)


@pytest.mark.parametrize(
    ("code", "counts"), list(enumerate((16384, 8192, 4096, 2048)))
)  # PS 6.2
def test_the_range_scales_the_accelerometer(desk: Desk, code: int, counts: int) -> None:
    desk.write(0x1C, code << 3)
    desk.clock.advance(ms=20)
    assert desk.burst()[:3] == (0, 0, counts)


@pytest.mark.parametrize(
    ("code", "counts"), list(enumerate((1310, 655, 328, 164)))
)  # PS 6.1
def test_the_range_scales_the_gyro(desk: Desk, code: int, counts: int) -> None:
    desk.chip.world.feel(gyro_dps=(10, -10, 0))
    desk.write(0x1B, code << 3)
    desk.clock.advance(ms=20)
    assert desk.burst()[4:] == (counts, -counts, 0)


def test_what_exceeds_the_range_saturates(desk: Desk) -> None:
    desk.chip.world.feel(accel_g=(3, -3, 0))
    desk.clock.advance(ms=20)
    assert desk.burst()[:2] == (32767, -32768)


def test_the_temperature_has_340_counts_per_degree(desk: Desk) -> None:
    desk.chip.world.feel(temp_degc=36.53)
    desk.clock.advance(ms=20)
    assert desk.burst()[3] == 0
    desk.chip.world.feel(temp_degc=35.0)
    desk.clock.advance(ms=20)
    assert desk.burst()[3] == -520  # section 4.18; PS 6.3 says -521


def test_the_gyro_needs_30_ms_after_waking() -> None:
    desk = Desk()
    desk.write(0x6B, 0x01)
    desk.clock.advance(ms=20)
    assert max(desk.burst()[4:]) > 1000
    desk.clock.advance(ms=20)
    assert desk.burst()[4:] == (0, 0, 0)


def test_an_axis_on_standby_does_not_move(desk: Desk) -> None:
    desk.write(0x6C, 0b00_100_000)
    desk.chip.world.feel(accel_g=(1, 1, 0))
    desk.clock.advance(ms=20)
    assert desk.burst()[:3] == (0, 16384, 0)


def test_the_fifo_holds_samples_in_register_order(desk: Desk) -> None:
    desk.chip.world.feel(accel_g=(0.25, -0.5, 1), gyro_dps=(10, 20, 30))
    desk.run_fifo()
    desk.clock.advance(ms=25)
    assert desk.count() == 28
    assert unpack(">7h", desk.drain(14)) == desk.burst()
    assert desk.count() == 14


def test_fifo_en_selects_what_the_fifo_holds(desk: Desk) -> None:
    desk.run_fifo()
    desk.write(0x23, 0x78)  # no temperature
    desk.clock.advance(ms=25)
    assert desk.count() == 24


def test_reading_the_high_byte_of_the_count_latches_both(desk: Desk) -> None:
    desk.run_fifo()
    desk.clock.advance(ms=15)
    assert desk.read(0x72) == 0
    desk.clock.advance(ms=10)
    assert desk.read(0x73) == 14  # as of the read of the high byte
    assert desk.count() == 28


def test_an_empty_fifo_repeats_its_last_byte(desk: Desk) -> None:
    desk.run_fifo()
    desk.clock.advance(ms=15)
    assert desk.drain(17)[-4:] == desk.burst()[6].to_bytes(2, "big")[1:] * 4


def test_an_overflow_drops_the_oldest_bytes_and_says_so_once(desk: Desk) -> None:
    desk.run_fifo()
    desk.clock.advance(s=0.735)  # 73 frames are 1022 of 1024 bytes
    assert desk.count() == 1022
    assert desk.read(0x3A) == 0
    desk.clock.advance(ms=10)
    assert desk.count() == 1024
    assert desk.drain(1024)[-14:] == bytes(desk.chip.samples[-1][1])
    assert desk.read(0x3A) == 0x10  # section 4.16: and reading clears it
    assert desk.read(0x3A) == 0


def test_the_fifo_is_reset_only_while_it_is_disabled(desk: Desk) -> None:
    desk.run_fifo()
    desk.clock.advance(ms=25)
    with pytest.raises(DatasheetError, match="FIFO_RESET while FIFO_EN"):
        desk.write(0x6A, 0x44)
    desk.write(0x6A, 0x00)
    desk.write(0x6A, 0x04)
    assert desk.read(0x6A) == 0
    assert desk.count() == 0


def test_the_chip_writes_a_frame_byte_by_byte(desk: Desk) -> None:
    desk.run_fifo()
    desk.clock.advance(ns=10_000_000 + 2_000)
    assert 0 < desk.count() < 14
    desk.clock.advance(ns=10_000)
    assert desk.count() == 14


def test_data_ready_is_flagged_when_enabled_and_any_read_may_clear_it(
    desk: Desk,
) -> None:
    desk.write(0x38, 0x01)
    desk.clock.advance(ms=10)
    assert desk.read(0x3A) == 0x01
    desk.clock.advance(ms=10)
    desk.write(0x37, 0x10)
    desk.read(0x75)
    assert desk.read(0x3A) == 0


def test_a_signal_path_reset_clears_the_data_registers(desk: Desk) -> None:
    desk.write(0x6A, 0x01)
    assert desk.burst() == (0,) * 7
    assert desk.read(0x6A) == 0


def test_the_6500_wakes_awake_with_half_the_fifo_and_its_own_filter() -> None:
    desk = Desk(who_am_i=0x70)
    assert desk.read(0x6B) == 0x01
    desk.write(0x1D, 3)
    desk.write(0x19, 9)  # no effect while the filter is open
    assert desk.chip.period_ns == pytest.approx(1e9 / 8000)
    desk.run_fifo()
    desk.clock.advance(s=1)
    assert desk.count() == 512
    assert desk.burst()[3] == round(4 * 333.87)  # 25 degC; zero is at 21


def test_the_20608_has_its_own_temperature_scale() -> None:
    desk = Desk(who_am_i=0xAF).wake()
    desk.chip.world.feel(temp_degc=26)
    desk.clock.advance(ms=20)
    assert desk.burst()[3] == 327


def test_raw_bursts_come_one_a_sample_and_the_last_one_stays() -> None:
    frames = [bytes([n] * 14) for n in range(3)]
    desk = Desk()
    desk.chip = FakeMpu6050(desk.clock, bursts=frames)
    desk.bus.chips = {AT: desk.chip}
    desk.write(0x6B, 0x01)
    desk.run_fifo()
    desk.clock.advance(ms=45)
    assert desk.drain(56) == b"".join([*frames, frames[-1]])


def test_a_brown_out_puts_it_back_to_sleep_with_defaults(desk: Desk) -> None:
    desk.run_fifo()
    desk.chip.brown_out()
    assert desk.read(0x6B) == 0x40
    assert desk.read(0x19) == 0
    assert desk.count() == 0


def test_a_wedged_chip_repeats_itself_until_it_is_reset(desk: Desk) -> None:
    desk.chip.is_wedged = True
    before = desk.burst()
    desk.chip.world.feel(accel_g=(1, 0, 0))
    desk.clock.advance(s=1)
    assert desk.burst() == before
    desk.write(0x6B, 0x80)
    desk.clock.advance(ms=100)
    desk.wake()
    assert desk.burst() != before


def test_planned_nacks_hit_the_transfers_that_were_meant(desk: Desk) -> None:
    desk.bus.nack(after=1)
    desk.read(0x75)
    with pytest.raises(OSError, match="Remote I/O"):
        desk.read(0x75)
    desk.read(0x75)


def test_a_fifo_read_that_breaks_off_has_taken_some_bytes(desk: Desk) -> None:
    desk.run_fifo()
    desk.clock.advance(ms=25)
    desk.bus.nack(taken=5)
    with pytest.raises(OSError, match="Remote I/O"):
        desk.drain(28)
    assert desk.count() == 23


def test_a_flipped_bit_arrives_wrong_once(desk: Desk) -> None:
    desk.bus.flip(byte=0, bit=3)
    assert desk.read(0x75) == 0x68 ^ 0x08
    assert desk.read(0x75) == 0x68


def test_a_lost_write_is_acknowledged(desk: Desk) -> None:
    desk.bus.lose()
    desk.write(0x19, 9)
    assert desk.read(0x19) == 0


def test_a_hung_bus_takes_its_time_and_fails(desk: Desk) -> None:
    start_ns = desk.clock.now_ns()
    desk.bus.fail_between(start_ns, start_ns + 1, errno.ETIMEDOUT, hang_s=1)
    with pytest.raises(OSError, match="timed out"):
        desk.read(0x75)
    assert desk.clock.now_ns() - start_ns == 10**9
    assert desk.read(0x75) == 0x68


def test_transfers_take_the_time_of_their_bits() -> None:
    desk = Desk()
    bus = FakeBus(desk.clock, {AT: desk.chip}, hz=400_000)
    start_ns = desk.clock.now_ns()
    bus.read_i2c_block_data(AT, 0x3B, 14)
    assert desk.clock.now_ns() - start_ns == pytest.approx(0.39e6, rel=0.05)


def test_an_unplugged_adapter_kills_its_handles_for_ever(desk: Desk) -> None:
    handle = desk.bus.open()
    desk.bus.unplug()
    with pytest.raises(DeviceNotFoundError):
        desk.bus.open()
    desk.bus.plug()
    with pytest.raises(OSError, match="Input/output") as caught:
        handle.read_i2c_block_data(AT, 0x75, 1)
    assert caught.value.errno == errno.EIO
    assert desk.bus.open().read_i2c_block_data(AT, 0x75, 1) == [0x68]


def test_the_self_test_adds_the_factory_response(desk: Desk) -> None:
    desk.chip.self_test.trim |= {"xa": 1, "xg": 1}
    desk.chip.world.feel(accel_g=(0, 0, 0))
    desk.write(0x1B, 0xE0)  # all axes, 250 deg/s
    desk.write(0x1C, 0xF0)  # all axes, 8 g
    desk.clock.advance(ms=20)
    x_accel, x_gyro, y_gyro = (desk.burst()[i] for i in (0, 4, 5))
    assert x_accel == round(4096 * 0.34)  # section 4.1, code 1
    assert x_gyro == 25 * 131
    assert y_gyro < 0
    desk.chip.self_test.health["xa"] = 0.5
    desk.clock.advance(ms=20)
    assert desk.burst()[0] == round(4096 * 0.34 / 2)


def test_the_trim_codes_are_packed_as_in_section_4_1(desk: Desk) -> None:
    desk.chip.self_test.trim = {
        "xa": 0b10101,
        "ya": 0b01010,
        "za": 0b11111,
        "xg": 1,
        "yg": 2,
        "zg": 31,
    }
    desk.chip.power_on()
    codes = desk.bus.read_i2c_block_data(AT, 0x0D, 4)
    assert codes == [0b101_00001, 0b010_00010, 0b111_11111, 0b00_01_10_11]


def test_an_smbus_block_ends_at_32_bytes(desk: Desk) -> None:
    with pytest.raises(ValueError, match="1 to 32"):
        desk.bus.read_i2c_block_data(AT, 0x74, 33)
