"""Whether a destination would do: what `imu-tracker check` asks."""

from contextlib import closing

from imu_tracker.config.publishing import PublishConfig
from imu_tracker.publish.senders.factory import sender_of


def try_destination(config: PublishConfig) -> str:
    """Connect, log in, and return how it went; no row is sent.

    Raises
    ------
    DestinationError
        With what is wrong and how to mend it.
    ConfigError
        When a package is missing.
    """
    with closing(sender_of(config, lambda: None, None, is_trial=True)) as sender:
        sender.open()
        return f"{config.endpoint}: {sender.probe()}"
