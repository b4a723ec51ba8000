"""Metrics as lines of text, for the textfile collector of the node exporter.

Source: Prometheus' text exposition format, version 0.0.4; its names and base units.
"""

from collections.abc import Iterator
from typing import Final

PREFIX: Final = "imu_tracker_"


def metric(
    name: str, kind: str, text: str, samples: list[tuple[dict[str, str], float]]
) -> Iterator[str]:
    """Yield the lines of a metric, a sample for each set of labels."""
    yield f"# HELP {PREFIX}{name} {text}"
    yield f"# TYPE {PREFIX}{name} {kind}"
    for labels, value in samples:
        pairs = ",".join(f'{key}="{_escaped(text)}"' for key, text in labels.items())
        yield f"{PREFIX}{name}{f'{{{pairs}}}' if pairs else ''} {value}"


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
