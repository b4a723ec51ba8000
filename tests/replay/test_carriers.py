"""What is no car is not taken for one, and its radius is true all the same."""

import numpy as np
import pytest
from benchmarks.carriers import CARRIERS
from benchmarks.consistency import Drive, pooled, run

AUTO = ["filter.profile=auto"]


def tracked(name: str) -> Drive:
    """Five minutes, half a minute and a minute of them in the dark."""
    return run(2000, 320.0, CARRIERS[name], AUTO)


@pytest.mark.parametrize(
    ("name", "profile"),
    [("aeroplane", "free"), ("bicycle", "free"), ("walker, pocket", "walker")],
)
def test_what_carries_the_box_is_found_out(name: str, profile: str) -> None:
    drive = tracked(name)
    assert drive.profile == profile
    error_m, r95_m = pooled([drive], is_dark=True)
    assert np.mean(error_m <= r95_m) > 0.9
    assert drive.answered > 0.99
