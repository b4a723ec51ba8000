"""Steps and fixes in, position with a radius out. Pure.

In: `ImuSample`, `GpsFix`. Out: `NavState` at the output rate, `Prediction`. `Tracker`
owns time and the order of events, `settings` the choice of estimator. r95 comes from
`estimate.r95_of` for one covariance, and from `error_state/hypotheses/combined` for
several hypotheses. A late fix is handled by `error_state/fixed_lag`, or by `rewind` for
six-state. Not here: decoding, files, clocks.
"""

__all__ = ["estimate", "prediction", "report", "settings", "tracker", "tuning"]
