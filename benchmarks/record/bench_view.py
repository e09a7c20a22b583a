"""What the live view draws and costs: fifty UA at ten updates a second, in a real browser without a graphics card.

A process of its own is fed with the messages of such a fleet as bytes, ten times a second, and serves the page.
Chromium draws by software. Drawn are frames in which the map was drawn anew: it moves between updates, too. Draw is
the shortest of forty drawings of the map, pixels and all: what a machine that is busy otherwise changes least. CPU is
that of the serving process, in percent of a core.

    python -m benchmarks.record.bench_view [--seconds 6] [--json]

Needs Chromium and Playwright.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import multiprocessing as mp
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from time import monotonic, sleep
from typing import Any

import psutil

from benchmarks.fifty_ua import TICK_NS, fifty, messages_of
from benchmarks.record.browser import open_browser
from bridge.bus.messages import decode, encode

WARM_UP_S = 3.0
VIEWS = (
    ("map, links of one UA", "Map", "links of the chosen node"),
    ("map", "Map", "all links"),
    ("3-D", "3-D", "all links"),
)
TABS = ("Fleet", "Link", "Losses", "Matrix")
COUNT = """async ([seconds, id]) => {
  const scene = getElement(id), gaps = [], drawnBefore = scene.total, begin = performance.now();
  let last = begin;
  while (last - begin < 1000 * seconds) {
    await new Promise(requestAnimationFrame);
    const now = performance.now();
    gaps.push(now - last); last = now;
  }
  const drawn = scene.total - drawnBefore;
  gaps.sort((a, b) => a - b);
  const draws = [];
  for (let i = 0; i < 40; i++) {
    const before = performance.now();
    scene.dirty = true; scene.draw(before); scene.g.getImageData(0, 0, 1, 1);
    draws.push(performance.now() - before);
  }
  draws.sort((a, b) => a - b);
  const took = (last - begin) / 1000;
  return {
    draw_ms: draws[0],
    drawn: drawn / took,
    frames: gaps.length / took,
    gap_ms: gaps[Math.floor(0.95 * gaps.length)],
  };
}"""


def feed(pipe: Connection) -> None:
    """Give what a fleet publishes, ten times a second, until the process is ended."""
    begin = monotonic()
    for tick in itertools.count():
        pipe.send([(type(message), encode(message)) for message in messages_of(tick)])
        sleep(max(0.0, begin + (tick + 1) * TICK_NS / 1e9 - monotonic()))


async def serve() -> None:
    """Serve the page of a fleet, until the process is ended."""
    import numpy as np

    from aps.api.guard import ApiConfig
    from lostlink.view.broadcast import Broadcast
    from lostlink.view.page.charts import ModelCurve
    from lostlink.view.page.page import Shown
    from lostlink.view.picture.frames import PictureFrames
    from lostlink.view.server import ViewServer

    view = fifty()
    ours, theirs = mp.Pipe(duplex=False)
    mp.get_context("spawn").Process(target=feed, args=(theirs,), daemon=True).start()

    def take() -> None:
        for cls, payload in ours.recv():
            view.take(decode(payload, cls))

    asyncio.get_running_loop().add_reader(ours.fileno(), take)
    shown = Shown("fifty", view, lambda *_: ModelCurve(np.empty(0), np.empty(0)))
    async with ViewServer(shown, Broadcast(PictureFrames(view), lambda _: None), ApiConfig()) as server:
        print(f"http://127.0.0.1:{server.port}/", flush=True)
        await asyncio.Event().wait()


@contextmanager
def served() -> Iterator[tuple[str, psutil.Process]]:
    """The page's address, and its process."""
    command = [sys.executable, "-m", "benchmarks.record.bench_view", "--serve"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip(), psutil.Process(process.pid)
        finally:
            for child in psutil.Process(process.pid).children(recursive=True):
                child.terminate()
            process.terminate()


def measure(seconds: float) -> list[dict[str, Any]]:
    """A row per thing to look at."""
    rows = []
    with served() as (address, process), open_browser() as browser:
        page = browser.new_page(viewport={"width": 1440, "height": 860})
        page.set_default_timeout(120_000)
        page.goto(address)
        page.get_by_role("button", name="UA 7", exact=True).click()
        scene = page.locator("canvas[role=application]")
        number = int((scene.get_attribute("id") or "c0")[1:])
        page.wait_for_timeout(1000 * WARM_UP_S)

        def row(what: str) -> None:
            process.cpu_percent()
            found: dict[str, Any] = page.evaluate(COUNT, [seconds, number])
            rows.append(
                {
                    "what": what,
                    **found,
                    "cpu": process.cpu_percent(),
                    "rss_mb": process.memory_info().rss / 1e6,
                }
            )

        for what, kind, links in VIEWS:
            page.get_by_role("button", name=kind, exact=True).click()
            page.get_by_role("combobox", name="Links").click()
            page.get_by_role("option", name=links).click()
            row(what)
        for tab in TABS[1:]:
            page.get_by_role("tab", name=tab).click()
            row(f"3-D, beside {tab}")
    return rows


def main(argv: list[str] | None = None) -> list[dict[str, Any]]:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.serve:
        asyncio.run(serve())
        return []
    rows = measure(options.seconds)
    if options.json:
        print(json.dumps(rows))
        return rows
    print(f"{'':26}{'drawn/s':>9}{'frames/s':>10}{'draw, ms':>10}{'95 % gap, ms':>14}{'CPU, %':>8}{'MB':>6}")
    for r in rows:
        print(
            f"{r['what']:26}{r['drawn']:9.1f}{r['frames']:10.1f}{r['draw_ms']:10.1f}{r['gap_ms']:14.0f}{r['cpu']:8.0f}{r['rss_mb']:6.0f}"
        )
    return rows


if __name__ == "__main__":
    main()
