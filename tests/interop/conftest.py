"""The vehicles that clients are tried on, each behind a daemon of its own; and the browser that pages are seen in."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchmarks.record.browser import chromium, open_browser
from tests.interop.builtin_vehicles import COPTER, PLANE, sitl
from tests.interop.served import Served, serve, standin

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A real browser, or the test is skipped."""
    if chromium() is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    with open_browser() as opened:
        yield opened


@pytest.fixture
def sim_speed() -> float:
    """Sim time to wall time. Clients count their time-outs by wall time, autopilots by their own."""
    return 5.0


@contextlib.asynccontextmanager
async def _autopilot(
    kind: str, request: pytest.FixtureRequest, directory: Path, speed: float
) -> AsyncIterator[int]:
    if kind == "standin":
        async with standin(speed) as port:
            yield port
    else:
        binary = request.getfixturevalue("arducopter" if kind == "copter" else "arduplane")
        model, parameters = ("quad", COPTER) if kind == "copter" else ("plane", PLANE)
        async with sitl(binary, model, parameters, directory, speed) as port:
            yield port


REAL = [pytest.param(kind, marks=pytest.mark.ardupilot) for kind in ("copter", "plane")]


@pytest.fixture(params=["standin", *REAL])
async def served(request: pytest.FixtureRequest, tmp_path: Path, sim_speed: float) -> AsyncIterator[Served]:
    """The stand-in, ArduCopter and ArduPlane, ready to arm, behind a daemon with a TCP and a UDP port."""
    async with (
        _autopilot(request.param, request, tmp_path, sim_speed) as port,
        serve(request.param, port) as served,
    ):
        yield served
