"""Rotations and the earth: below everything else.

In: quaternions, vectors, latitudes. Out: the same, rotated or converted; WGS-84 radii
and gravity. Not here: anything that has a state or knows a sensor.
"""

__all__ = ["geodesy", "rotation"]
