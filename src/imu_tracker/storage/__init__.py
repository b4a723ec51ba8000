"""Files that survive power cuts.

In: rows and records. Out: the lat/long log, state and calibration files; append with
repair of a torn tail, rotation, atomic replacement. `daemon/status` and the outputs of
commands write their own files. Not here: the recording's format (`recording/`).
"""

__all__ = [
    "append_file",
    "calibration_file",
    "latlong",
    "log_tail",
    "state_file",
    "status_file",
    "torn_lines",
]
