"""The steps between the filter and now: how far it stays behind, and what that gives.

The filter stays as far behind as fixes take to come, so that nothing has to be repeated
when one arrives. What waits here has two uses meanwhile: rows are predicted through it,
and they confirm in hindsight that a standstill was one.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import Final

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.geometry.rotation import rotate
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import Vec3

LEAST_LAG_NS: Final = 1_000_000_000
MAX_LAG_NS: Final = 2_500_000_000
LAG_MARGIN_NS: Final = 80_000_000
"""How far the filter stays behind: as long as fixes take to come, learnt, and long
enough to see in hindsight whether a rest was one."""

PULLING_OFF_MPS: Final = 0.1
"""A body that rests gains no speed: what a rocking car shows within a second."""

FOLD_S: Final = 0.02
"""A delay beyond this moves the instants of the fixes, half a step of 40 ms; the state
begins again at zero, where v times delay is exact."""


class FixedLagBuffer:
    """Steps that the filter has yet to take, oldest first.

    Attributes
    ----------
    now_ns : int
        End of the newest step.
    lag_ns : int
        How far the filter stays behind.
    shift_ns : int
        Fixes describe so much later than the tracker assumes: the part of the delay
        that was found and moved out of the filters.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[ImuStep, Rest | None]] = deque()
        self.now_ns = 0
        self.lag_ns = LEAST_LAG_NS
        self.shift_ns = 0

    def add_step(self, step: ImuStep, rest: Rest | None) -> None:
        """Let a step wait."""
        self._waiting.append((step, rest))
        self.now_ns = step.t_ns

    def due(self) -> Iterator[tuple[ImuStep, Rest | None]]:
        """Take out, one by one, what lies further back than the lag."""
        waiting = self._waiting
        while waiting and waiting[0][0].t_ns <= self.now_ns - self.lag_ns:
            yield waiting.popleft()

    def until(self, t_ns: int) -> Iterator[tuple[ImuStep, Rest | None]]:
        """Take out, one by one, up to the step that ends nearest to an instant."""
        waiting = self._waiting
        while (
            waiting and 2 * waiting[0][0].t_ns - _length_ns(waiting[0][0]) <= 2 * t_ns
        ):
            yield waiting.popleft()

    def learn_lag(self, instant_ns: int) -> None:
        """Stay behind as far as the fix of this instant took to come."""
        needed = max(self.now_ns - instant_ns + LAG_MARGIN_NS, LEAST_LAG_NS)
        if needed > self.lag_ns:
            self.lag_ns = min(needed, MAX_LAG_NS)
        else:
            self.lag_ns -= (self.lag_ns - needed) // 50

    def confirms_rest(self, eskf: Eskf, step: ImuStep) -> bool:
        """Whether all that waits agrees that the body rests since `step` began.

        Notes
        -----
        The level speed gained, less the bias, stays within `PULLING_OFF_MPS` and three
        sigmas. Tilt and bias are each known badly, but after some rest not what
        they do together: dv = -[f x] theta t - C_nb b_a t.
        """
        if any(rest is None for _, rest in self._waiting):
            return False
        dvn, dve, _ = rotate(eskf.nominal.q_nb, self._sum_of_dv(step))
        time_s = step.dt_s + sum(later.dt_s for later, _ in self._waiting)
        bn, be, _ = rotate(eskf.nominal.q_nb, eskf.accel_bias_mps2)
        sigma = time_s * math.sqrt(2.0 * eskf.level_accel_var)
        gained_mps = math.hypot(dvn - bn * time_s, dve - be * time_s)
        return gained_mps < PULLING_OFF_MPS + 3.0 * sigma

    def _sum_of_dv(self, step: ImuStep) -> Vec3:
        x, y, z = step.dv_b_mps
        for each, _ in self._waiting:
            dx, dy, dz = each.dv_b_mps
            x, y, z = x + dx, y + dy, z + dz
        return (x, y, z)

    def fold_delay(self, filters: tuple[Eskf, ...]) -> None:
        """Move the instants of the fixes by the delay that the first filter found."""
        delay_s = filters[0].delay_s
        if abs(delay_s) < FOLD_S:
            return
        self.shift_ns += round(delay_s * 1e9)
        for each in filters:
            each.delay_s -= delay_s
            each.velocity_delay_s -= delay_s

    def predict(
        self, eskf: Eskf, t_ns: int, can_use_force: Callable[[Rest | None], bool]
    ) -> Nominal:
        """Carry the filter's solution to the step that ends nearest to an instant."""
        nominal = eskf.nominal
        for step, rest in self._waiting:
            if step.t_ns - _length_ns(step) // 2 > t_ns:
                break
            nominal = eskf.mechanise(nominal, step, use_force=can_use_force(rest))
        return nominal


def _length_ns(step: ImuStep) -> int:
    return round(step.dt_s * 1e9)
