"""Exchanges whose PX4 is played by a process of its own (tests.px4_played): real TCP, real threads at rest."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fdm.clock.events import UaEvent
from fdm.clock.status import ClockStatus
from fdm.exchange.aircraft_spec import AircraftSpec, Px4Peer
from fdm.exchange.exchange import Exchange
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.px4_sensors import Px4Sensors
from fdm.wire.servo_packet import Fields
from tests.stepping import SteppingModel

ROOT = Path(__file__).parents[1]
HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0))


def spec(ua_id: int = 0, port: int = 0, airframe: str = "f450", wakes: tuple[int, ...] = ()) -> AircraftSpec:
    """A UA that PX4 flies."""
    peer = Px4Peer(Px4Sensors(), seed=1, wake_ports=wakes)
    return AircraftSpec(ua_id, load_airframe(airframe), HOME, port, px4=peer)


def play(port: int, silent: int, answers: int, how: str = "") -> subprocess.Popen[bytes]:
    """Start the player."""
    command = [sys.executable, "-m", "tests.px4_played", *map(str, (port, silent, answers)), how]
    return subprocess.Popen(command, cwd=ROOT)


@contextmanager
def played(port: int, silent: int, answers: int, how: str = "") -> Iterator[subprocess.Popen[bytes]]:
    """The player, killed at the end."""
    with play(port, silent, answers, how) as process:
        try:
            yield process
        finally:
            process.kill()


class Flight:
    """Runs an exchange in a thread up to a tick; `at_tick` may do something on the way, in that thread."""

    def __init__(
        self,
        specs: list[AircraftSpec],
        until_s: float,
        at_tick: Callable[[float], object] = lambda sim_s: None,
        **settings: Any,
    ) -> None:
        self.events: list[UaEvent] = []
        self.ticks: list[ClockStatus] = []
        self.driven: list[Fields] = []
        self.until_s, self.at_tick = until_s, at_tick
        self.error: BaseException | None = None
        self.exchange = Exchange(
            specs,
            on_tick=self._tick,
            on_event=self.events.append,
            build_model=lambda airframe, home: SteppingModel(self.driven),
            **{"speed": float("inf"), **settings},
        )

    def _tick(self, status: ClockStatus) -> None:
        self.ticks.append(status)
        self.at_tick(status.sim_time_ns / 1e9)
        if status.sim_time_ns >= self.until_s * 1e9:
            self.exchange.stop()

    def _run(self) -> None:
        try:
            self.exchange.run()
        except BaseException as error:
            self.error = error

    def start(self) -> threading.Thread:
        """Run in a thread."""
        thread = threading.Thread(target=self._run, daemon=True)
        thread.start()
        return thread

    def run(self, timeout_s: float = 60.0) -> dict[int, dict[str, int]]:
        """Run to the end; returns the counters.

        Raises:
            Exception: what the exchange raised.
        """
        thread = self.start()
        thread.join(timeout_s)
        self.exchange.stop()
        thread.join(timeout_s)
        assert not thread.is_alive(), "it does not stop"
        counters = {ua_id: self.exchange.counters(ua_id) for ua_id in self.exchange.ports}
        self.exchange.close()
        if self.error is not None:
            raise self.error
        return counters
