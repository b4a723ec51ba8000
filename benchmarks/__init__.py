"""What imu-tracker costs: per sample beside its peers, over an hour, at the start.

`python -m benchmarks` from the top of the checkout measures all of it; README.md in
this folder says what the figures mean. Nothing in here judges: tests have no clock,
and benchmarks have no bounds.
"""
