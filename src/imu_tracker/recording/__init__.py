"""Recordings: format, files, editing, capture, replay and its score.

In: frames or a path. Out: frames, scores, sensor reports. Not here: live sources
(`sources/`), estimation.
"""

__all__ = [
    "advice",
    "capture",
    "edit",
    "files",
    "layout",
    "replay",
    "scoring",
    "sensor_report",
    "smoothing",
    "tuning",
]
