"""What letters and numbers of NMEA say about a fix, and how sentences are weighed.

Sources: IEC 61162-1 (status, mode indicator, GGA quality), u-blox' interface
descriptions ("Position fix flags in NMEA"), and the receivers named beside a rule.
What a newcomer gets wrong: a status other than A and V is in use.
"""

from collections.abc import Mapping
from typing import Final

WITNESSES: Final = (
    # Of these each may deny a fix: where one says yes and another no, there is none.
    # u-blox: in every state of the receiver the four agree. Who mixes sources differs
    # (OpenCPN, issue 3452, arrives at the same rule).
    ("RMC", "GGA", "GNS", "GLL"),
    # Decides only where those say nothing: a blank status, a quality in words. It may
    # not deny what they say: multi-GNSS receivers send one for each constellation
    # (u-blox ZED-F9P, section 4.1.7), with 1 for those that are not in use.
    ("GSA",),
)
"""Who is asked about a fix, first to last; VTG, GST, GBS and ZDA say nothing of it."""


def weigh(verdicts: Mapping[str, bool]) -> set[bool]:
    """Return what the sentences of an epoch say about a fix; two if they differ.

    Parameters
    ----------
    verdicts : mapping
        By kind of sentence, whether any of that kind says that there is a fix.
    """
    for kinds in WITNESSES:
        if said := {verdicts[kind] for kind in kinds if kind in verdicts}:
            return said
    return set()


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
