"""What the pictures share: colours, thinning that loses no peak, saving."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imu_tracker.errors import OutputError
from imu_tracker.exports.palette import BLACK as BLACK
from imu_tracker.exports.palette import BLUE as BLUE
from imu_tracker.exports.palette import GREEN as GREEN
from imu_tracker.exports.palette import ORANGE as ORANGE
from imu_tracker.exports.palette import PURPLE as PURPLE
from imu_tracker.exports.palette import SKY as SKY
from imu_tracker.exports.palette import VERMILION as VERMILION

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_POINTS: Final = 4000
"""Of a line: a few times the pixels of the picture's width."""

_DPI: Final = 120


def envelope(values: Array) -> Indices:
    """Choose points so that no peak is lost: lowest and highest of each bucket."""
    n = len(values)
    if n <= MAX_POINTS:
        return np.arange(n)
    size = -(-2 * n // MAX_POINTS)
    starts = range(0, n, size)
    lowest = [start + int(np.argmin(values[start : start + size])) for start in starts]
    highest = [start + int(np.argmax(values[start : start + size])) for start in starts]
    return np.unique(np.array(lowest + highest, np.intp))


def runs(holds: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield start and stop of each stretch in which a condition holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def legend_above(panel: Axes) -> None:
    """Put the legend above the right corner, where it hides nothing."""
    panel.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=4,
        frameon=False,
        borderaxespad=0.1,
    )


def save(figure: Figure, output: Path) -> None:
    """Write the picture.

    Raises
    ------
    OutputError
        When the disk refuses it, or nobody knows that kind of picture.
    """
    try:
        figure.savefig(output, dpi=_DPI, format=output.suffix[1:] or "png")
    except OSError as error:
        raise OutputError(f"{output}: {error.strerror or error}") from error
    except ValueError as error:
        raise OutputError(f"{output}: not a kind of picture; use .png") from error
