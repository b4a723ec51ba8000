"""One page that explains a drive to the owner: track, trust, sensors, faults, advice.

In: a recording, or logs. Out: what was collected of it, findings, an HTML page. Not
here: estimation (`recording/replay` runs it), the map's script (`exports/`).
"""

__all__ = ["collect", "finding", "findings", "page"]
