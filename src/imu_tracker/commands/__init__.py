"""The commands: one file each, `add_x` for its arguments and `run_x` for its work.

The modules import nothing heavy at their top, so that `imu-tracker --help` is quick;
what a command needs it imports when it runs.
"""
