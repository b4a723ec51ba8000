"""One file a command: its arguments, and a call of the room that does the work.

In: parsed arguments. Out: an exit code. Heavy imports stand inside the functions. Not
here: anything that another room could need.
"""

__all__ = [
    "check",
    "common",
    "export",
    "plot",
    "record",
    "recorded",
    "replay",
    "run",
    "simulate",
    "status",
]
