"""What letters and numbers of NMEA say about a fix: one table of rules.

Sources: IEC 61162-1 (status, mode indicator, GGA quality) and the receivers named
beside a rule. What a newcomer gets wrong: a status other than A and V is in use.
"""

from typing import Final

QUALITY_OF_MODE: Final = {"R": 4, "F": 5, "P": 3, "D": 2, "A": 1}  # best first
HAS_FIX_BY_STATUS: Final = {
    "A": True,  # IEC 61162-1: valid
    "V": False,  # IEC 61162-1: navigation receiver warning
    # Receivers that put their mode letter here once corrections arrive: Unicore
    # sends D (QField, issue 5151); the others are the same letters of IEC 61162-1.
    **dict.fromkeys("DPRF", True),
}
"""What RMC and GLL say by their status; a blank or unknown letter says nothing, and
leaves the verdict to the other sentences of the epoch."""

NOT_MEASURED: Final = frozenset("NEMS")
"""Modes: none, estimated, manual, simulator. The receiver's own dead reckoning is
no measurement: its error grows unsaid, and we have an IMU to do it better."""
NOT_MEASURED_QUALITY: Final = frozenset("0678")  # the same in the numbers of GGA


def has_fix_by_status(status: str, mode: str) -> bool | None:
    """Judge by status and mode of RMC or GLL; None when the status says nothing."""
    if mode in NOT_MEASURED:
        return False
    return HAS_FIX_BY_STATUS.get(status)


def quality_by_status(status: str, mode: str) -> int | None:
    """Read the kind of solution from the mode, else from a status that names one."""
    letter = mode or ("" if status == "A" else status)
    return QUALITY_OF_MODE.get(letter)
