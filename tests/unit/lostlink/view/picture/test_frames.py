"""PictureFrames for the map: what a browser makes of them is what the view knows."""

from __future__ import annotations

import json
from typing import Any

from benchmarks.fifty_ua import fifty, messages_of
from lostlink.view.picture.frames import PictureFrames
from lostlink.view.picture.whole import UNKNOWN
from tests.unit.lostlink.view.fleet import clock, fates, links, truths, view_of_two


class Browser:
    """Keeps what the page's script keeps (`scene.js`)."""

    def __init__(self) -> None:
        self.now: dict[str, Any] = {}
        self.trail: list[list[int]] = []
        self.links: list[int] = []
        self.quality: list[int] = []
        self.lost: list[int] = []

    def take(self, text: str) -> None:
        self.now = json.loads(text)
        trail = self.now.get("trail", [])
        self.trail = trail if self.now["type"] == "snapshot" else self.trail + trail
        self.links = self.now.get("links", self.links)
        self.quality = self.now.get("quality", self.quality)
        self.lost = self.now.get("lost", [])


def test_a_viewer_from_the_start_and_one_who_comes_later_see_the_same() -> None:
    view = view_of_two()
    frames = PictureFrames(view)
    early, late = Browser(), Browser()
    early.take(frames.snapshot())
    for tick in range(40):
        time_s = 0.1 * tick
        view.take(clock(time_s))
        view.take(truths(time_s, 10.0 * tick))
        if tick % 2:
            view.take(links(time_s, 10.0 * tick, 0.5, tick, tick))
        early.take(frames.frame())
        if tick == 20:
            late.take(frames.snapshot())
        elif tick > 20:
            late.take(json.dumps(early.now))
    for seen in (early, late):
        assert seen.now["time"] == 3.9
        assert seen.now["position"] == [3900, 20, -400, 0, 0, 0]
        assert seen.now["wind"] == [100, -200, 0, 0, 0, 0]
        assert seen.links == [0, 1]
        assert seen.quality == [50]
        assert [points[0] for points in seen.trail] == [0, 500, 1000, 1500, 2000, 2500, 3000, 3500]


def test_losses_are_in_one_frame_only() -> None:
    view = view_of_two()
    frames, browser = PictureFrames(view), Browser()
    view.take(fates(0.1, [(0, 1, 1), (0, 1, 1)]))
    browser.take(frames.frame())
    assert browser.lost == [0, 1, 2]
    browser.take(frames.frame())
    assert browser.lost == []


def test_what_is_not_known_is_marked() -> None:
    frames, browser = PictureFrames(view_of_two()), Browser()
    browser.take(frames.frame())
    assert browser.now["position"] == [UNKNOWN] * 6


def test_after_all_was_forgotten_a_snapshot_is_due() -> None:
    view = view_of_two()
    frames = PictureFrames(view)
    view.take(truths(0.0, 1.0))
    frames.frame()
    assert not frames.begins_anew()
    view.forget()
    assert frames.begins_anew()
    assert not frames.begins_anew()
    browser = Browser()
    browser.take(frames.snapshot())
    assert browser.trail == []


def test_a_frame_of_fifty_ua_is_small() -> None:
    view = fifty()
    frames = PictureFrames(view)
    for tick in range(3):
        for message in messages_of(tick):
            view.take(message)
        size = len(frames.frame())
    assert size < 20_000  # 10 a second: less than 200 kB/s
    assert len(frames.snapshot()) < 60_000
