"""The daemon: the loop, supervision, status and kept state.

In: a configuration. Out: rows in the log, the status file, an exit code. Not here:
estimation (`pipeline`), reading sensors (`sources/`).
"""

__all__ = ["run"]
