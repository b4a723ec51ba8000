"""Without a protection its test fails: each is taken out in turn."""

import pytest

from faults.protections import PROTECTIONS
from faults.removal import AnchorError, Protection, fails_without
from faults.table import FAULTS
from imu_tracker.storage.atomic import replace_file
from support.paths import REPOSITORY

CELLS = {f"[{fault.name}-{phase}]" for fault in FAULTS for phase in fault.phases}


@pytest.mark.acceptance
@pytest.mark.parametrize("protection", PROTECTIONS, ids=lambda p: p.protection)
def test_a_protection_that_is_taken_out_is_missed(protection: Protection) -> None:
    assert fails_without(protection) == ""


@pytest.mark.parametrize("protection", PROTECTIONS, ids=lambda p: p.protection)
def test_a_protection_is_where_it_is_said_to_be(protection: Protection) -> None:
    assert protection.removed()


@pytest.mark.parametrize("protection", PROTECTIONS, ids=lambda p: p.protection)
def test_the_test_of_a_protection_is_there(protection: Protection) -> None:
    file = protection.node.partition("::")[0]
    is_there = protection.test in CELLS or (REPOSITORY / file).is_file()
    assert is_there, (
        f"{protection.test} is neither a file nor a cell of the campaign: name the test"
        f" of {protection.protection!r} in tests/faults/protections.py"
    )


@pytest.mark.parametrize(
    ("line", "times"), [("os.fsync(fd)", "0"), ("path", "[2-9]"), ("if is_never", "0")]
)
def test_a_line_that_is_missing_or_ambiguous_is_an_error(line: str, times: str) -> None:
    nowhere = Protection("", "", replace_file, line, "pass", "")
    with pytest.raises(AnchorError, match=rf"atomic.replace_file has .* {times} times"):
        nowhere.removed()
