"""Golden outputs: a change of behaviour shows in the diff.

`pytest tests/replay/test_golden.py --regen` writes them anew (and the recordings,
where one is missing). Between machines a track may move by a centimetre, on one
machine by nothing.
"""

import csv
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final, TypeAlias

import pytest

from imu_tracker.config import load_config
from imu_tracker.recording.files import RecordingWriter, read_recording
from imu_tracker.recording.replay import Replay
from imu_tracker.samples import Frame, Source
from imu_tracker.simulation import Simulated, simulate
from imu_tracker.storage.latlong import HEADER, format_row
from support.simulated import is_between, without

HERE = Path(__file__).parent
CENTIMETRE_DEG: Final = 0.01 / 111_320.0
RATE_HZ: Final = 50.0
ESTIMATORS: Final = ("error-state", "six-state")


def drive(simulated: Simulated) -> Iterator[Frame]:
    """Ten seconds without the receiver, and five without the chip."""
    frames = without(simulated.frames, Source.GPS, 40.0, 50.0)
    return without(frames, Source.IMU, 58.0, 63.0)


def walk(simulated: Simulated) -> Iterator[Frame]:
    """A receiver that sends GGA alone: no velocity, no date."""
    for frame in simulated.frames:
        if frame.source is Source.IMU or b"GGA" in frame.data:
            yield frame


def rounds(simulated: Simulated) -> Iterator[Frame]:
    """Garbage on the wires: wrong checksums, repeated bursts, a stuck chip."""
    stuck: bytes | None = None
    for k, frame in enumerate(simulated.frames):
        if frame.source is Source.GPS and k % 7 == 0:
            yield frame._replace(data=frame.data.replace(b"5", b"6", 1))
            continue
        if frame.source is Source.IMU and is_between(frame, 45.0, 47.0):
            stuck = stuck or frame.data
            frame = frame._replace(data=stuck)
        yield frame
        if frame.source is Source.IMU and k % 400 == 0:
            yield frame


def still(simulated: Simulated) -> Iterator[Frame]:
    """Nothing is edited."""
    return simulated.frames


Story: TypeAlias = tuple[str, float, Callable[[Simulated], Iterator[Frame]]]

STORIES: Final[Mapping[str, Story]] = {
    "drive": ("drive", 75.0, drive),
    "walk": ("walk-square", 60.0, walk),
    "rounds": ("roundabout", 70.0, rounds),
    "still": ("still", 40.0, still),
}


def record(name: str, path: Path) -> None:
    """Simulate a story and write down its recording."""
    scenario, duration_s, edit = STORIES[name]
    simulated = simulate(scenario, seed=21, duration_s=duration_s, rate_hz=RATE_HZ)
    with RecordingWriter(path) as writer:
        writer.write_header(simulated.header)
        for frame in edit(simulated):
            writer.write(frame)


def replayed(path: Path, estimator: str) -> list[str]:
    config = load_config(None, [f"filter.estimator={estimator}"])
    return [HEADER, *map(format_row, Replay(config).rows(read_recording(path)))]


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("name", STORIES)
def test_a_recording_makes_the_log_that_it_always_made(
    name: str, estimator: str, is_regen: bool
) -> None:
    recording = HERE / "recordings" / f"{name}.rec.gz"
    golden = HERE / "expected" / f"{name}.{estimator}.csv"
    if is_regen:
        if not recording.exists():
            record(name, recording)
        golden.write_text(
            "\n".join(replayed(recording, estimator)) + "\n", encoding="ascii"
        )
        pytest.skip("written anew")
    found = list(csv.DictReader(replayed(recording, estimator)))
    expected = list(csv.DictReader(golden.read_text(encoding="ascii").splitlines()))
    assert len(found) == len(expected)
    for new, old in zip(found, expected, strict=True):
        assert (new["time_utc"], new["mode"]) == (old["time_utc"], old["mode"])
        shrink = math.cos(math.radians(float(old["lat_deg"])))
        assert abs(float(new["lat_deg"]) - float(old["lat_deg"])) < CENTIMETRE_DEG
        away_deg = abs(float(new["lon_deg"]) - float(old["lon_deg"]))
        assert away_deg * shrink < CENTIMETRE_DEG
        assert float(new["r95_m"]) == pytest.approx(float(old["r95_m"]), abs=0.02)
        assert float(new["speed_mps"]) == pytest.approx(
            float(old["speed_mps"]), abs=0.02
        )
        assert (new["alt_m"] == "") == (old["alt_m"] == "")


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("name", STORIES)
def test_a_replay_is_the_same_to_the_byte(name: str, estimator: str) -> None:
    recording = HERE / "recordings" / f"{name}.rec.gz"
    assert replayed(recording, estimator) == replayed(recording, estimator)
