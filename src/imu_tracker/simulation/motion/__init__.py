"""Paths: where the vehicle is at each instant, exactly.

In: legs (cruise, turn, stand). Out: position, velocity, attitude and their derivatives.
Not here: sensors.
"""

__all__ = ["driver", "figures", "paths", "positions", "trajectory"]
