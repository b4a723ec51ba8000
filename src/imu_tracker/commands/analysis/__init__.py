"""Commands for after the drive: what a recording says that nobody could know live.

In: parsed arguments. Out: an exit code. Not here: anything that another room could
need.
"""

__all__ = ["batch", "report", "smooth", "tune"]
