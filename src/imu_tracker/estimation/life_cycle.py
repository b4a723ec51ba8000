"""The phases of a tracker, and what leads from one to the next."""

from enum import Enum


class Phase(Enum):
    """The life of a `Tracker`; `Tracker._enter` changes it, and nothing else does.

    ::

        WAITING --> GUESS --> STARTING --> RUNNING
           |          |________________^      ^
           |__________________^               |

    A configured place leads from WAITING to GUESS. A fix leads from either to STARTING,
    or from GUESS to RUNNING when rows were made already. The first row leads from
    STARTING to RUNNING.
    """

    WAITING = "no position is known"
    GUESS = "at the configured place, without a fix"
    STARTING = "at a fix, before the first row: the next fix starts the filter again"
    RUNNING = "rows are made, fixes correct the filter"
