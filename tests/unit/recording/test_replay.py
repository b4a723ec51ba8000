"""What a replay tells of a recording besides its rows."""

from collections.abc import Iterator

from imu_tracker.config import load_config
from imu_tracker.recording.replay import Replay
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.simulation import simulate

S = 1_000_000_000


def test_what_repeats_is_told_with_its_count_at_the_end_of_each_session() -> None:
    drive = simulate("drive", seed=1, duration_s=70.0)
    frames = list(drive.frames)
    start_ns = frames[0].t_ns

    def arrives(frame: Frame) -> bool:
        """GPS fails six times: in each ten seconds from 10 s on, for the first six."""
        at_s = (frame.t_ns - start_ns) // S
        return frame.source is not Source.GPS or at_s < 10 or at_s % 10 >= 6

    def two_sessions() -> Iterator[SessionHeader | Frame]:
        for _ in range(2):
            yield drive.header
            yield from filter(arrives, frames)

    replay = Replay(load_config(None))
    for _ in replay.rows(two_sessions()):
        pass
    lost = [text for _, text in replay.notices if text.startswith("GPS lost")]
    at_once = ["GPS lost: dead reckoning"] * 3
    held = "GPS lost: dead reckoning (3 times in the last minute)"
    assert lost == [*at_once, held] * 2
