"""Thousands of recordings at once: on all cores here, or on a Dask cluster.

In: paths of recordings, a configuration. Out: a log for each, and one table. Not here:
tracking itself (`recording/`, `report/`).
"""

__all__ = ["cluster", "jobs", "table"]
