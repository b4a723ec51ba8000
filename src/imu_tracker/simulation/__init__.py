"""Drives and walks that never happened, as the wires would have told of them.

From a scenario and a seed to frames and truth::

    Path (speed, curvature) -> Trajectory -> Motion -> ideal IMU -> MPU-6050 -> Frame
                                              |
                                              +-> position -> receiver -> NMEA -> Frame
                                              +-> TruthRow

Everything in here is exact but for the errors that are added on purpose: without
them strapdown returns to the truth, and a test holds it.
"""

from imu_tracker.simulation.scenarios import SCENARIOS, Scenario
from imu_tracker.simulation.simulator import Simulated, TruthRow, simulate

__all__ = ["SCENARIOS", "Scenario", "Simulated", "TruthRow", "simulate"]
