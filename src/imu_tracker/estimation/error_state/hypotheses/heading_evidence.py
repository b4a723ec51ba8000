"""What accelerations and course say of heading and mounting.

In: fixes, and the accelerations since the last one. Out: a heading that contradicts the
filter's, or filters that assume other mountings.
"""

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.hypotheses.noise_bank import Kind, Rival
from imu_tracker.estimation.error_state.hypotheses.reorient import (
    mount,
    off_course,
    separate_delays,
    set_course_heading,
)
from imu_tracker.estimation.error_state.hypotheses.yaw_bank import YawBank
from imu_tracker.estimation.error_state.receiver_model import ReceiverModel
from imu_tracker.estimation.error_state.states import VELOCITY_DELAY, Array
from imu_tracker.geometry.rotation import wrap_pi
from imu_tracker.samples import GpsFix

BANK_PERIOD_S: Final = 0.5
BANK_VELOCITY_VAR: Final = 0.3**2
"""A moving box swings against the antenna."""

CONTRADICTED_FIXES: Final = 5
"""How often the yaw bank must contradict the heading before its own is tried."""

TURNED_BY_RAD: Final = math.pi / 4.0
TURNED_SIGMA_RAD: Final = math.radians(15.0)
TURNED_NATS: Final = -2.0
"""Steps in which a box may lie turned in its vehicle, how far it is off those, and the
log odds of each against one that points ahead."""


class HeadingEvidence(YawBank):
    """The yaw bank at its own rate, with a count of its contradictions."""

    def __init__(self) -> None:
        super().__init__()
        self._due_s = 0.0
        self._n_contradicted = 0

    def restart(self) -> None:
        """Begin anew with the next fix, and count contradictions from zero."""
        self.reset()
        self._n_contradicted = 0

    def add_fix(
        self, fix: GpsFix, position_ne: Array, receiver: ReceiverModel, eskf: Eskf
    ) -> bool:
        """Compare the accelerations of `eskf` with a fix; return whether it was due.

        A receiver that catches up after an outage says nothing, and starts it anew.
        """
        self._due_s -= receiver.period_s
        if self._due_s > 0.0:
            return False
        self._due_s = BANK_PERIOD_S
        if receiver.is_catching_up:
            self.reset()
            return False
        self.update(
            position_ne,
            max(0.35 * fix.sigma_h_m, 0.3) ** 2,
            None if fix.vel_ne_mps is None else np.array(fix.vel_ne_mps),
            receiver.velocity_var + BANK_VELOCITY_VAR,
            max(0.1, eskf.sigma(VELOCITY_DELAY)) ** 2,
            eskf.level_accel_var,
            eskf.down_bias,
        )
        return True

    def lasting_contradiction(self) -> tuple[float, float] | None:
        """Count a contradiction; return it, rad and its sigma, if it is one of many."""
        heading = self.contradiction()
        self._n_contradicted = 0 if heading is None else self._n_contradicted + 1
        if self._n_contradicted < CONTRADICTED_FIXES:
            return None
        self._n_contradicted = 0
        return heading


def turned_rivals(
    main: Eskf,
    course_rad: float,
    sigma_rad: float,
    log_density: Callable[[float], float],
) -> list[Rival]:
    """Return filters on a course that differ by how the box is turned in the vehicle.

    Parameters
    ----------
    main : Eskf
        What they are copied from.
    course_rad, sigma_rad : float
    log_density : callable
        Log of the probability density of a turn of the heading of `main`.
    """
    rivals = []
    for i in range(round(2.0 * math.pi / TURNED_BY_RAD)):
        turned_rad = wrap_pi(i * TURNED_BY_RAD)
        eskf, nats = main.clone(main.noise), 0.0
        if i:
            nats = TURNED_NATS
            mount(eskf, turned_rad, TURNED_SIGMA_RAD)
        nats += log_density(off_course(eskf, course_rad))
        set_course_heading(eskf, course_rad, sigma_rad)
        separate_delays(eskf)
        degrees = math.degrees(turned_rad)
        name = f"box sits turned by {degrees:.0f} deg" if i else ""
        rivals.append(Rival(eskf, Kind.HEADING, name, nats))
    return rivals
