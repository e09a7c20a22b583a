"""The page of the live view in a real browser, as a person meets it; and what its map says it draws."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic
from typing import Any, cast
from urllib.parse import urlsplit

from playwright.sync_api import Browser, Error, Page, expect


class ViewPage:
    """A page that is open; whatever it asks for, and whatever goes wrong in it, is written down."""

    def __init__(self, browser: Browser, address: str, scheme: str = "light") -> None:
        context = browser.new_context(
            viewport={"width": 1440, "height": 860}, color_scheme=cast("Any", scheme)
        )
        self.page: Page = context.new_page()
        self.page.set_default_timeout(120_000)
        self.hosts: set[str] = set()
        self.errors: list[str] = []
        self.page.on(
            "request", lambda request: self.hosts.add(urlsplit(request.url).hostname or request.url[:5])
        )
        self.page.on("websocket", lambda socket: self.hosts.add(urlsplit(socket.url).hostname or ""))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda text: self.errors.append(text.text) if text.type == "error" else None)
        try:
            self.page.goto(address)
        except Error:  # a page that is left open would load again by itself, and be one that looks
            context.close()
            raise
        self.canvas = self.page.get_by_role("application")

    def words(self) -> dict[str, Any]:
        """What the map draws."""
        number = (self.canvas.get_attribute("id") or "")[1:]
        return cast("dict[str, Any]", self.page.evaluate(f"getElement({number}).words()"))

    def link(self, tx: str, rx: str) -> dict[str, Any]:
        """One directed link as drawn."""
        return next(link for link in self.words()["links"] if (link["tx"], link["rx"]) == (tx, rx))

    def wait(self, what: str, is_so: Callable[[], bool], timeout_s: float = 120.0) -> None:
        """Look again and again until something is so."""
        deadline = monotonic() + timeout_s
        while not is_so():
            assert monotonic() < deadline, f"{what}: not within {timeout_s} s; the map draws {self.words()}"
            self.page.wait_for_timeout(100)

    def choose(self, node: str) -> None:
        """Choose a node in the table; once more if the page, busy with other tests beside, misses the click."""
        named = self.page.get_by_role("button", name=node)
        named.click()
        try:
            expect(named).to_have_attribute("aria-pressed", "true", timeout=30_000)
        except AssertionError:
            named.click()
        expect(named).to_have_attribute("aria-pressed", "true")

    def open(self, tab: str) -> None:
        """Choose a tab."""
        self.page.get_by_role("tab", name=tab).click()

    def chart(self, label: str) -> dict[str, list[list[Any]]]:
        """The data of a chart's series by name, as ECharts has them."""
        chart = self.page.get_by_role("img", name=label)
        number = (chart.get_attribute("id") or "")[1:]
        series = self.page.evaluate(
            f"getElement({number}).chart.getOption().series.map((s) => [s.name, s.data])"
        )
        return dict(series)

    def pixel(self, x: float, y: float) -> tuple[int, ...]:
        """The colour that the map has at a place, in pixels of the page."""
        number = (self.canvas.get_attribute("id") or "")[1:]
        rgba = self.page.evaluate(f"Array.from(getElement({number}).g.getImageData({x}, {y}, 1, 1).data)")
        return tuple(rgba[:3])

    def pixels(self) -> int:
        """How many pixels of the map have the colour in which it draws what UA 1 logs."""
        number = (self.canvas.get_attribute("id") or "")[1:]
        script = f"""() => {{
            const g = getElement({number}).g, {{ width, height }} = g.canvas;
            const data = g.getImageData(0, 0, width, height).data, is = (i) => data[i] === 217 && data[i + 1] === 95;
            let found = 0;
            for (let i = 0; i < data.length; i += 4) found += is(i);
            return found;
        }}"""
        return int(self.page.evaluate(script))
