"""How far off: the thesis's own measure, and a plain one."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def its_measure(ne_m: Array, truth_ne_m: Array) -> float:
    """Square root of the mean horizontal distance, as the thesis's code computes it.

    It calls that the root of the mean square error; a mean distance of 1 mm is 0.0316.
    """
    return float(np.sqrt(mean_distance_m(ne_m, truth_ne_m)))


def mean_distance_m(ne_m: Array, truth_ne_m: Array) -> float:
    """Mean horizontal distance; arrays of shape (..., n, 2)."""
    off_m = ne_m - truth_ne_m
    return float(np.mean(np.hypot(off_m[..., 0], off_m[..., 1])))
