"""Steps and fixes in, position with a radius out. Pure.

In: `ImuSample`, `GpsFix`. Out: `NavState` at the output rate, `Prediction`. `Tracker`
owns time, the order of events and the choice of estimator. Not here: decoding, files,
clocks.
"""

__all__ = ["estimate", "prediction", "tracker"]
