"""The page in a real browser, and what must hold of it anywhere."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

from imu_tracker.config import load_config
from imu_tracker.report.collect import Tracked
from imu_tracker.report.findings import findings_of
from imu_tracker.report.page import html
from imu_tracker.samples import Source
from support import installations
from support.browser import CHROMIUM, Browser, browsing
from support.installations import Stream, half_dead, sound, without

NAME = "<b>drive</b> {{data}}.rec"


def page_of(stream: Stream) -> str:
    tracked = Tracked(NAME, load_config(None, []))
    for _ in tracked.rows(stream):
        pass
    collected = tracked.collected()
    return html(collected, findings_of(collected))


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    streams = {
        "cable": installations.bad_antenna_cable(tells_signals=True),
        "no GPS": without(sound(20.0), Source.GPS),
        "half dead": half_dead(sound(60.0), 30.0),
    }
    folder = tmp_path_factory.mktemp("pages")
    pages = {}
    for name, stream in streams.items():
        pages[name] = folder / f"{name}.html"
        pages[name].write_text(page_of(stream), encoding="utf-8")
    return pages


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    with browsing(tmp_path_factory.mktemp("home")) as browser:
        yield browser


CASES = ["cable", "no GPS", "half dead"]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("width", [360, 1400])
def test_it_asks_nothing_of_the_net_and_needs_no_sideways_scrolling(
    chromium: Browser, pages: dict[str, Path], case: str, width: int
) -> None:
    chromium.open(pages[case], width, 800, mobile=width < 500, dark=width < 500)
    chromium.settle()
    assert chromium.ask("document.documentElement.scrollWidth") <= width
    methods = [event["method"] for event in chromium.events]
    assert "Runtime.exceptionThrown" not in methods
    assert "Log.entryAdded" not in methods
    assert methods.count("Network.requestWillBeSent") == 1  # the page itself


def test_the_map_shows_the_track_and_the_page_scrolls_over_it(
    chromium: Browser, pages: dict[str, Path]
) -> None:
    chromium.open(pages["cable"], 1000, 700)
    chromium.settle()
    assert chromium.ask("points.length") > 100
    inside = (
        "points.every(p => { const [x, y] = toScreen(p); return isShown(x, y, 0); })"
    )
    assert chromium.ask(inside) is True
    k = chromium.ask("view.k")
    wheel = "new WheelEvent('wheel', {deltaY: 100, cancelable: true, bubbles: true"
    assert chromium.ask(f"canvas.dispatchEvent({wheel}}}))") is True
    assert chromium.ask("view.k") == k
    assert chromium.ask(f"canvas.dispatchEvent({wheel}, ctrlKey: true}}))") is False
    assert chromium.ask("view.k") < k


def test_light_and_dark_follow_the_system(
    chromium: Browser, pages: dict[str, Path]
) -> None:
    colours = []
    for dark in (False, True):
        chromium.open(pages["half dead"], dark=dark)
        style = "getComputedStyle(document.querySelector('section')).backgroundColor"
        colours.append(chromium.ask(style))
    assert colours[0] == "rgb(255, 255, 255)"
    assert colours[1] != colours[0]


def test_a_page_without_a_track_says_so_and_hides_the_map(
    chromium: Browser, pages: dict[str, Path]
) -> None:
    chromium.open(pages["no GPS"])
    assert chromium.ask("document.getElementById('frame').checkVisibility()") is False
    text = chromium.ask("document.querySelector('.findings').innerText")
    assert "The GPS receiver says nothing" in text


class _Checker(HTMLParser):
    """Notes what could reach out, and whether tags are closed."""

    VOID = frozenset({"meta", "link", "br"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "action")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take a shape of a chart, which closes itself."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_is_well_formed_and_names_no_address(pages: dict[str, Path]) -> None:
    for path in pages.values():
        text = path.read_text(encoding="utf-8")
        checker = _Checker()
        checker.feed(text)
        assert checker.open == []
        assert checker.addresses == ["data:,"]
        assert not re.search(r"https?://", text)


def test_a_name_cannot_put_markup_or_data_into_the_page(
    pages: dict[str, Path],
) -> None:
    text = pages["cable"].read_text(encoding="utf-8")
    assert "<h1>&lt;b&gt;drive&lt;/b&gt; {{data}}.rec</h1>" in text
    assert "<b>drive" not in text
