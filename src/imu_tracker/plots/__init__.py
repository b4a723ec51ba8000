"""The log and recordings as pictures.

In: columns of a log or a recording. Out: PNG files. Not here: scores (`recording/`).
"""

__all__ = ["noise", "orders", "recording", "tracks"]
