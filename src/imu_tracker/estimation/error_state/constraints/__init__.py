"""Pseudo-measurements of the platform: vehicle, road, pedestrian, and their schedule.

In: state, covariance, standstill, profile. Out: measurements with noise. Not here: the
filter that applies them.
"""

__all__ = ["schedule", "wheel_aiding"]
