"""The configuration: TOML to frozen models, and every mistake said at once.

`tables` declares the keys, with one model for each table of the file; `values` the
kinds of values that pydantic does not know; `loading` reads files and `--set`.
"""

from imu_tracker.config.loading import load_config
from imu_tracker.config.tables import Config, keys

__all__ = ["Config", "keys", "load_config"]
