"""Doubts about heading, mounting and noise, and what decides them.

In: filters and how well each predicts the fixes. Out: which filter leads, a new heading
or noise level. Not here: the algebra of one filter (`error_state/filter`).
"""

__all__ = [
    "alignment",
    "combined",
    "comparison",
    "heading_evidence",
    "mixture",
    "noise_bank",
    "prior_trial",
    "receiver_alone",
    "reorient",
    "yaw_bank",
]
