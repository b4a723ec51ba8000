"""Whether sensors that speak flawlessly speak the truth; pure, and the same for replay.

Drivers notice what breaks a rule: a transfer, a checksum, a register. Here is noticed
what breaks none: an axis that stands, a receiver that drifts away from what the IMU
feels or from its own velocity, epochs that come later and later.
"""
