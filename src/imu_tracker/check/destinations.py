"""Whether the destinations of `[[publish]]` are there, and want what they will get."""

from collections.abc import Iterator

from imu_tracker.check.sensors import Finding, Verdict
from imu_tracker.config import Config
from imu_tracker.errors import TrackerError
from imu_tracker.publish.trial import try_destination


def check_destinations(config: Config) -> Iterator[Finding]:
    """Try each of them; a destination that is away holds up no tracking."""
    for table in config.publish:
        what = f"publish {table.name}"
        try:
            yield Finding(Verdict.OK, what, try_destination(table))
        except TrackerError as error:
            yield Finding(Verdict.FAILED, what, str(error), error.exit_code)
