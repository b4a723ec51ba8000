"""The best track afterwards: what the filters did, and the pass back through it.

In: every prediction and correction of the filters, as they are made, and the rows of
the tracker. Out: the same rows, smoothed. Not here: the filters; they do not know who
reads what they keep, and keep nothing unless asked to.
"""

__all__ = ["entries", "history", "kept", "smoother"]
