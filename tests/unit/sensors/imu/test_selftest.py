"""The factory-trim self-test, against a fake with its own formulas."""

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from imu_tracker.errors import BusError
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.selftest import AXES, Verdict, factory_response, self_test
from support.fake_clock import FakeClock


class Bench:
    def __init__(self, who_am_i: int = 0x68) -> None:
        self.clock = FakeClock()
        self.chip = FakeMpu6050(self.clock, who_am_i=who_am_i)
        self.chip.world.feel(accel_g=(0.1, -0.2, 0.97), gyro_dps=(3, -2, 8))
        self.bus = FakeBus(self.clock, {0x68: self.chip})

    def verdicts(self) -> dict[str, Verdict]:
        imu = Mpu6050(self.bus, 0x68, self.clock)
        return {r.axis: r.verdict for r in self_test(imu, self.clock)}


def test_a_healthy_chip_passes_on_every_axis() -> None:
    assert Bench().verdicts() == dict.fromkeys(AXES, Verdict.PASSED)


@pytest.mark.parametrize("name", ["xa", "ya", "za", "xg", "yg", "zg"])
@pytest.mark.parametrize("health", [0.0, 0.84, 1.16, -1.0])
def test_an_axis_beyond_14_percent_fails_alone(name: str, health: float) -> None:
    bench = Bench()
    bench.chip.self_test.health[name] = health
    axis = f"{'accel' if name[1] == 'a' else 'gyro'} {name[0]}"
    failed = {a for a, verdict in bench.verdicts().items() if verdict is Verdict.FAILED}
    assert failed == {axis}


@pytest.mark.parametrize("health", [0.88, 1.12])
def test_within_14_percent_is_good(health: float) -> None:
    bench = Bench()
    bench.chip.self_test.health |= dict.fromkeys(bench.chip.self_test.health, health)
    assert set(bench.verdicts().values()) == {Verdict.PASSED}


def test_an_axis_without_trim_is_not_graded() -> None:
    bench = Bench()
    bench.chip.self_test.trim |= {"ya": 0, "zg": 0}
    bench.chip.power_on()
    verdicts = bench.verdicts()
    assert verdicts["accel y"] is verdicts["gyro z"] is Verdict.NOT_GRADED
    assert list(verdicts.values()).count(Verdict.PASSED) == 4


@pytest.mark.parametrize("who_am_i", [0x70, 0x98])
def test_other_families_have_another_self_test(who_am_i: int) -> None:
    assert set(Bench(who_am_i).verdicts().values()) == {Verdict.NOT_APPLICABLE}


def test_the_result_says_by_how_much_an_axis_is_off() -> None:
    bench = Bench()
    bench.chip.self_test.health["xa"] = 1.1
    bench.chip.self_test.trim["xg"] = 0
    bench.chip.power_on()
    imu = Mpu6050(bench.bus, 0x68, bench.clock)
    results = {result.axis: result for result in self_test(imu, bench.clock)}
    assert results["accel x"].change == pytest.approx(0.1, abs=0.01)
    assert results["gyro x"].change is None


def test_the_chip_is_left_in_reset() -> None:
    bench = Bench()
    bench.verdicts()
    assert bench.chip.is_asleep


def test_the_formulas_are_those_of_section_4_1() -> None:
    # Codes 1 and 31: accel from 0.34 to 0.92 g, gyro 25 deg/s growing by 4.6 %.
    lowest = factory_response(bytes([0b000_00001] * 3 + [0b010101]))
    assert lowest == pytest.approx([1392.64] * 3 + [3275, -3275, 3275])
    highest = factory_response(bytes([0b111_11111] * 3 + [0b111111]))
    assert highest[:3] == pytest.approx([4096 * 0.92] * 3)
    assert highest[3:] == pytest.approx([s * 3275 * 1.046**30 for s in (1, -1, 1)])
    assert factory_response(bytes(4)) == [0.0] * 6


def test_a_bus_fault_is_an_error_not_a_failed_axis() -> None:
    bench = Bench()
    bench.bus.nack(after=100)
    with pytest.raises(BusError):
        bench.verdicts()
