"""From counts to SI units in body axes, and the fits that calibrate a sensor. Pure.

In: raw counts, ranges, mounting, a calibration. Out: `ImuSample`; biases, gains,
mounting, Allan deviation. Not here: reading or writing files, asking the user.
"""

__all__ = [
    "allan",
    "bias",
    "corrected",
    "counts",
    "faces",
    "measures",
    "mounting",
    "readings",
    "still",
]
