"""The map in a real browser: what a person sees and touches.

Skipped where there is no Chromium (Debian: `sudo apt install chromium`).
"""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from imu_tracker.exports.merging import Point
from imu_tracker.exports.page import html
from imu_tracker.storage.latlong import LogRow
from support.browser import CHROMIUM, Browser, browsing

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")

NOON_S = datetime(2026, 11, 22, 12, tzinfo=UTC).timestamp()
METRE_DEG = 1 / 111_195.0

Place = tuple[float, float]


def drive() -> Iterator[Point]:
    """North along a meridian at 10 m/s for 100 s, the second half without GPS."""
    for i in range(401):
        row = LogRow(
            utc_s=NOON_S + i / 4,
            lat_deg=52.0 + i * 2.5 * METRE_DEG,
            lon_deg=4.37,
            alt_m=float("nan"),
            speed_mps=10.0,
            course_deg=0.0,
            r95_m=4.0 if i < 200 else 4.0 + (i - 200) / 2,
            mode="gps" if i < 200 else "dr",
        )
        yield Point("drive <&> 1.csv", 0, row)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "map.html"
    path.write_text("".join(html(drive())), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browsing(tmp_path_factory.mktemp("home")) as browser:
        yield browser


@pytest.fixture
def browser(chromium: Browser, page: Path) -> Browser:
    """A browser that has just opened the page."""
    chromium.open(page)
    return chromium


def place(browser: Browser, point: int) -> Place:
    x, y = browser.ask(f"toScreen(points[{point}])")
    return x, y


def tip(browser: Browser) -> str:
    shown = "document.getElementById('tip').checkVisibility()"
    text = browser.ask(f"{shown} ? document.getElementById('tip').innerText : ''")
    assert isinstance(text, str)
    return text


def pixel(browser: Browser, at: Place) -> list[int]:
    x, y = at
    colour = browser.ask(f"[...pen.getImageData({x}, {y}, 1, 1).data].slice(0, 3)")
    assert isinstance(colour, list)
    return colour


def test_a_point_names_itself_when_hovered_over(browser: Browser) -> None:
    assert tip(browser) == ""
    x, y = place(browser, 300)
    browser.mouse("mouseMoved", x + 2, y)
    assert tip(browser).splitlines() == [
        "2026-11-22 12:01:15.000 UTC",
        "● dr: dead reckoning",
        "speed 10.00 m/s (36 km/h), course 0.0°",
        "r95 54.00 m",
        "52.0067449, 4.3700000",
    ]
    browser.mouse("mouseMoved", x + 200, y)
    assert tip(browser) == ""


def test_the_track_has_the_colours_of_its_modes_and_its_start_is_below(
    browser: Browser,
) -> None:
    assert pixel(browser, place(browser, 100)) == [0x00, 0x72, 0xB2]
    assert pixel(browser, place(browser, 300)) == [0xD5, 0x5E, 0x00]
    assert place(browser, 0)[1] > place(browser, 400)[1]  # north is up


def test_the_legend_says_what_the_colours_mean(browser: Browser) -> None:
    text = browser.ask("document.getElementById('legend').innerText")
    lines = [line.strip() for line in text.splitlines()]
    assert lines[:3] == [
        "drive <&> 1.csv",
        "2026-11-22 12:00 to 12:01 UTC",
        "401 rows",
    ]
    assert "with GPS (gps)" in lines
    assert "dead reckoning (dr)" in lines
    assert "standing still (still)" not in lines  # there is none


def test_the_scale_bar_is_as_long_as_it_says(browser: Browser) -> None:
    browser.ask("zoom(3)")
    browser.settle()
    text = browser.ask("document.getElementById('length').innerText")
    bar_px = browser.ask("document.querySelector('#scale span').clientWidth")
    metres = float(text.removesuffix(" m"))
    track_px = place(browser, 0)[1] - place(browser, 400)[1]
    assert bar_px / metres == pytest.approx(track_px / 1000.0, rel=0.03)


def test_a_circle_is_as_wide_as_its_radius_says(browser: Browser) -> None:
    x, y = place(browser, 400)
    browser.mouse("mouseMoved", x, y)  # its circle is drawn strongly
    r_px = 104.0 / 1000.0 * (place(browser, 0)[1] - y)
    paper = pixel(browser, (990, 690))
    assert pixel(browser, (x + r_px - 3, y)) != paper
    assert pixel(browser, (x + r_px + 3, y)) == paper


def test_the_mouse_pans_and_the_wheel_zooms_where_it_is(browser: Browser) -> None:
    x, y = place(browser, 200)
    browser.mouse("mouseMoved", 700, 400)
    browser.mouse("mousePressed", 700, 400, button="left", buttons=1, clickCount=1)
    browser.mouse("mouseMoved", 750, 430, button="left", buttons=1)
    browser.mouse("mouseReleased", 750, 430, button="left", clickCount=1)
    assert place(browser, 200) == pytest.approx((x + 50, y + 30), abs=1)
    before = place(browser, 0)[1] - place(browser, 400)[1]
    browser.mouse("mouseWheel", x + 50, y + 30, deltaX=0, deltaY=-400)
    assert place(browser, 200) == pytest.approx((x + 50, y + 30), abs=1)
    assert place(browser, 0)[1] - place(browser, 400)[1] > 1.5 * before
    browser.key("0")
    assert place(browser, 200) == pytest.approx((x, y), abs=1)


def test_the_arrow_keys_go_from_point_to_point(browser: Browser) -> None:
    browser.key("ArrowLeft")
    assert tip(browser).startswith("2026-11-22 12:01:40.000 UTC")
    browser.key("ArrowLeft")
    assert tip(browser).startswith("2026-11-22 12:01:39.750 UTC")
    browser.key("Escape")
    assert tip(browser) == ""


def test_a_finger_on_a_telephone_names_a_point_and_two_zoom(
    page: Path, chromium: Browser
) -> None:
    chromium.open(page, 390, 780, mobile=True)
    assert chromium.ask("document.documentElement.scrollWidth") <= 390
    x, y = place(chromium, 100)
    chromium.touch("touchStart", (x + 4, y))
    chromium.touch("touchEnd")
    assert tip(chromium).startswith("2026-11-22 12:00:25.000 UTC")
    before = place(chromium, 0)[1] - place(chromium, 400)[1]
    chromium.touch("touchStart", (195, 380), (195, 420))
    chromium.touch("touchMove", (195, 300), (195, 500))
    chromium.touch("touchEnd")
    after = place(chromium, 0)[1] - place(chromium, 400)[1]
    assert after == pytest.approx(5 * before, rel=0.05)


def test_the_page_loads_nothing_but_itself_and_complains_of_nothing(
    browser: Browser,
) -> None:
    browser.mouse("mouseMoved", *place(browser, 10))
    said = {event["method"]: event for event in browser.events}
    assert "Runtime.exceptionThrown" not in said
    assert "Log.entryAdded" not in said
    assert "Runtime.consoleAPICalled" not in said
    asked = [
        event["params"]["request"]["url"]
        for event in browser.events
        if event["method"] == "Network.requestWillBeSent"
    ]
    assert [url.partition(":")[0] for url in asked] == ["file"]


def test_a_track_over_the_180th_meridian_stays_in_one_piece(
    tmp_path: Path, chromium: Browser
) -> None:
    row = LogRow(NOON_S, 52.0, 0.0, 1.0, 1.0, 90.0, 4.0, "gps")
    degrees = [179.998, 179.999, -179.999, -179.998]
    path = tmp_path / "map.html"
    points = (
        Point("a", int(lon < 0), row._replace(utc_s=NOON_S + i / 4, lon_deg=lon))
        for i, lon in enumerate(degrees)
    )
    path.write_text("".join(html(points)), encoding="utf-8")
    chromium.open(path)
    xs = [place(chromium, i)[0] for i in range(4)]
    assert xs == sorted(xs)
    assert xs[3] - xs[0] == pytest.approx(4 * (xs[1] - xs[0]), rel=1e-3)


@pytest.mark.parametrize("n", [0, 1])
def test_a_map_of_next_to_nothing_opens(
    n: int, tmp_path: Path, chromium: Browser
) -> None:
    path = tmp_path / "map.html"
    path.write_text("".join(html(list(drive())[:n])), encoding="utf-8")
    chromium.open(path)
    text = chromium.ask("document.getElementById('legend').innerText")
    assert ("no rows" in text) is (n == 0)
    seen = [event["method"] for event in chromium.events]
    assert "Runtime.exceptionThrown" not in seen
