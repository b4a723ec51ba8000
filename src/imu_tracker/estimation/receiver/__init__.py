"""What the receiver's fixes are worth, and when they hold.

In: `GpsFix` with arrival times. Out: instants in UTC, accepted or rejected fixes, signs
of a receiver that is late or spoofed. Not here: sentences (`sensors/gnss/`).
"""

__all__ = ["backlog", "fix_period", "gate", "innovations", "spoofing", "utc"]
