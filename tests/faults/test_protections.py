"""Without a protection its test fails: each is taken out in turn."""

import pytest

from faults.protections import PROTECTIONS, Protection, fails_without
from support.paths import REPOSITORY


@pytest.mark.acceptance
@pytest.mark.parametrize("protection", PROTECTIONS, ids=lambda p: p.protection)
def test_a_protection_that_is_taken_out_is_missed(protection: Protection) -> None:
    assert fails_without(protection) == ""


@pytest.mark.parametrize("protection", PROTECTIONS, ids=lambda p: p.protection)
def test_a_protection_is_where_it_is_said_to_be(protection: Protection) -> None:
    text = (REPOSITORY / "src" / "imu_tracker" / protection.file).read_text(
        encoding="utf-8"
    )
    assert text.count(protection.text) == 1
