"""One thing that is wrong, in words for the owner."""

from enum import IntEnum
from typing import NamedTuple


class Weight(IntEnum):
    """How much it costs, the worst first."""

    BAD = 0  # the track suffers all the time, or there is none
    POOR = 1  # it suffers now and then
    NOTE = 2  # good to know


class Finding(NamedTuple):
    """`kind` names it for machines; the texts are for people."""

    kind: str
    weight: Weight
    what: str
    how_it_shows: str
    what_to_do: str
