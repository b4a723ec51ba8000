"""Along a route: where to go next, how far, and how far beside it.

In: a GPX file, rows of the log. Out: `Guidance` for a row. Not here: sentences and
pages that show it (`serve/`).
"""

__all__ = ["guide", "route"]
