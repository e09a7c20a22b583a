"""What ground stations show, in Chromium: plan and messages of the chosen UA, click-to-go. Skipped without it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

pytest.importorskip("playwright")

from playwright.sync_api import Browser, expect

from tests.integration.bridge.clients.view import serving
from tests.integration.bridge.conftest import StartRun, start_run  # noqa: F401
from tests.interop.browser.test_view_browser import held, opened
from tests.interop.browser.view_page import ViewPage
from tests.interop.surveyor import AGENT, SCENARIO
from tests.warm import run_lostlink

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
expect.set_options(timeout=120_000)
HOME = (0, 0)
WAYPOINTS = {2: (600, 0), 3: (600, 800), 4: (1000, 800), 5: (1000, 0)}
"""dm north and east of the origin, as the agent has them in metres."""


def items(seen: ViewPage) -> dict[int, tuple[int, ...]]:
    """Number and place of each item that the map draws, dm."""
    return {item["number"]: tuple(item["at"][:2]) for item in seen.words()["plan"].get("items", [])}


def shows_all(seen: ViewPage) -> None:
    """The map has the agent's mission, fence and rally points; places are good to 1e-7 degrees, a centimetre."""
    seen.wait("the mission", lambda: items(seen) == {1: HOME, **WAYPOINTS, 6: HOME})
    seen.wait("fence and rally points", lambda: len(seen.words()["plan"]["rally"]) == 2)
    plan = seen.words()["plan"]
    assert plan["fence"] == [
        {"inside": True, "polygon": [-400, -600, 1500, -600, 1500, 1400, -400, 950]},
        {"inside": False, "polygon": [200, 300, 450, 300, 450, 600]},
        {"inside": False, "circle": [800, 400, 120]},
        {"inside": True, "circle": [500, 400, 1300]},
    ]
    assert [place[:2] for place in plan["rally"]] == [[0, 1100], [1300, -300]]


@pytest.mark.long
def test_a_run_whose_plan_is_looked_at_is_the_same_run(
    browser: Browser,
    start_run: StartRun,  # noqa: F811
    tmp_path: Path,
) -> None:
    (tmp_path / "surveyor.py").write_text(AGENT)
    alone = start_run("--digest", scenario=SCENARIO, duration_s=30.0)
    assert alone.finish() == 0, alone.output.decode()
    run = start_run("--digest", "--view", "--view-port", "0", scenario=SCENARIO, speed="2", duration_s=30.0)
    with held(run):
        seen = opened(browser, run)
        expect(seen.page.get_by_role("status")).to_have_text("paused")
        seen.choose("UA 1")
    shows_all(seen)
    seen.wait("on its way", lambda: seen.words()["plan"]["current"] == 2)
    seen.open("Messages")
    expect(seen.page.get_by_role("cell", name="Flight plan received")).to_be_visible()
    expect(seen.page.get_by_role("status")).to_have_text("over")
    assert not seen.errors
    seen.page.close()
    assert run.finish() == 0, run.output.decode()
    assert run.summary["digest"] == alone.summary["digest"]
    assert run.summary["may_not_repeat"] == []
    with serving(run.directory) as view:
        replayed(ViewPage(browser, view.address))


def replayed(seen: ViewPage) -> None:
    """The record shows what was there at each instant."""
    page = seen.page
    page.get_by_role("button", name="Pause").click()
    seen.choose("UA 1")
    page.get_by_role("slider", name="Sim time").focus()
    page.keyboard.press("End")
    shows_all(seen)
    seen.open("Plan")
    current = seen.words()["plan"]["current"]
    row = page.get_by_role("region", name="Mission, fence and rally points").get_by_role(
        "row", name="current"
    )
    expect(row.get_by_role("cell").first).to_have_text(str(current))
    seen.open("Messages")
    expect(page.get_by_role("cell", name="Flight plan received")).to_be_visible()
    page.get_by_role("slider", name="Sim time").focus()
    page.keyboard.press("Home")
    seen.wait("nothing yet", lambda: not items(seen))
    expect(page.get_by_role("cell", name="Flight plan received")).to_have_count(0)
    seen.open("Fleet")
    seen.choose("UA 0")
    page.get_by_role("slider", name="Sim time").focus()
    page.keyboard.press("End")
    seen.open("Messages")
    expect(page.get_by_role("cell", name="Arming motors")).to_be_visible()
    assert items(seen) == {}
    assert not seen.errors


def test_a_click_sends_the_ua_there_and_its_lists_are_read(
    browser: Browser,
    start_run: StartRun,  # noqa: F811
    tmp_path: Path,
) -> None:
    (tmp_path / "surveyor.py").write_text(AGENT)
    run = start_run(
        "--view", "--view-port", "0", "--control", scenario=SCENARIO, speed="4", duration_s=3600.0
    )
    seen = opened(browser, run)
    page, said = seen.page, seen.page.get_by_role("log")
    expect(said).to_contain_text("UA 0: is done")
    expect(said).to_contain_text("UA 1: waits until the autopilot is ready to arm")  # from the first tick on
    seen.choose("UA 0")
    expect(page.get_by_role("region", name="Details")).to_contain_text("its agent: is done")
    page.get_by_role("button", name="Go here").click()
    seen.wait("a place is asked for", lambda: seen.words()["aiming"])
    seen.canvas.focus()
    page.keyboard.press("Escape")
    seen.wait("no place is asked for", lambda: not seen.words()["aiming"])
    page.get_by_role("button", name="Go here").click()
    seen.wait("a place is asked for again", lambda: seen.words()["aiming"])
    seen.canvas.click(position={"x": 200, "y": 300})
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("m above home for UA 0?")
    expect(dialog).to_contain_text("Its agent: is done.")
    words = dialog.inner_text().split()
    north_m, east_m = float(words[words.index("north") - 2]), float(words[words.index("east,") - 2])
    page.get_by_role("button", name="Do it").click()
    expect(said).to_contain_text("UA 0: goto: done")
    first = seen.words()["nodes"][0]["place"]
    assert math.dist(first[:2], (north_m, east_m)) < 3.0
    assert first[2] == pytest.approx(15.0, abs=2.0)
    seen.wait("the target", lambda: seen.words()["plan"].get("target") is not None)
    target = seen.words()["plan"]["target"]
    assert math.dist(target, (10 * north_m, 10 * east_m)) < 2.0  # dm
    seen.open("Plan")
    expect(page.get_by_role("region", name="Details")).to_contain_text("mission: not transferred in this run")
    page.get_by_role("button", name="Read mission").click()
    expect(page.get_by_role("region", name="Details")).to_contain_text(
        "mission: none; fence: none; rally: none"
    )
    assert not seen.errors
    page.close()
    run.process.send_signal(2)
    assert run.finish(30.0) == 130
    inputs = [json.loads(line) for line in (run.directory / "inputs" / "0.jsonl").read_text().splitlines()]
    assert [item["verb"] for item in inputs] == ["goto", *["mission_download"] * 3]
    again = run_lostlink("refly", run.directory, "--out", tmp_path / "refly")
    assert again.returncode == 0, again.stderr
    assert "identical: truth, states, deliveries" in again.stdout
