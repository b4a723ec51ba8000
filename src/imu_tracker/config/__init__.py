"""The configuration: tables, values, loading. Every problem of a file at once.

In: a TOML file and `--set` overrides. Out: a frozen `Config`. Not here: what a setting
does.
"""

from imu_tracker.config.loading import load_config
from imu_tracker.config.tables import Config, keys

__all__ = [
    "Config",
    "keys",
    "load_config",
    "outputs",
    "publishing",
    "serving",
    "tables",
    "values",
]
