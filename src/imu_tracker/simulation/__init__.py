"""Simulated drives with exact truth. Pure.

In: a scenario and a seed. Out: frames as the wires deliver them, and the true path. Not
here: files and pace.
"""

from imu_tracker.simulation.scenarios import SCENARIOS, Scenario
from imu_tracker.simulation.simulator import Simulated, TruthRow, simulate

__all__ = [
    "SCENARIOS",
    "Scenario",
    "Simulated",
    "TruthRow",
    "scenarios",
    "simulate",
    "simulator",
]
