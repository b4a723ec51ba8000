"""Commands about the computer that it runs on: setup, hardware-report.

In: parsed arguments. Out: an exit code. Not here: what a Pi needs (`setup/`),
the measurements (`check/hardware`).
"""

__all__ = ["hardware_report", "setup"]
