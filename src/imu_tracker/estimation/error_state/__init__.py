"""The error-state filter, the default estimator.

In: `ImuStep`, fixes, standstill, what an earlier run learnt. Out: `Estimate`, and what
was learnt. Not here: the order of events and output times (`Tracker`).
"""

__all__ = [
    "estimator",
    "filter",
    "fix_update",
    "fixed_lag",
    "mechanisation",
    "platform",
    "propagation",
    "receiver_model",
    "states",
    "warm_start",
]
