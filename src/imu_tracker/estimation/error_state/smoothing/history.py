"""Keeps what happens to the filters, until a smoother has seen it."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.hypotheses.comparison import Comparison
from imu_tracker.estimation.error_state.hypotheses.receiver_alone import KeptFix
from imu_tracker.estimation.error_state.smoothing.entries import Entry, Mark
from imu_tracker.estimation.error_state.states import Scene

MARK_EVERY: Final = 2
"""Predictions of 0.12 s: a cubic between them is true to a millimetre."""


class History:
    """What the filters and the receiver alone went through, newest last.

    Attributes
    ----------
    fixes : deque of KeptFix
    """

    def __init__(self) -> None:
        self.fixes: deque[KeptFix] = deque()
        self._filters: Sequence[Eskf] = ()
        self._n_predictions = 0

    def begin(self, filters: Sequence[Eskf], comparison: Comparison) -> None:
        """Have filters, and the receiver alone, keep what happens to them."""
        comparison.kept_fixes = self.fixes
        self._filters = filters
        for each in filters:
            each.keeps_history = True

    def mark(self, filters: Sequence[Eskf], scene: Scene) -> None:
        """Mark an instant, now and then, to find rows at; the first filter leads."""
        self._filters = filters
        self._n_predictions += 1
        if self._n_predictions % MARK_EVERY:
            return
        for each in filters:
            each.past = Mark(each.past, each.nominal, each.delay_s, each.P, scene)

    @property
    def newest(self) -> Entry | None:
        """End of the history of the filter that leads."""
        return self._filters[0].past if self._filters else None

    def let_go(self, t_ns: int) -> None:
        """Drop what happened before an instant."""
        while self.fixes and self.fixes[0].t_ns < t_ns:
            self.fixes.popleft()
        for each in self._filters:
            entry = each.past
            while entry is not None:
                if isinstance(entry, Mark) and entry.t_ns <= t_ns:
                    entry.before = None
                entry = entry.before
