"""The receiver: sentences by an oracle of the test's own, errors by statistics."""

import math
from itertools import islice, pairwise

import numpy as np
import pytest

from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.simulation import SCENARIOS
from imu_tracker.simulation.motion.paths import FloatArray, Path
from imu_tracker.simulation.motion.positions import Whereabouts, whereabouts
from imu_tracker.simulation.motion.trajectory import Ride
from imu_tracker.simulation.receiver.receiver import (
    IDEAL_RECEIVER,
    TYPICAL_RECEIVER,
    Line,
    Receiver,
    ReceiverErrors,
)
from imu_tracker.simulation.receiver.sentences import (
    Report,
    Resolution,
    Solution,
    gga,
    gst,
    rmc,
)
from imu_tracker.simulation.scenarios import DELFT

START_UTC_S = 1795348800.0
STILL = Ride(Path(()))
FRAME = LocalFrame.at(DELFT.lat_rad, DELFT.lon_rad)


def fields(line: Line) -> list[str]:
    return line.data.decode("ascii").partition("*")[0].split(",")


def angle_rad(text: str, hemisphere: str) -> float:
    degrees, minutes = divmod(float(text), 100.0)
    sign = -1.0 if hemisphere in "SW" else 1.0
    return sign * math.radians(degrees + minutes / 60.0)


def lines_of(
    errors: ReceiverErrors,
    n: int,
    *,
    scenario: str | None = None,
    every_s: float = 1.0,
    seed: int = 1,
) -> list[Line]:
    ride = (
        SCENARIOS[scenario].trajectory(np.random.default_rng(4)) if scenario else STILL
    )
    receiver = Receiver(errors, np.random.default_rng(seed), every_s, START_UTC_S)
    return list(islice(receiver.lines(whereabouts(ride, DELFT)), n))


def rmc_errors(lines: list[Line]) -> FloatArray:
    """North and east errors in metres of a receiver at rest."""
    rows = [fields(line) for line in lines]
    return np.array(
        [
            FRAME.to_ne(angle_rad(*row[3:5]), angle_rad(*row[5:7]))
            for row in rows
            if row[0] == "$GNRMC" and row[2] == "A"
        ]
    )


def test_every_sentence_ends_in_its_checksum() -> None:
    errors = TYPICAL_RECEIVER._replace(sends_gst=True)
    for line in lines_of(errors, 3 * 500, scenario="drive"):
        body, _, checksum = line.data[1:].partition(b"*")
        total = 0
        for byte in body:
            total ^= byte
        assert line.data[:1] == b"$"
        assert checksum == b"%02X" % total
        assert len(line.data) <= 80


def test_a_receiver_without_fix_or_time_says_what_a_ublox_says() -> None:
    nothing = Report(None, None)

    assert rmc(nothing, Resolution()) == b"$GNRMC,,V,,,,,,,,,,N*4D"
    assert gga(nothing, Resolution()) == b"$GNGGA,,,,,,0,00,99.99,,,,,,*56"


SOLUTION = Solution(
    math.radians(-33.5), math.radians(-0.25), 12.34, (0.0, -10.0), 1.87, 3.4, 0.9
)


def test_sentences_carry_hemispheres_speed_course_and_height() -> None:
    report = Report(START_UTC_S + 0.25, SOLUTION)
    place = b"3330.00000,S,00015.00000,W"

    assert rmc(report, Resolution()).startswith(
        b"$GNRMC,120000.25,A," + place + b",19.44,270.0,221126,,,A*"
    )
    assert gga(report, Resolution()).startswith(
        b"$GNGGA,120000.25," + place + b",1,09,0.90,12.3,M,43.0,M,,*"
    )
    assert gst(report).startswith(b"$GNGST,120000.25,1.9,,,,1.9,1.9,3.4*")


def test_no_minute_is_written_as_sixty_and_no_course_as_360() -> None:
    almost = math.radians(52.0) - 1e-12
    solution = SOLUTION._replace(
        lat_rad=almost, lon_rad=almost, vel_ne_mps=(10.0, -1e-4)
    )
    row = rmc(Report(START_UTC_S, solution), Resolution()).decode().split(",")

    assert row[3] == "5200.00000"
    assert row[5] == "05200.00000"
    assert row[8] == "0.0"


def test_a_slow_receiver_gives_no_course() -> None:
    solution = SOLUTION._replace(vel_ne_mps=(0.1, 0.1))

    assert b",0.27,,221126" in rmc(Report(START_UTC_S, solution), Resolution())


def test_a_cold_start_brings_first_the_time_then_the_place() -> None:
    rows = [fields(line) for line in lines_of(TYPICAL_RECEIVER, 30)][::2]

    assert [row[1] for row in rows[:4]] == ["", "", "", "120003.00"]
    assert [row[2] for row in rows] == ["V"] * 8 + ["A"] * 7


def test_an_ideal_receiver_tells_the_truth_late() -> None:
    lines = lines_of(IDEAL_RECEIVER, 600, scenario="roundabout")[::2]
    ticks = whereabouts(
        SCENARIOS["roundabout"].trajectory(np.random.default_rng(4)), DELFT
    )
    stretches = list(islice(ticks, 30))
    for second, line in enumerate(lines):
        stretch, i = stretches[second // 10], second % 10 * 20
        row = fields(line)
        north, east = FRAME.to_ne(angle_rad(*row[3:5]), angle_rad(*row[5:7]))
        there = FRAME.to_ne(float(stretch.lat_rad[i]), float(stretch.lon_rad[i]))
        assert (north, east) == pytest.approx(there, abs=1e-4)
        assert line.t_s == pytest.approx(second + 0.2)
        if row[8]:
            v_north, v_east = stretch.motion.v_n[i, :2]
            course = math.degrees(math.atan2(v_east, v_north)) % 360.0
            assert float(row[8]) == pytest.approx(course, abs=1e-4)
            speed = float(row[7]) * 1852.0 / 3600.0
            assert speed == pytest.approx(math.hypot(v_north, v_east), abs=1e-5)


EVERY_S = 5.0


@pytest.fixture(scope="module")
def long_errors_m() -> FloatArray:
    """Eleven hours of errors at rest, every five seconds."""
    errors = TYPICAL_RECEIVER._replace(time_after_s=0.0, fix_after_s=0.0)
    return rmc_errors(lines_of(errors, 16_000, every_s=EVERY_S))


def test_position_errors_have_their_size_and_last_for_a_minute(
    long_errors_m: FloatArray,
) -> None:
    sigma_m = long_errors_m.std(axis=0)

    np.testing.assert_allclose(sigma_m, math.hypot(1.8, 0.5), rtol=0.1)
    slow_share = 1.8**2 / (1.8**2 + 0.5**2)
    for lag in (1, 12, 24):
        expected = slow_share * math.exp(-lag * EVERY_S / 60.0)
        for axis in long_errors_m.T:
            found = np.corrcoef(axis[lag:], axis[:-lag])[0, 1]
            assert found == pytest.approx(expected, abs=0.1)


def test_the_average_of_a_minute_is_hardly_better_than_one_fix(
    long_errors_m: FloatArray,
) -> None:
    minutes = long_errors_m[:7992].reshape(-1, 12, 2).mean(axis=1)

    assert 1.2 < minutes.std() < 1.8  # were they independent: 0.5


def test_speeds_at_rest_are_small_and_not_zero() -> None:
    rows = [fields(line) for line in lines_of(TYPICAL_RECEIVER, 4000)][::2]
    speed_mps = np.array([float(row[7]) for row in rows if row[2] == "A"]) * 0.5144

    rms_per_axis = math.sqrt(np.mean(speed_mps**2) / 2.0)
    assert rms_per_axis == pytest.approx(math.hypot(0.06, 0.04), rel=0.1)


def test_the_second_sentence_follows_when_the_first_is_through() -> None:
    lines = lines_of(TYPICAL_RECEIVER._replace(sends_gst=True), 300)
    for first, second in pairwise(lines):
        transmission_s = (len(first.data) + 2) * 10 / 9600
        assert second.t_s >= first.t_s + transmission_s - 1e-9
        if first.data[3:6] != b"GST":
            assert second.t_s == pytest.approx(first.t_s + transmission_s)


def test_latency_has_its_mean_and_spread_and_stays_positive() -> None:
    errors = TYPICAL_RECEIVER._replace(latency_s=0.1, latency_sigma_s=0.04)
    late_s = np.array([line.t_s for line in lines_of(errors, 4000)[::2]])
    late_s -= np.arange(2000)

    assert late_s.mean() == pytest.approx(0.1, abs=0.005)
    assert late_s.std() == pytest.approx(0.04, rel=0.15)
    assert late_s.min() == pytest.approx(0.05)


def test_a_port_that_is_too_slow_delays_but_never_reorders() -> None:
    errors = TYPICAL_RECEIVER._replace(baud=4800)
    t_s = [line.t_s for line in lines_of(errors, 1000, every_s=0.25)]

    assert t_s == sorted(t_s)


@pytest.mark.parametrize(
    ("every_s", "hundredths"), [(1.0, 100), (3.0, 300), (0.2, 20), (25.0, 2500)]
)
def test_epochs_come_on_the_grid_of_utc(every_s: float, hundredths: int) -> None:
    lines = lines_of(IDEAL_RECEIVER, 400, every_s=every_s)[::2]
    times = [fields(line)[1] for line in lines]
    since_noon = [
        360_000 * (int(t[:2]) - 12) + 6000 * int(t[2:4]) + round(100 * float(t[4:]))
        for t in times
    ]

    assert since_noon == [i * hundredths for i in range(200)]


@pytest.mark.parametrize("every_s", [0.0, -1.0, 0.03])
def test_an_epoch_interval_off_the_grid_is_refused(every_s: float) -> None:
    with pytest.raises(ValueError, match=r"multiple of 0\.05 s"):
        Receiver(TYPICAL_RECEIVER, np.random.default_rng(1), every_s, START_UTC_S)


def covered_seconds(stretches: list[Whereabouts]) -> FloatArray:
    t_s = np.concatenate([stretch.motion.t_s for stretch in stretches])
    hidden = np.concatenate([stretch.motion.is_covered for stretch in stretches])
    return np.asarray(t_s[hidden])


@pytest.mark.parametrize("every_s", [1.0, 5.0])
def test_a_tunnel_hides_the_sky_and_a_few_seconds_more(every_s: float) -> None:
    ticks = whereabouts(SCENARIOS["drive"].trajectory(np.random.default_rng(4)), DELFT)
    hidden_s = covered_seconds(list(islice(ticks, 80)))
    lines = lines_of(
        TYPICAL_RECEIVER, int(2 * 800 / every_s), scenario="drive", every_s=every_s
    )

    assert 59.0 < len(hidden_s) / 20.0 < 61.0
    assert 300.0 < hidden_s[0] < 400.0
    for epoch, line in enumerate(lines[::2]):
        t_s = epoch * every_s
        in_tunnel = hidden_s[0] <= t_s <= hidden_s[-1] + 3.0
        is_blind = t_s < 8.0 or bool(in_tunnel)
        row = fields(line)
        assert row[2] == ("V" if is_blind else "A")
        assert (row[3] == "") is is_blind
        quality = fields(lines[2 * epoch + 1])[6]
        assert quality == ("0" if is_blind else "1")
        if t_s >= 3.0:
            assert row[1] != ""
            assert row[9] == "221126"
