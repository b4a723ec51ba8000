"""README and docs show what the benchmarks measured, not what somebody typed."""

import json
import re

import pytest
from benchmarks.figures import COMMANDS, KEPT, PAGES, filled

from support.paths import REPOSITORY

FIGURES = json.loads(KEPT.read_text("utf-8"))


@pytest.mark.parametrize("page", PAGES)
def test_a_page_shows_the_figures_that_are_kept(page: str) -> None:
    text = (REPOSITORY / page).read_text("utf-8")
    assert "<!-- figures: " in text
    assert filled(text, FIGURES) == text, (
        f"{page}: a table was edited by hand; run python -m benchmarks.figures"
    )


def test_every_figure_says_how_it_was_made() -> None:
    for name, figures in FIGURES.items():
        assert figures["command"] == f"python -m {COMMANDS[name]}"


def test_rows_are_chosen_in_their_order_and_get_their_titles() -> None:
    table = ["| drive | rms |", "| --- | --- |", "| b | 1 |", "| rtkexp_car | 2 |"]
    page = "<!-- figures: accuracy 1, rtkexp_car b -->\nold\n<!-- end of figures -->\n"
    new = filled(page, {"accuracy": {"tables": [table]}})
    assert re.findall(r"^\| (\w+)", new, re.MULTILINE) == ["drive", "car", "b"]
    assert "old" not in new
