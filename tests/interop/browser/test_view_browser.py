"""The live view in Chromium: a record, a running simulation, commands, fifty UA. Skipped without a browser."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import pytest

pytest.importorskip("playwright")

from playwright.sync_api import Browser, Error, Locator, Page, expect
from websockets.sync.client import connect

from benchmarks.record.browser import chromium
from bridge.bus.keys import Keys
from bridge.record.logged import LoggedValue
from lostlink.view.broadcast import VIEWERS_MAX
from tests.integration.bridge.clients.test_view import address_of
from tests.integration.bridge.clients.view import serving
from tests.integration.bridge.conftest import Run, StartRun, start_run  # noqa: F401
from tests.interop.browser.view_page import ViewPage
from tests.unit.lostlink.replay.flown import Said, Sent, everybody, flown, rails, scenario_of

OUT = """\
schema: 1
name: out
seed: 1
speed: {speed}
duration_s: {duration_s}
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
radio: moon2020
ports: {{zenoh: 0, first_slot: {slot}}}
nodes:
  - {{id: 0, agent: {{type: hold, altitude_m: 20}}}}
  - {{id: 1, home: {{north_m: 5}}, agent: {{type: out_and_back, altitude_m: 20, distance_m: 600, speed_mps: {mps}}}}}
"""
FAST, SLOW = OUT.replace("{mps}", "15"), OUT.replace("{mps}", "1")
"""UA 1 is back after 100 s, and after twenty minutes."""
expect.set_options(timeout=120_000)
BLUE, RED = "#2069b8", "#c62828"
"""Links on which everything arrives, and nothing."""


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(
        tmp_path_factory.mktemp("runs") / "made", scenario_of("moon2020", ("0", "1", "gcs")), ticks=300
    )


def paused(page: Page) -> Locator:
    """Pause a record; returns its slider."""
    page.get_by_role("button", name="Pause").click()
    expect(page.get_by_role("status")).to_have_text("record, paused")
    return page.get_by_role("slider", name="Sim time")


@pytest.mark.slow
def test_a_record_is_seen_as_it_was(browser: Browser, record: Path) -> None:
    with serving(record) as view:
        seen = ViewPage(browser, view.address)
        page = seen.page
        slider = paused(page)
        slider.focus()
        before = seen.words()["time"]
        page.keyboard.press("PageUp")
        seen.wait("a later instant", lambda: seen.words()["time"] > before)
        seen.wait("all where they were then", lambda: is_on_rails(seen.words()))
        page.get_by_role("button", name="UA 1").click()
        expect(page.get_by_role("button", name="UA 1")).to_have_attribute("aria-pressed", "true")
        seen.canvas.focus()
        page.keyboard.press("t")
        assert seen.words()["elevation"] == pytest.approx(math.pi / 6)
        page.keyboard.press("m")
        assert seen.words()["elevation"] == pytest.approx(math.pi / 2)
        assert page.get_by_role("button", name="Return to launch").count() == 0
        assert page.evaluate("document.documentElement.scrollHeight") == 860  # all of it is in sight
        header = page.get_by_role("columnheader", name="heard by")
        panel = page.get_by_role("region", name="Details")
        assert right_of(header) <= right_of(panel)
        expect(panel).to_contain_text("UA 1: armed; battery")
        number = (seen.canvas.get_attribute("id") or "")[1:]
        feet = f"""() => {{
            const scene = getElement({number});
            for (const down of [2, 5, 8]) scene.now.position[down] = -30000;
            scene.trail = []; scene.before = scene.now; scene.look("3d");
            return scene.project([...scene.at(0).slice(0, 2), 0])[1] < scene.height;
        }}"""
        assert page.evaluate(feet)
        assert seen.hosts == {"127.0.0.1"}
        assert not seen.errors


@pytest.mark.slow
def test_a_map_says_that_nothing_comes_any_more(browser: Browser, record: Path) -> None:
    with serving(record) as view:
        seen = ViewPage(browser, view.address)
        seen.wait("a picture", lambda: seen.words()["time"] is not None)
        scene = f"getElement({(seen.canvas.get_attribute('id') or '')[1:]})"
        seen.page.evaluate(f"{scene}.socket.onmessage = null")
        seen.wait("a word", lambda: "what is seen is old" in seen.words()["notice"])
        seen.page.evaluate(f"{scene}.socket.close()")  # it connects anew
        seen.wait("the map", lambda: not seen.words()["notice"])


def right_of(place: Locator) -> float:
    """Where it ends, in pixels of the page."""
    box = place.bounding_box()
    assert box is not None
    return box["x"] + box["width"]


def is_on_rails(words: dict[str, Any]) -> bool:
    """Whether the map has everybody where the record was made to have them (it goes there smoothly)."""
    ways = [rails(number, words["time"]) for number in range(3)]
    places = [node["place"] or (math.inf,) * 3 for node in words["nodes"]]
    return all(math.dist(p, (n, e, -d)) < 0.3 for p, (n, e, d) in zip(places, ways, strict=True))


@pytest.mark.slow
def test_the_air_of_a_network_is_seen(browser: Browser, tmp_path: Path) -> None:
    """Two nodes that send 20 packets of 98 bytes a second each over 64 kb/s: 31.4 kb/s, frames and silence beside."""
    nodes = ("0", "1")
    run = flown(tmp_path / "made", scenario_of("telemetry-915", nodes), 200, everybody(nodes, 98))
    with serving(run) as view:
        seen = ViewPage(browser, view.address)
        page = seen.page
        page.get_by_role("button", name="Pause").click()
        page.get_by_role("slider", name="Sim time").focus()
        page.keyboard.press("End")
        seen.wait("the end", lambda: seen.words()["time"] == pytest.approx(9.95))
        seen.open("Air")
        table = page.get_by_role("region", name="Radio networks on which packets take time")
        expect(table.get_by_role("cell", name="main")).to_be_visible()
        label = "Use of the air of each radio network and delay on it"
        seen.wait("a chart", lambda: len(seen.chart(label).get("main: in use", [])) >= 8)
        chart = seen.chart(label)
        assert all(0.3 < use < 1.0 for _, use in chart["main: in use"][1:])
        assert all(0.0 < delay_s < 1.0 for _, delay_s in chart["main: delay"])
        assert not seen.errors


@pytest.mark.slow
def test_a_network_is_chosen(browser: Browser, tmp_path: Path) -> None:
    """On `main` everything arrives, on the other network nothing."""
    nodes = ("0", "1")
    scenario = scenario_of("perfect", nodes, extra="networks: {far: {preset: perfect, base_loss: 1.0}}\n")
    both = [Sent(node, radio=radio) for node in nodes for radio in ("main", "far")]
    with serving(flown(tmp_path / "made", scenario, 200, lambda _tick: both)) as view:
        seen = ViewPage(browser, view.address)
        page = seen.page
        page.get_by_role("button", name="Pause").click()
        page.get_by_role("slider", name="Sim time").focus()
        page.keyboard.press("End")
        seen.open("Link")
        expect(page.get_by_text("200 of 200 packets delivered")).to_be_visible()
        page.get_by_role("combobox", name="Radio network").click()
        page.get_by_role("option", name="far", exact=True).click()
        expect(page.get_by_text("; 0 of 200 packets delivered")).to_be_visible()
        seen.open("Losses")
        expect(page.get_by_role("region", name="Fates of packets")).to_contain_text("base loss")
        seen.open("Fleet")
        expect(page.get_by_role("cell", name="0/1", exact=True)).to_have_count(4)
        assert not seen.errors


@pytest.mark.slow
def test_the_fields_of_a_link_name_the_one_that_is_shown(browser: Browser, record: Path) -> None:
    with serving(record) as view:
        seen = ViewPage(browser, view.address)
        page = seen.page
        paused(page)
        seen.choose("node gcs")
        seen.open("Link")
        for tx, rx in (("node gcs", "UA 0"), ("UA 0", "node gcs")):
            expect(page.get_by_text(f"{tx} to {rx}: ")).to_be_visible()
            for field, node in (("from", tx), ("to", rx)):
                expect(page.locator(".q-select").filter(has_text=field)).to_contain_text(node)
            page.get_by_role("button", name="The other direction of the link").click()
        assert not seen.errors


@pytest.mark.slow
def test_the_buttons_of_a_large_fleet_are_in_sight(browser: Browser, tmp_path: Path) -> None:
    nodes = tuple(map(str, range(40)))
    with serving(flown(tmp_path / "made", scenario_of("perfect", nodes), 20)) as view:
        seen = ViewPage(browser, view.address)
        seen.choose("UA 39")
        expect(seen.page.get_by_role("columnheader", name="height m")).to_be_in_viewport()
        expect(seen.page.get_by_text("UA 39: armed; battery")).to_be_in_viewport()
        assert not seen.errors


@pytest.mark.slow
def test_who_has_to_wait_for_the_map_is_told(browser: Browser, record: Path) -> None:
    with serving(record) as view, ExitStack() as others:
        first, *_ = [
            others.enter_context(connect(f"ws://127.0.0.1:{view.port}/frames")) for _ in range(VIEWERS_MAX)
        ]
        seen = ViewPage(browser, view.address)
        seen.wait("a word", lambda: seen.words()["notice"] == "16 pages show the map already: this one waits")
        assert not seen.words()["nodes"]
        first.close()
        seen.wait("the map", lambda: len(seen.words()["nodes"]) == 3)
        assert not seen.words()["notice"]


@pytest.mark.slow
def test_the_page_opens_no_socket_elsewhere(browser: Browser, record: Path) -> None:
    script = """() => new Promise((told) => {
        document.addEventListener("securitypolicyviolation", (event) => told(event.violatedDirective));
        new WebSocket("ws://127.0.0.1:9/").onerror = () => setTimeout(() => told("it tried"), 500);
    })"""
    with serving(record) as view:
        seen = ViewPage(browser, view.address)
        seen.wait("the map", lambda: len(seen.words()["nodes"]) == 3)
        assert seen.page.evaluate(script) == "connect-src"


@pytest.mark.slow
def test_two_pages_show_the_same_speed(browser: Browser, record: Path) -> None:
    with serving(record) as view:
        pages = [ViewPage(browser, view.address).page for _ in range(2)]
        for page, speed in (pages[0], "0.2 x"), (pages[1], "1 x"), (pages[1], "0.5 x"):
            page.get_by_role("combobox", name="Speed").click()
            page.get_by_role("option", name=speed, exact=True).click()
            for each in pages:
                expect(each.get_by_role("group", name="Time").locator(".q-select")).to_contain_text(speed)
                expect(each.get_by_role("status")).to_have_text(f"record, played {speed}")


@pytest.mark.slow
def test_a_slider_that_is_held_stays_until_it_is_let_go(browser: Browser, record: Path) -> None:
    with serving(record) as view:
        seen = ViewPage(browser, view.address)
        page, slider = seen.page, seen.page.get_by_role("slider", name="Sim time")
        box = slider.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 8, box["y"] + box["height"] / 2)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] * 0.9, box["y"] + box["height"] / 2)
        there_s, told = float(slider.input_value()), page.get_by_text("s of sim time")
        for _ in range(2):  # twice it is told how far the record is meanwhile
            before = told.inner_text()
            expect(told).not_to_have_text(before)
        assert float(slider.input_value()) == there_s
        page.mouse.up()
        seen.wait("it is there", lambda: seen.words()["time"] >= there_s)


@pytest.mark.slow
def test_a_slider_that_was_put_back_moves_on(browser: Browser, record: Path) -> None:
    with serving(record) as view:
        seen = ViewPage(browser, view.address)
        page = seen.page
        slider = paused(page)
        seen.wait("it stands", lambda: float(slider.input_value()) == pytest.approx(seen.words()["time"]))
        before_s = float(slider.input_value())
        box = slider.bounding_box()
        assert box is not None
        x = box["x"] + 8 + (box["width"] - 16) * before_s / 14.95  # in the middle of what is dragged
        y = box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 60, y, steps=3)
        page.mouse.move(x, y, steps=3)
        page.mouse.up()
        assert float(slider.input_value()) == before_s
        page.get_by_role("button", name="Go on").click()
        seen.wait("it moves on", lambda: float(slider.input_value()) > before_s)


def mission(tick: int) -> list[Said]:
    """UA 1 estimates and plans once a second, from the first on."""
    if tick % 20 or not tick:
        return []
    estimate = {"north_m": 20.0, "east_m": 30.0, "covariance_m2": [400.0, 0.0, 100.0], "readings": tick}
    plan = {"north_m": [0.0, 100.0, 80.0], "east_m": [0.0, 50.0, 90.0]}
    bad = {"north_m": "<b>x</b>", "east_m": math.nan, "covariance_m2": [math.inf, 0.0, 1.0]}
    said = {"estimate.beacon": estimate, "plan": plan, "bad": bad}
    return [("1", LoggedValue(name, value)) for name, value in said.items()]  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_mission_is_seen(browser: Browser, tmp_path: Path) -> None:
    scenario = scenario_of("moon2020", ("0", "1"), emitters=("beacon",))
    with serving(flown(tmp_path / "made", scenario, ticks=200, log=mission)) as view:
        seen = ViewPage(browser, view.address)
        page = seen.page
        page.get_by_role("button", name="Pause").click()
        slider = page.get_by_role("slider", name="Sim time")
        slider.focus()
        page.keyboard.press("End")
        seen.wait("the end", lambda: seen.words()["time"] == pytest.approx(9.95))
        expect(page.get_by_role("region", name="Emitters").get_by_role("cell", name="433.92")).to_be_visible()
        words = seen.words()
        assert [emitter["id"] for emitter in words["emitters"]] == ["beacon"]
        north, east, down = rails(2, 9.95)
        assert words["emitters"][0]["place"] == pytest.approx([north, east, -down], abs=0.06)
        shapes = {shape["name"]: shape for shape in words["shapes"]}
        assert shapes["estimate.beacon"]["ellipse"] == [200, 300, 490, 245, 0]  # 2.448 times 20 m and 10 m
        assert shapes["plan"]["line"] == [0, 0, 1000, 500, 800, 900]
        assert set(shapes) == {"estimate.beacon", "plan"}
        seen.open("Logged")
        page.get_by_role("combobox", name="node").click()
        page.get_by_role("option", name="UA 1").click()
        row = page.get_by_role("region", name="Logged values").get_by_role("row", name="estimate.beacon")
        expect(row).to_contain_text("9.00")
        expect(row).to_contain_text("readings 180")
        expect(row).to_contain_text("ellipse, 95 %: 97.9 x 49.0 m")
        expect(page.get_by_role("region", name="Logged values")).to_contain_text("<b>x</b>")
        page.get_by_role("combobox", name="chart of").click()
        page.get_by_role("option", name="estimate.beacon: readings").click()
        label = "Logged number over sim time"
        points = [[second, 20 * second] for second in range(1, 10)]
        seen.wait("the chart", lambda: seen.chart(label).get("UA 1") == points)
        slider.press("Home")
        seen.wait("the beginning", lambda: not seen.chart(label).get("UA 1"))
        slider.press("End")
        seen.wait("the same chart", lambda: seen.chart(label).get("UA 1") == points)
        drawn = seen.pixels()
        page.get_by_role("checkbox", name="estimates, plans").click()
        seen.wait("no shapes, but UA 1 itself", lambda: 0 < seen.pixels() < drawn / 2)
        assert seen.hosts == {"127.0.0.1"}
        assert not seen.errors


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_buttons_are_read_and_show_that_they_have_the_focus(
    browser: Browser, record: Path, scheme: str
) -> None:
    with serving(record) as view:
        seen = ViewPage(browser, view.address, scheme)
        page = seen.page
        page.get_by_role("button", name="Show the whole fleet").focus()
        page.keyboard.press("Tab")
        zoom, chosen = (page.get_by_role("button", name=name, exact=True) for name in ("Zoom in", "Map"))
        expect(zoom).to_be_focused()
        expect(zoom).to_have_css("outline-style", "solid")
        blue, paper = {
            "light": ("rgb(31, 106, 165)", "rgb(255, 255, 255)"),
            "dark": ("rgb(111, 179, 232)", "rgb(18, 23, 28)"),
        }[scheme]
        expect(zoom).to_have_css("color", blue)
        expect(chosen).to_have_css("background-color", blue)
        expect(chosen).to_have_css("color", paper)


@pytest.mark.slow
def test_on_a_narrow_page_map_and_charts_are_no_higher_than_the_screen(
    browser: Browser, record: Path
) -> None:
    with serving(record) as view:
        seen = ViewPage(browser, view.address)
        seen.page.set_viewport_size({"width": 390, "height": 844})
        seen.page.wait_for_function("innerWidth === 390")
        seen.page.set_viewport_size({"width": 720, "height": 430})  # as a page of 1440 at 200 %
        seen.open("Link")
        for place in (seen.canvas, seen.page.get_by_role("img", name="Received power, SNR and delivery")):
            expect(place).to_be_visible()
            box = place.bounding_box()
            assert box is not None
            assert box["height"] < 430
        assert not seen.errors


@pytest.mark.slow
def test_tabs_of_a_narrow_page_do_not_cover_each_other(browser: Browser, record: Path) -> None:
    with serving(record) as view:
        seen = ViewPage(browser, view.address)
        seen.page.set_viewport_size({"width": 400, "height": 800})
        for tab in seen.page.get_by_role("tab").all():
            assert tab.evaluate("tab => tab.scrollWidth <= tab.clientWidth")
            assert right_of(tab) <= 400.0


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_light_and_dark(browser: Browser, record: Path) -> None:
    with serving(record) as view:
        for scheme, other, is_light in (("light", "dark", True), ("dark", "light", False)):
            seen = ViewPage(browser, view.address, scheme)
            seen.wait("nodes", lambda seen=seen: bool(seen.words()["nodes"]))  # type: ignore[misc]
            assert (sum(seen.pixel(3, 300)) > 600) == is_light
            seen.page.get_by_role("combobox", name="Colours").click()
            seen.page.get_by_role("option", name=other).click()
            seen.wait(other, lambda seen=seen, light=is_light: (sum(seen.pixel(3, 300)) > 600) != light)  # type: ignore[misc]


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_link_turns_as_ua_1_flies_out(browser: Browser, start_run: StartRun) -> None:  # noqa: F811
    run = start_run("--view", "--view-port", "0", scenario=FAST, speed="4", duration_s=90.0)
    with held(run):  # until the page is there, however long that takes
        seen = opened(browser, run)
        page = seen.page
        expect(page.get_by_role("status")).to_have_text("paused")
    seen.wait(
        "the fleet",
        lambda: all(node["place"] for node in seen.words()["nodes"]) and bool(seen.words()["links"]),
    )
    assert {node["id"] for node in seen.words()["nodes"]} == {"0", "1"}
    near = seen.link("0", "1")
    assert near["percent"] > 95
    assert near["colour"] == BLUE
    assert page.get_by_role("button", name="Return to launch").count() == 0
    assert page.get_by_role("button", name="Pause").count() == 0
    lost = 0

    def is_far() -> bool:
        nonlocal lost
        lost = max(lost, seen.words()["losses"])
        return distance_m(seen) > 480.0

    seen.wait("UA 1 far out", is_far)
    seen.wait("the link turns", lambda: seen.link("0", "1")["percent"] <= 5)
    assert seen.link("0", "1")["colour"] == RED
    assert lost >= 1
    seen.open("Link")
    label = "Received power, SNR and delivery of the link over sim time"
    seen.wait("a chart", lambda: len(seen.chart(label).get("measured", [])) > 50)
    chart = seen.chart(label)
    measured = [share for _, share in chart["measured"] if share is not None]
    assert measured[0] == 1.0
    assert measured[-1] <= 0.1
    powers = [power for _, power in chart["received power"] if power is not None]
    assert powers[-1] < powers[10] - 100.0  # moon2020 falls by 100 dB and more (Moon et al. 2020, fig. 4)
    seen.open("Delivery")
    label = "Probability of delivery against distance"
    seen.wait("a chart", lambda: bool(seen.chart(label).get("model")))
    for name in ("measured", "model"):
        points = seen.chart(label)[name]
        assert all(share > 0.9 for at_m, share in points if at_m < 300.0)
        assert all(share < 0.1 for at_m, share in points if at_m > 480.0)
        assert any(at_m > 480.0 for at_m, _ in points)
    seen.open("Losses")
    expect(page.get_by_role("cell", name="channel erasure")).to_be_visible()
    seen.open("Air")
    expect(page.get_by_text("the medium is ideal, where packets take no time")).to_be_visible()
    expect(page.get_by_role("img", name="Use of the air")).to_be_hidden()
    assert seen.hosts == {"127.0.0.1"}
    assert not seen.errors
    page.close()
    run.process.send_signal(2)
    assert run.finish(30.0) == 130


@contextmanager
def held(run: Run) -> Iterator[None]:
    """Hold the clock of a run from its first ticks on, as an operator does, and let it go."""
    run.wait_for("sim time")
    keys = Keys(run.directory.name)
    with run.join("operator") as session:
        assert [
            json.loads(r.ok.payload.to_bytes())["paused"]
            for r in session._inner.get(keys.clock_command("pause"))
        ]
        yield
        assert list(session._inner.get(keys.clock_command("resume")))


def opened(browser: Browser, run: Run) -> ViewPage:
    """The page of a run, once it is served."""
    address = address_of(run)
    deadline = monotonic() + 30.0
    while True:
        try:
            return ViewPage(browser, f"http://{address}/")
        except Error as error:  # it is not served yet
            if "ERR_CONNECTION_REFUSED" not in str(error) or monotonic() > deadline:
                raise


def distance_m(seen: ViewPage) -> float:
    """Between the two UA, as the map has them."""
    first, second = (node["place"] for node in seen.words()["nodes"])
    return math.dist(first, second)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_command_is_asked_about_given_and_recorded(browser: Browser, start_run: StartRun) -> None:  # noqa: F811
    run = start_run("--view", "--view-port", "0", "--control", scenario=SLOW, speed="4", duration_s=600.0)
    seen = opened(browser, run)
    page, said = seen.page, seen.page.get_by_role("log")
    expect(said).to_contain_text("UA 0: is done", timeout=120_000)
    page.get_by_role("button", name="UA 0").click()
    page.get_by_role("button", name="Return to launch").click()
    expect(page.get_by_role("dialog")).to_contain_text("interrupts what the node's agent does")
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("dialog")).to_have_count(0)
    page.get_by_role("button", name="Return to launch").click()
    expect(page.get_by_role("dialog")).to_contain_text("Return to launch for UA 0?")
    page.get_by_role("button", name="Do it").click()
    expect(said).to_contain_text("UA 0: rtl: accepted")
    expect(page.get_by_role("row", name="UA 0").get_by_role("cell", name="RTL")).to_be_visible()
    assert said.inner_text().count("rtl: asked") == 1
    radio = page.get_by_role("row", name="UA 0").get_by_role("cell", name="radio off")
    expect(radio).to_have_count(0)
    page.get_by_role("button", name="Radio off").click()
    expect(page.get_by_role("dialog")).to_contain_text("Radio off for UA 0?")
    expect(page.get_by_role("dialog")).to_contain_text("goes on and is not told")
    page.get_by_role("button", name="Do it").click()
    expect(said).to_contain_text("UA 0: radio: done (radio off)")
    expect(radio).to_be_visible()
    page.set_viewport_size({"width": 1280, "height": 600})
    assert said.locator("..").evaluate("box => box.scrollHeight > box.clientHeight")
    expect(said.get_by_text("UA 0: radio: done (radio off)")).to_be_in_viewport()
    page.set_viewport_size({"width": 1280, "height": 720})
    expect(page.get_by_role("button", name="Radio on")).to_be_visible()
    assert [node["radio"] for node in seen.words()["nodes"]] == ["off", "on"]
    page.get_by_role("button", name="Pause").click()
    expect(page.get_by_role("status")).to_have_text("paused")
    held_s = seen.words()["time"]
    page.get_by_role("button", name="One tick further").click()
    seen.wait("a tick", lambda: seen.words()["time"] == pytest.approx(held_s + 0.05))
    page.get_by_role("button", name="Go on").click()
    seen.wait("it goes on", lambda: seen.words()["time"] > held_s + 1.0)
    run.process.send_signal(2)
    expect(page.get_by_role("status")).to_have_text("over")
    for name in ("Pause", "One tick further", "Return to launch", "Take off", "Arm"):
        expect(page.get_by_role("button", name=name, exact=True)).to_be_disabled()
    assert not seen.errors
    page.close()
    assert run.finish(30.0) == 130
    inputs = [json.loads(line) for line in (run.directory / "inputs" / "0.jsonl").read_text().splitlines()]
    assert [item["verb"] for item in inputs] == ["rtl", "radio"]


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_ua_that_is_chosen_is_armed_and_takes_off(browser: Browser, start_run: StartRun) -> None:  # noqa: F811
    run = start_run("--view", "--view-port", "0", "--control", speed="4", duration_s=3600.0)
    seen = opened(browser, run)
    run.wait_for("sim time")
    seen.wait("the fleet", lambda: all(node["place"] for node in seen.words()["nodes"]))
    page, said = seen.page, seen.page.get_by_role("log")
    page.get_by_role("button", name="UA 1").click()
    expect(page.get_by_role("region", name="Details")).to_contain_text("UA 1: ready to arm; battery")
    page.get_by_role("combobox", name="mode").click()
    page.get_by_role("option", name="GUIDED").click()
    for button, verb in (("Set mode", "mode"), ("Arm", "arm"), ("Take off", "takeoff")):
        page.get_by_role("button", name=button, exact=True).click()
        page.get_by_role("button", name="Do it").click()
        expect(said).to_contain_text(f"UA 1: {verb}: done")
        expect(page.get_by_role("dialog")).to_have_count(0)
    height = page.get_by_role("row", name="UA 1").get_by_role("cell").nth(4)
    assert float(height.inner_text()) == pytest.approx(20.0, abs=2.0)
    assert not seen.errors


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_fifty_ua_at_ten_updates_a_second() -> None:
    if chromium() is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    command = [sys.executable, "-m", "benchmarks.record.bench_view", "--seconds", "2", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    assert [row["what"] for row in rows][:3] == ["map, links of one UA", "map", "3-D"]
    # drawn in 25 ms, a map can be drawn twenty times a second beside all else that a page does
    assert max(row["draw_ms"] for row in rows[:3]) < 25.0
    assert all(row["cpu"] < 50.0 for row in rows)
