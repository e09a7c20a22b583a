"""What comes for a script beside a run is given to it at the tick at which the agent on board got it."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from bridge.agents.beside import FreeOutlet, _TicksOnBus
from bridge.agents.client import UaClient
from bridge.agents.radio import QueueState, UnicastReply
from bridge.agents.running.feed import Arrivals
from bridge.bus.keys import Keys
from bridge.bus.messages import (
    AircraftState,
    Clock,
    CommandEvent,
    CommandGoal,
    Header,
    Message,
    RadioStatus,
    encode,
)
from bridge.bus.reception import attachment
from bridge.bus.session import Stamp

KEYS = Keys("r")
TICK_NS = 50_000_000


class Bus:
    """A session to which samples are given by hand."""

    def __init__(self) -> None:
        self.heard: dict[str, Callable[[Any], object]] = {}

    def subscribe(self, key: str, callback: Callable[[Any], object]) -> None:
        self.heard[key] = callback

    def watch_alive(self, key: str, callback: Callable[[str, bool], object]) -> None:
        """Nobody leaves here."""

    def put(self, key: str, message: Message) -> None:
        self._give(key, key, encode(message), None)

    def packet(self, seq: int, sim_time_ns: int) -> None:
        told = attachment(Stamp(seq, sim_time_ns).to_bytes(), -80.0, 10.0)
        self._give(KEYS.rx("1", "*", "*"), KEYS.rx("1", "0", "team"), b"x", told)

    def _give(self, subscribed: str, key: str, payload: bytes, told: bytes | None) -> None:
        attached = None if told is None else SimpleNamespace(to_bytes=lambda: told)
        brought = SimpleNamespace(to_bytes=lambda: payload)
        if subscribed in self.heard:
            self.heard[subscribed](SimpleNamespace(key_expr=key, payload=brought, attachment=attached))


@pytest.mark.parametrize(
    "order",
    [
        "clock answer packet release",
        "clock packet answer release",
        "clock packet release answer",
        "answer clock packet release",
        "clock before answer packet",
        "clock answer before packet",
    ],
)
def test_packets_come_a_tick_later_whichever_process_is_heard_first(order: str) -> None:
    """``before``: the release of the tick before."""
    bus, came = Bus(), []
    ua = UaClient("1", SimpleNamespace())  # type: ignore[arg-type]
    ua.on_packet(lambda _sender, _channel, _payload, told: came.append((told.seq, told.age_s)))
    at_once = SimpleNamespace(push=lambda handle: handle())
    _TicksOnBus(bus, KEYS, ua, at_once, Arrivals())  # type: ignore[arg-type]
    bus.put(KEYS.answer("1"), Header.at(0, "1"))
    bus.put(KEYS.clock_release, Header.at(0, ""))
    for tick in range(1, 5):
        for name in order.split():
            put(bus, name, tick)
    assert came == [(1, 0.05), (2, 0.05), (3, 0.05)]


def test_queues_and_replies_come_with_the_packets_of_their_tick_and_before_them() -> None:
    bus, came = Bus(), []
    ua = UaClient("1", SimpleNamespace())  # type: ignore[arg-type]
    at_once = SimpleNamespace(push=lambda handle: handle())
    _TicksOnBus(bus, KEYS, ua, at_once, Arrivals())  # type: ignore[arg-type]
    bus.put(KEYS.answer("1"), Header.at(0, "1"))
    ua.radio.on_reply(lambda reply: came.append((ua.sim_time_ns, reply)))
    ua.on_packet(lambda _sender, _channel, _payload, told: came.append((ua.sim_time_ns, told.seq)))
    ua.on_tick(lambda now_ns: came.append((now_ns, ua.radio.queue, ua.radio.replies)))
    status = RadioStatus(
        Header.at(TICK_NS, "1"), ("mesh", "main"), (4, 2), (40, 300), ("main",), (7,), (False,), (3,), (70,)
    )
    bus.packet(9, TICK_NS)
    bus.put(KEYS.radio_status("1"), status)
    for tick in (1, 2, 3):
        for name in ("clock", "release", "answer"):
            put(bus, name, tick)
    queue, reply = QueueState(2, 300), UnicastReply(7, False, 3, 70)
    assert came == [
        (TICK_NS, QueueState(), ()),
        (2 * TICK_NS, reply),
        (2 * TICK_NS, 9),
        (2 * TICK_NS, queue, (reply,)),
        (3 * TICK_NS, queue, ()),
    ]
    assert ua.radios["mesh"].queue == QueueState(4, 40)  # a program that knows no scenario learns of it here
    bus.put(KEYS.radio_status("1"), RadioStatus(Header.at(0, "1"), ("main",), (1, 2), (3, 4)))
    for name in ("release", "clock", "answer"):
        put(bus, name, 4)
    put(bus, "clock", 5)
    put(bus, "answer", 5)
    assert ua.malformed == 1


async def test_a_script_begins_once_it_has_the_state_of_its_node() -> None:
    bus, ua = Bus(), UaClient("1", SimpleNamespace())  # type: ignore[arg-type]
    at_once = SimpleNamespace(push=lambda handle: handle())
    ticks = _TicksOnBus(bus, KEYS, ua, at_once, Arrivals())  # type: ignore[arg-type]
    put(bus, "answer", 0)
    put(bus, "clock", 1)
    put(bus, "answer", 1)
    assert not ticks.has_begun.is_set()
    put(bus, "clock", 2)
    bus.put(KEYS.state("1"), AircraftState(Header.at(2 * TICK_NS, "1"), latitude_deg=40.0))
    assert not ticks.has_begun.is_set()
    put(bus, "answer", 2)
    assert ticks.has_begun.is_set()
    assert ua.told.latitude_deg == 40.0


def test_a_script_of_a_run_that_is_over_waits_for_nothing() -> None:
    bus, ua = Bus(), UaClient("1", SimpleNamespace())  # type: ignore[arg-type]
    at_once = SimpleNamespace(push=lambda handle: handle())
    ticks = _TicksOnBus(bus, KEYS, ua, at_once, Arrivals())  # type: ignore[arg-type]
    bus.put(KEYS.clock_end, Header.at(TICK_NS, ""))
    assert ticks.has_begun.is_set()


def test_a_program_that_has_left_is_given_nothing_of_what_waited() -> None:
    """Its session is closed: a callback that transmits would raise, and end the run by its name."""
    bus, ua = Bus(), UaClient("1", SimpleNamespace())  # type: ignore[arg-type]
    waiting: list[Callable[[], object]] = []
    ticks = _TicksOnBus(bus, KEYS, ua, SimpleNamespace(push=waiting.append), Arrivals())  # type: ignore[arg-type]
    came: list[int] = []
    ua.on_tick(came.append)
    for tick in (1, 2):
        put(bus, "clock", tick)
    waiting.pop(0)()
    ticks.leave()
    waiting.pop(0)()
    assert came == [TICK_NS]


def put(bus: Bus, name: str, tick: int) -> None:
    now_ns = tick * TICK_NS
    match name:
        case "clock":
            bus.put(KEYS.clock, Clock(Header.at(now_ns, "")))
        case "answer":
            bus.put(KEYS.answer("1"), Header.at(now_ns, "1"))
        case "packet":
            bus.packet(tick, now_ns)
        case "release":
            bus.put(KEYS.clock_release, Header.at(now_ns, ""))
        case "before":
            bus.put(KEYS.clock_release, Header.at(now_ns - TICK_NS, ""))


def test_a_command_that_does_not_exist_is_told_with_those_that_do() -> None:
    """Nobody serves its key: the script was told that nobody carried it out to the end."""
    events: list[CommandEvent | None] = []
    session = SimpleNamespace(interest=lambda _key: None)
    outlet = FreeOutlet(session, KEYS, "1", None, None)  # type: ignore[arg-type]
    outlet.command("flyy", CommandGoal(), events.append)
    assert events[0] is not None
    assert events[0].outcome == "refused"
    assert events[0].text.startswith("command 'flyy' is none of arm, disarm, mode, ")
