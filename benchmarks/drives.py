"""What the benchmarks run on: a real drive, or a simulated one of the same length."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from imu_tracker.calibration.counts import CountsModel
from imu_tracker.recording.files import RecordingWriter, read_recording
from imu_tracker.samples import (
    DEFAULT_MOUNT,
    Frame,
    GpsFix,
    ImuSample,
    SessionHeader,
    Source,
)
from imu_tracker.sensors.gnss.epoch_reader import EpochReader
from imu_tracker.simulation import simulate

FOLDER_VARIABLE: Final = "IMU_TRACKER_RECORDINGS"
REAL_DRIVE: Final = "rtkexp_car"
REAL_DURATION_S: Final = 549.0


class Drive(NamedTuple):
    """A recording, and what it holds for those who cannot read it."""

    name: str
    path: Path
    scratch: Path  # a folder to write to
    samples: list[ImuSample]
    fixes: list[GpsFix]

    def events(self) -> list[ImuSample | GpsFix]:
        """Return samples and fixes in the order of their arrival."""
        both: list[ImuSample | GpsFix] = [*self.samples, *self.fixes]
        return sorted(both, key=lambda event: event.t_ns)

    def beginning(self, n_samples: int) -> "Drive":
        """Keep the first samples only, and the fixes among them."""
        samples = self.samples[:n_samples]
        fixes = [fix for fix in self.fixes if fix.t_ns < samples[-1].t_ns]
        return self._replace(samples=samples, fixes=fixes)


def find_drive(scratch: Path) -> Drive:
    """Take the real drive where there is one, else simulate one into `scratch`."""
    folder = os.environ.get(FOLDER_VARIABLE)
    path = Path(folder or "") / f"{REAL_DRIVE}.rec.gz"
    if folder and path.exists():
        return load(REAL_DRIVE, path, scratch)
    path = write_drive(scratch / "drive.rec.gz", REAL_DURATION_S)
    name = f"a simulated drive: {FOLDER_VARIABLE} leads to no {REAL_DRIVE}"
    return load(name, path, scratch)


def write_drive(path: Path, duration_s: float) -> Path:
    """Simulate a drive into a recording."""
    drive = simulate("drive", seed=1, duration_s=duration_s)
    with RecordingWriter(path) as writer:
        writer.write_header(drive.header)
        for frame in drive.frames:
            writer.write(frame)
    return path


def load(name: str, path: Path, scratch: Path) -> Drive:
    """Read a recording for those who cannot."""
    header, *items = read_recording(path)
    assert isinstance(header, SessionHeader)
    frames = [item for item in items if isinstance(item, Frame)]
    model = CountsModel(
        header.accel_range_g, header.gyro_range_dps, header.mount or DEFAULT_MOUNT
    )
    samples = [model.decode(f.t_ns, f.data) for f in frames if f.source is Source.IMU]
    return Drive(name, path, scratch, samples, list(_fixes(header, frames)))


def _fixes(header: SessionHeader, frames: list[Frame]) -> Iterator[GpsFix]:
    reader = EpochReader(reference_utc_s=header.start_utc_s)
    for t_ns, source, data in frames:
        told = reader.feed(t_ns, data) if source is Source.GPS else reader.advance(t_ns)
        yield from (fix for fix in told if isinstance(fix, GpsFix))
