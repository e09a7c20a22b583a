"""The view of a run as a program: joins it, serves the page, ends when the run is over and nobody looks."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from time import monotonic
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np

from aps.api.guard import ApiConfig
from bridge.agents.frames import Frames
from bridge.bus.identity.keyring import OBSERVERS
from bridge.bus.identity.roster import OPERATOR
from bridge.bus.session import is_listened_at
from bridge.run.access import Access, access_of, endpoint_of
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.flight import origin_of
from bridge.timeouts import START_S
from lostlink.reading.lengths import median_payload_bytes
from lostlink.replay.player import Player
from lostlink.view.background import Background
from lostlink.view.broadcast import Broadcast
from lostlink.view.page.charts import ModelCurve
from lostlink.view.page.page import Shown
from lostlink.view.picture.fleet_view import FleetView, view_of
from lostlink.view.picture.frames import PictureFrames
from lostlink.view.server import ViewServer
from lostlink.view.sources.live import LiveSource
from lostlink.view.sources.onboard import Onboards
from lostlink.view.sources.operator import Operator
from lostlink.view.sources.record import RecordSource
from lostlink.view.sources.routes import RoutesOfRun

if TYPE_CHECKING:
    from channel.link.radio import Radio

MODEL_STEP_M = 200.0
"""The model's curve is made anew when the fleet spreads by so much."""
MODEL_POINTS = 200
LOOK_AGAIN_S = 0.1
LINGER_S = 3.0
"""Nobody looks for so long after the end: nobody wants to."""


@dataclass(frozen=True, slots=True)
class ViewSettings:
    """Where the view is served, and what it may.

    Attributes:
        server: where, and who may come.
        control: whether viewers may command.
        announce: called with the address when it is served.
    """

    server: ApiConfig
    control: bool
    announce: Callable[[str], object]


async def wait_for_start(run: RunDirectory, stop: asyncio.Event, *, has_begun: bool) -> bool:
    """Wait until the run has written what it takes to join it, and its router listens; for at most START_S.

    Args:
        run: that is to be joined.
        stop: set if we are to stop.
        has_begun: it was going on already: if it does not, it was killed.

    Returns:
        Whether it can be joined: not if it was over before, however it ended, or if we are to stop.

    Raises:
        NoAccess: it has no router.
    """
    deadline = asyncio.get_running_loop().time() + START_S
    while not stop.is_set() and asyncio.get_running_loop().time() < deadline:
        if run.is_over or (has_begun and not run.is_live):
            return False
        with suppress(OSError, ValueError):
            if await asyncio.to_thread(is_listened_at, endpoint_of(run)):
                return True
        await asyncio.sleep(LOOK_AGAIN_S)
    return not stop.is_set()


async def view_live(run: RunDirectory, settings: ViewSettings, stop: asyncio.Event) -> None:
    """Show a running simulation until ``stop``, or until it is over and nobody looks any more.

    Raises:
        SessionError: it is over, or does not let us in.
        OSError: the port is taken.
        ViewDied: a part of the view did.
    """
    view = view_of(run.scenario, monotonic)
    source = LiveSource(Access(run.info.run, run.info.endpoint, OBSERVERS), view)
    operator = Operator(access_of(run.path, OPERATOR), view.tell) if settings.control else None
    viewers = _Viewers(source, partial(view.tell, ""))
    broadcast = Broadcast(PictureFrames(view), viewers.changed)
    frames, onboards = _frames(run.scenario), Onboards(run.path, lambda: view.sim_time_ns, view.tell)
    routes = _routes(run, view)
    shown = Shown(run.info.run, view, _curves(run.scenario), operator, operator, frames, onboards, routes.of)
    try:
        await source.open()
        if operator is not None:
            await operator.open()
        async with ViewServer(shown, broadcast, settings.server) as server:
            settings.announce(address_of(settings.server, server.port))
            server.background.start(source.read_logged(), "what agents log")
            server.background.start(onboards.run(), "what autopilots have on board")
            server.background.start(routes.run(), "routes")
            await _until_nobody_cares(server.background, source, viewers, stop)
    finally:
        await source.close()
        if operator is not None:
            await operator.close()


async def view_record(run: RunDirectory, settings: ViewSettings, stop: asyncio.Event) -> None:
    """Show a record until ``stop``.

    Raises:
        ValueError: it is none.
        OSError: it cannot be read, or the port is taken.
        ViewDied: a part of the view did.
    """
    player = await asyncio.to_thread(Player.open, run.path)
    view = view_of(player.record.scenario)
    view.duration_s = player.end_ns / 1e9
    source = RecordSource(player, view, monotonic)
    broadcast = Broadcast(PictureFrames(view), lambda _: None)
    frames, onboards = (
        _frames(player.record.scenario),
        Onboards(run.path, lambda: view.sim_time_ns, view.tell),
    )
    routes, curves = _routes(run, view), _curves(player.record.scenario)
    shown = Shown(run.path.name, view, curves, source, frames=frames, onboards=onboards, way=routes.of)
    async with ViewServer(shown, broadcast, settings.server) as server:
        server.background.start(source.run(), "the record")
        server.background.start(onboards.run(), "what autopilots have on board")
        server.background.start(routes.run(), "routes")
        settings.announce(address_of(settings.server, server.port))
        await server.background.until(stop)


def _routes(run: RunDirectory, view: FleetView) -> RoutesOfRun:
    """By which nodes packets come."""
    nodes = [node.id for node in view.nodes]
    return RoutesOfRun(run.path, nodes, lambda: view.sim_time_ns, partial(view.tell, ""))


def _frames(scenario: Scenario) -> Frames:
    """The fleet's frame."""
    return Frames(origin_of(scenario.origin))


async def _until_nobody_cares(
    background: Background, source: LiveSource, viewers: _Viewers, stop: asyncio.Event
) -> None:
    await background.until(stop, source.over)
    while not stop.is_set() and viewers.number:
        with suppress(TimeoutError):
            await asyncio.wait_for(background.until(stop), LINGER_S)


class _Viewers:
    """How many look; the source takes no more than they see."""

    def __init__(self, source: LiveSource, on_failure: Callable[[str], object]) -> None:
        self._source, self._on_failure = source, on_failure
        self.number = 0
        self._tasks: set[asyncio.Task[None]] = set()

    def changed(self, number: int) -> None:
        """Take the number of viewers."""
        self.number = number
        task = asyncio.create_task(self._look())
        self._tasks.add(task)
        task.add_done_callback(self._done)

    async def _look(self) -> None:
        await self._source.look(closely=self.number > 0)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None:
            self._on_failure(f"the map stands still: the run cannot be looked at closely: {task.exception()}")


def address_of(config: ApiConfig, port: int) -> str:
    """What a browser is given."""
    host = f"[{config.host}]" if ":" in config.host else config.host
    return f"http://{host}:{port}/" + (f"?token={quote(config.token, safe='')}" if config.token else "")


def _curves(scenario: Scenario) -> Callable[[str, float, Mapping[int, int]], ModelCurve]:
    """Makes curves of models by the name of the network."""
    models = {name: Model(scenario, name) for name in scenario.network_names}
    return lambda network, farthest_m, packets: models[network].curve(farthest_m, packets)


class Model:
    """The model's probability of delivery by distance on a network, if its nodes have one radio and that is enough.

    Args:
        scenario: of the run.
        network: one of its radio networks.
    """

    def __init__(self, scenario: Scenario, network: str) -> None:
        self._scenario, self._network = scenario, network
        self._farthest_m = 0.0
        self._curves: dict[int | None, ModelCurve] = {}
        """Up to that distance, by payload length: the median of two lengths changes now and then, and back."""

    @cached_property
    def _radio(self) -> Radio | None:
        # scipy takes its time, and few look at this chart
        from bridge.scenario.resolve.radio import common_radio_on
        from bridge.scenario.resolve.sensing import emitters_of

        return common_radio_on(self._scenario, self._network, emitters_of(self._scenario))

    def curve(self, farthest_m: float, packets: Mapping[int, int]) -> ModelCurve:
        """The curve up to a distance at least, for the median length of packets that are counted by length."""
        payload_bytes = None if self._radio is None else median_payload_bytes(self._radio, packets)
        if farthest_m > self._farthest_m:
            self._farthest_m = MODEL_STEP_M * (farthest_m // MODEL_STEP_M + 1)
            self._curves.clear()
        if payload_bytes not in self._curves:
            self._curves[payload_bytes] = self._make(payload_bytes)
        return self._curves[payload_bytes]

    def _make(self, payload_bytes: int | None) -> ModelCurve:
        from bridge.scenario.resolve.channel import fates_go_together
        from channel.own.methods import OwnModelError
        from channel.validity import OutsideValidityError

        distance_m = np.linspace(1.0, self._farthest_m, MODEL_POINTS)
        radio = self._radio
        shared = fates_go_together(self._scenario, self._network)
        if radio is not None and radio.is_by_distance:
            with suppress(OutsideValidityError, OwnModelError):
                probability = radio.probability_of_delivery(distance_m, payload_bytes)
                return ModelCurve(distance_m, probability, shared)
        return ModelCurve(np.empty(0), np.empty(0), shared)
