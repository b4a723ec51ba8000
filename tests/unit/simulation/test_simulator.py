"""The whole simulation: streams, truth, determinism, memory."""

import math
import tracemalloc
from itertools import islice, pairwise

import numpy as np
import pytest

from imu_tracker.calibration.counts import CountsModel
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import conjugate, rotate, to_euler
from imu_tracker.samples import DEFAULT_MOUNT, Frame, Mount, Source
from imu_tracker.simulation import SCENARIOS, simulate
from imu_tracker.simulation.imu.errors import IDEAL_CHIP, TYPICAL_CHIP
from imu_tracker.simulation.receiver.receiver import IDEAL_RECEIVER


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(
    scenario: str,
) -> None:
    def run(seed: int) -> list[Frame]:
        return list(simulate(scenario, seed=seed, duration_s=30.0).frames)

    assert run(5) == run(5)
    assert run(5) != run(6)


def test_a_short_simulation_is_a_prefix_of_a_long_one() -> None:
    short, long = (simulate("drive", duration_s=d) for d in (25.0, 40.0))
    frames, truth = list(short.frames), list(short.truth)

    assert frames == list(islice(long.frames, len(frames)))
    assert truth == list(islice(long.truth, len(truth)))


def test_frames_do_not_depend_on_the_truth_being_read() -> None:
    alone, both = (simulate("drive", duration_s=30.0) for _ in range(2))
    truth = list(both.truth)

    assert list(alone.frames) == list(both.frames)
    assert truth == list(alone.truth)


@pytest.mark.parametrize(
    ("scenario", "profile"),
    [
        ("still", "free"),
        ("walk-line", "walker"),
        ("walk-square", "walker"),
        ("roundabout", "vehicle"),
        ("drive", "vehicle"),
    ],
)
def test_the_header_says_how_to_decode_and_what_goes_there(
    scenario: str, profile: str
) -> None:
    header = simulate(scenario, accel_range_g=8, gyro_range_dps=250, rate_hz=50).header

    assert header.profile == profile
    assert header.name == scenario
    assert (header.accel_range_g, header.gyro_range_dps) == (8, 250)
    assert header.imu_rate_hz == 50
    assert header.mount == DEFAULT_MOUNT
    assert header.start_utc_s == 1795348800.0


def test_frames_come_in_order_until_the_end() -> None:
    frames = list(simulate("walk-line", duration_s=60.0).frames)
    t_ns = [frame.t_ns for frame in frames]

    assert t_ns == sorted(t_ns)
    assert 60.98e9 < t_ns[-1] < 61e9
    assert sum(frame.source is Source.IMU for frame in frames) == pytest.approx(
        6000, rel=0.011
    )
    assert sum(frame.source is Source.GPS for frame in frames) == 120
    assert all(len(frame.data) == 14 for frame in frames if frame.source is Source.IMU)


def test_the_default_drive_takes_fifteen_minutes_and_the_walks_end_at_rest() -> None:
    assert SCENARIOS["drive"].duration_s == 900.0
    for scenario in ("walk-line", "walk-square", "roundabout"):
        *_, last = simulate(scenario).truth
        assert last.v_n_mps == (0.0, 0.0, 0.0)


def test_the_walk_is_500_m_long_and_begins_near_delft() -> None:
    rows = list(simulate("walk-line").truth)
    frame = LocalFrame.at(rows[0].lat_rad, rows[0].lon_rad)

    assert math.degrees(rows[0].lat_rad) == pytest.approx(52.0)
    assert math.degrees(rows[0].lon_rad) == pytest.approx(4.37)
    north_m, east_m = frame.to_ne(rows[-1].lat_rad, rows[-1].lon_rad)
    assert math.hypot(north_m, east_m) == pytest.approx(500.0, abs=0.05)
    assert math.degrees(math.atan2(east_m, north_m)) == pytest.approx(40.0, abs=0.01)


@pytest.mark.parametrize("truth_hz", [4, 10])
def test_truth_comes_on_the_grid_of_utc_both_ends_included(truth_hz: int) -> None:
    rows = list(simulate("walk-line", duration_s=25.0, truth_hz=truth_hz).truth)
    utc_s = [row.utc_s - 1795348800.0 for row in rows]

    assert utc_s == pytest.approx([i / truth_hz for i in range(25 * truth_hz + 1)])


def test_the_truths_attitude_is_the_boxs() -> None:
    simulated = simulate("walk-line", duration_s=5.0)
    row = next(simulated.truth)
    counts = CountsModel(4, 500)
    still = [f for f in simulated.frames if f.source is Source.IMU]
    felt = np.mean([counts.decode(*f[::2]).accel_mps2 for f in still], axis=0)

    down_b = rotate(conjugate(row.q_nb), (0.0, 0.0, 1.0))
    expected = simulated.chip.accel_gain @ (-9.8123 * np.array(down_b))
    np.testing.assert_allclose(
        felt, expected + simulated.chip.accel_bias_mps2, atol=0.02
    )
    _, _, yaw = to_euler(row.q_nb)
    assert yaw == pytest.approx(math.radians(40.0), abs=0.1)


def test_an_ideal_simulation_decodes_to_gravity_and_turns() -> None:
    simulated = simulate(
        "roundabout", errors=IDEAL_CHIP, receiver=IDEAL_RECEIVER, gyro_range_dps=250
    )
    counts = CountsModel(4, 250)
    samples = [
        counts.decode(f.t_ns, f.data) for f in simulated.frames if f.source == "I"
    ]
    turned = sum(sample.gyro_radps[2] for sample in samples) * 0.01

    assert turned == pytest.approx(-10.0 * math.pi, abs=0.05)
    halfway = samples[len(samples) // 2]
    assert halfway.accel_mps2[1] == pytest.approx(
        -(6.0**2) * 2.0 * math.pi / 200.0, abs=0.08
    )  # less what the car's lean takes of gravity


@pytest.mark.parametrize("mount", [("+x", "-y", "-z"), ("-z", "+y", "+x")])
def test_the_mount_only_changes_which_counts_carry_what(mount: Mount) -> None:
    counts = CountsModel(4, 500, mount)
    frames = islice(simulate("still", mount=mount, errors=IDEAL_CHIP).frames, 1)
    frame = next(frames)

    assert counts.decode(frame.t_ns, frame.data).accel_mps2[2] == pytest.approx(
        -9.8123, abs=0.001
    )


def test_a_longer_walk_than_there_is_ends_standing_still() -> None:
    rows = list(simulate("walk-square", duration_s=1000.0).truth)

    assert rows[-1][1:4] == rows[2000][1:4]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"scenario": "fly"}, "must be one of still, walk-line"),
        ({"scenario": "still", "truth_hz": 3}, "must divide 20"),
        ({"scenario": "still", "truth_hz": 0}, "must divide 20"),
        ({"scenario": "still", "gps_every_s": 0.01}, "multiple of"),
    ],
)
def test_nonsense_is_refused_at_once(
    arguments: dict[str, object], complaint: str
) -> None:
    with pytest.raises(ValueError, match=complaint):
        simulate(**arguments)  # type: ignore[arg-type]


def test_a_long_drive_takes_no_more_memory_than_a_short_one() -> None:
    simulated = simulate("drive", duration_s=math.inf, rate_hz=20.0)
    frames, truth = simulated.frames, simulated.truth
    sizes = []
    tracemalloc.start()
    try:
        for _ in range(4):
            for _ in islice(frames, 6_000):
                pass
            for _ in islice(truth, 1_000):
                pass
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()

    # Kept, the frames alone would take 3 MB.
    assert sizes[-1] - sizes[0] < 500_000


def test_dropped_samples_are_missing_from_the_stream() -> None:
    errors = TYPICAL_CHIP._replace(dropped_share=0.05)
    all_there, some_not = (
        [f.t_ns for f in simulate("still", duration_s=60.0, errors=e).frames]
        for e in (TYPICAL_CHIP, errors)
    )

    assert len(some_not) == pytest.approx(0.95 * len(all_there), rel=0.02)
    assert max(b - a for a, b in pairwise(some_not)) > 15_000_000
