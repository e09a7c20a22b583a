"""The page of a report in Chromium, light and dark. Skipped without a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest

pytest.importorskip("playwright")

from playwright.sync_api import Browser, Page, expect

from lostlink.reading.run import load_run
from lostlink.report.content import content_of
from lostlink.report.page.page import page_of
from lostlink.report.pictures.all import draw_all
from tests.unit.lostlink.replay.flown import flown, scenario_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    content = content_of(
        load_run(flown(folder / "made", scenario_of("moon2020", ("0", "1", "gcs")), ticks=200))
    )
    path = folder / "report.html"
    path.write_text(page_of(content, draw_all(content)), encoding="utf-8")
    return path


class Opened:
    """The page; what it asked for, and what went wrong in it."""

    def __init__(
        self, browser: Browser, file: Path, scheme: Literal["light", "dark"], width: int = 1100
    ) -> None:
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.page: Page = context.new_page()
        self.asked: list[str] = []
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("console", lambda text: self.errors.append(text.text))
        self.page.goto(file.as_uri())

    def colour(self, selector: str, name: str) -> str:
        """A colour as computed."""
        return str(self.page.locator(selector).first.evaluate(f"e => getComputedStyle(e).{name}"))


def brightness(colour: str) -> float:
    return sum(float(part) for part in colour[colour.index("(") + 1 : -1].split(",")[:3]) / 3


def test_it_is_whole_and_asks_for_nothing(browser: Browser, file: Path) -> None:
    opened = Opened(browser, file, "light")
    page = opened.page
    assert (opened.asked, opened.errors) == ([file.as_uri()], [])
    assert page.locator("svg[role=img]").count() == 9
    expect(page.get_by_role("img", name="Map of the ways of UA 0, UA 1, node gcs")).to_be_visible()
    expect(page.get_by_role("heading", name="Age of information and latency")).to_be_visible()
    expect(page.get_by_role("row", name="0 to 1").first).to_be_visible()
    page.get_by_text("Powers as a table").click()
    expect(page.get_by_role("columnheader", name="median")).to_be_visible()
    page.get_by_role("link", name="Events").click()
    expect(page.locator("#events")).to_be_in_viewport()


def test_text_and_pictures_follow_the_scheme(browser: Browser, file: Path) -> None:
    for scheme, is_light in (("light", True), ("dark", False)):
        opened = Opened(browser, file, scheme)  # type: ignore[arg-type]
        paper = brightness(opened.colour("body", "backgroundColor"))
        assert (paper > 200) == is_light
        for selector, name in (("p", "color"), ("svg[role=img] text", "fill"), ("th", "color")):
            assert abs(brightness(opened.colour(selector, name)) - paper) > 100, (scheme, selector)


@pytest.mark.parametrize("width", [1100, 360])
def test_nothing_is_wider_than_the_page(browser: Browser, file: Path, width: int) -> None:
    page = Opened(browser, file, "light", width).page
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for picture in page.locator("svg[role=img]").all():
        box = picture.bounding_box()
        assert box is not None
        assert 100 < box["width"] <= width


def test_on_paper_it_is_light(browser: Browser, file: Path) -> None:
    opened = Opened(browser, file, "dark")
    opened.page.emulate_media(media="print")
    assert brightness(opened.colour("body", "color")) < 100
    expect(opened.page.get_by_role("navigation")).to_be_hidden()


def test_tables_are_no_wider_than_paper(browser: Browser, file: Path) -> None:
    """A4 with the margins that browsers have is 718 pixels wide; what is wider makes all of it smaller."""
    opened = Opened(browser, file, "light", 718)
    opened.page.emulate_media(media="print")
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= 718
