"""requirements-dev.txt: what pyproject.toml allows, by hash; `make lock` makes it."""

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from support.paths import REPOSITORY

PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text("utf-8"))["project"]
PINS = (REPOSITORY / "requirements-dev.txt").read_text("utf-8")
PINNED = dict(re.findall(r"^([\w.-]+)==([^\s\\]+)", PINS, re.MULTILINE))

RUN_TIME = [Requirement(text) for text in PROJECT["dependencies"]]
DEV = [Requirement(text) for text in PROJECT["optional-dependencies"]["dev"]]


@pytest.mark.parametrize("wanted", RUN_TIME, ids=lambda wanted: wanted.name)
def test_what_runs_on_the_pi_is_bounded_on_both_sides(wanted: Requirement) -> None:
    operators = {specifier.operator for specifier in wanted.specifier}
    assert operators == {">=", "<"}


@pytest.mark.parametrize("wanted", [*RUN_TIME, *DEV], ids=lambda wanted: wanted.name)
def test_each_dependency_is_pinned_within_its_bounds(wanted: Requirement) -> None:
    version = PINNED.get(canonicalize_name(wanted.name))
    assert version is not None, "make lock"
    assert wanted.specifier.contains(version), "make lock"


def test_each_pin_has_its_hashes_and_no_address_of_an_index() -> None:
    blocks = re.split(r"^(?=\w)", PINS, flags=re.MULTILINE)[1:]
    assert len(blocks) == len(PINNED)
    for block in blocks:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", block), block
    assert "://" not in PINS
    assert "index" not in PINS
