"""Files that survive power cuts.

In: rows and records. Out: the lat/long log, state and calibration files; append with
repair of a torn tail, rotation, atomic replacement. The outputs of commands are their
own affair. Not here: the recording's format (`recording/`).
"""

__all__ = [
    "append_file",
    "atomic",
    "calibration_file",
    "latlong",
    "log_tail",
    "state_file",
    "state_model",
    "status_file",
    "torn_lines",
]
