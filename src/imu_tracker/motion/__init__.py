"""What the IMU shows without a receiver.

In: calibrated samples (`ImuSample`, body axes). Out: integrated steps of 40 ms,
standstill (the condition of the zero-velocity update), vibration level, steps of a
walker, the profile, stuck axes. Not here: position, heading, or any filter.
"""

__all__ = [
    "preintegration",
    "profile",
    "standstill",
    "step_detector",
    "stuck_axes",
    "vibration",
]
