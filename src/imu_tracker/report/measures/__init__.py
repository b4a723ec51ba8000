"""What a drive says of sensors and track, measured while it passes by.

In: bursts, lines, rows, fixes. Out: figures, and series for charts. Not here: what is
wrong with them, and any words (`report/findings`, `report/sections`).
"""

__all__ = ["imu_log", "receiver_log", "series", "track_log"]
