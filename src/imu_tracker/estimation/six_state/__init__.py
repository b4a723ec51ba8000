"""The six-state filter: position and velocity, with an attitude filter beside it.

In: `ImuStep`, fixes, standstill. Out: `Estimate`. The readable reference. Not here:
learnt biases, mounting or delays (`error_state/`).
"""

__all__ = ["estimator", "position_filter"]
