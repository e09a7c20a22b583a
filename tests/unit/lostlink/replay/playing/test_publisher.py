"""What of a record is published: of what agents said and logged, that which somebody wants."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus, Header
from bridge.bus.session import Stamp
from bridge.record.logged import LoggedValue
from lostlink.replay.player import Player
from lostlink.replay.playing.pace import Pace
from lostlink.replay.playing.publisher import MomentPublisher
from tests.unit.lostlink.replay.flown import TICK_NS, Said, Sent, flown, scenario_of

KEYS = Keys("made")
REPORT = AgentStatus(Header.at(0, "0"), "leg 1")


class Wanting:
    """A session with subscribers to some keys: it keeps what is put."""

    def __init__(self, *wanted: str) -> None:
        self._wanted = wanted
        self.told: list[tuple[str, Any, Any]] = []

    def interest(self, key: str) -> Callable[[], bool]:
        return lambda: key in self._wanted

    def put(self, key: str, message: Any, **_: Any) -> None:
        if "/node/" in key:
            self.told.append((key, message, None))

    def put_bytes(self, key: str, payload: bytes, *, encoding: str, attachment: Any = None, **_: Any) -> None:
        is_json = encoding == "application/json"
        self.told.append((key, json.loads(payload) if is_json else encoding, attachment))


def said(tick: int) -> list[Said]:
    logged: list[Said] = [("1", LoggedValue("gap_m", math.nan)), ("0", LoggedValue("leg", tick))]
    return [*logged, ("0", REPORT)] if tick == 1 else []


@pytest.mark.parametrize(
    ("wanted", "told"),
    [
        ((), []),
        ((KEYS.agent("0"), KEYS.agent("1")), [(KEYS.agent("0"), REPORT, None)]),
        ((KEYS.logged("1", "*"),), [(KEYS.logged("1", "gap_m"), None, Stamp(-1, TICK_NS).to_bytes())]),
    ],
    ids=["nothing", "reports", "values"],
)
def test_what_agents_said_is_published_if_it_is_wanted(
    tmp_path: Path, wanted: tuple[str, ...], told: list[Any]
) -> None:
    player = Player.open(flown(tmp_path / "made", scenario_of("perfect", ("0", "1")), 3, log=said))
    session = Wanting(*wanted)
    publisher = MomentPublisher(session, KEYS, player.record.scenario)  # type: ignore[arg-type]
    for moment in player.moments():
        publisher.publish(moment, Pace(1.0, 0, 0.0))
    assert session.told == told


def test_keys_of_emitters_that_somebody_wants_do_no_harm(tmp_path: Path) -> None:
    """As of a subscriber to all: emitters have a place, and nothing else that a node has."""
    scenario = scenario_of("perfect", ("0", "1"), emitters=("beacon",))
    player = Player.open(flown(tmp_path / "made", scenario, 3, lambda _: [Sent("0")]))
    session = Wanting(
        *(key for node in ("1", "beacon") for key in (KEYS.rx(node, "*", "*"), KEYS.comm_status(node)))
    )
    publisher = MomentPublisher(session, KEYS, player.record.scenario)  # type: ignore[arg-type]
    for moment in player.moments():
        publisher.publish(moment, Pace(1.0, 0, 0.0))
    assert {key for key, _, _ in session.told} == {KEYS.rx("1", "0", "team"), KEYS.comm_status("1")}


def test_packets_have_the_encoding_that_they_were_sent_with(tmp_path: Path) -> None:
    def send(_: int) -> list[Sent]:
        return [Sent("0", encoding="text/plain"), Sent("1")]

    player = Player.open(flown(tmp_path / "made", scenario_of("perfect", ("0", "1")), 2, send))
    session = Wanting(KEYS.rx("0", "*", "*"), KEYS.rx("1", "*", "*"))
    publisher = MomentPublisher(session, KEYS, player.record.scenario)  # type: ignore[arg-type]
    publisher.publish(next(iter(player.moments())), Pace(1.0, 0, 0.0))
    told = {(key, encoding) for key, encoding, _ in session.told}
    assert told == {(KEYS.rx("1", "0", "team"), "text/plain"), (KEYS.rx("0", "1", "team"), "")}


class Released(Wanting):
    """A session that keeps the instants that are released."""

    def put(self, key: str, message: Any, **_: Any) -> None:
        if key == KEYS.clock_release:
            self.told.append((key, message.stamp.ns, None))


def test_all_ticks_are_released_but_the_last(tmp_path: Path) -> None:
    """As in a run, which ends with it."""
    player = Player.open(flown(tmp_path / "made", scenario_of("perfect", ("0", "1")), 3))
    session = Released()
    publisher = MomentPublisher(session, KEYS, player.record.scenario)  # type: ignore[arg-type]
    for moment in player.moments():
        publisher.publish(moment, Pace(1.0, 0, 0.0))
    assert [sim_time_ns for _, sim_time_ns, _ in session.told] == [0, TICK_NS]
