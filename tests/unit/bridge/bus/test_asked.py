"""Commands over Zenoh: whoever asks for one that there is not is told which there are."""

from __future__ import annotations

import asyncio
import json
import queue
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from aps.vehicle.messages import MessageBoard
from bridge.bus.keys import Keys
from bridge.bus.messages import CommandEvent, decode
from bridge.bus.session import Session, free_port, open_client, open_router
from bridge.host.hosted_aircraft import HostedAircraft
from bridge.host.on_bus import AskedOnBus
from bridge.physics.held_clock import HeldClock

KEYS = Keys("asked")


@pytest.fixture
def sessions() -> Iterator[tuple[Session, Session]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint) as router, open_client(endpoint) as client:
        yield router, client


def answers(client: Session, key: str, text: str = "") -> list[str]:
    mode = zenoh.ConsolidationMode.NONE
    replies = list(client._inner.get(key, payload=text, timeout=20.0, consolidation=mode))
    return [(reply.ok or reply.err).payload.to_string() for reply in replies]


def test_a_clock_names_the_verbs_that_it_has(sessions: tuple[Session, Session]) -> None:
    router, client = sessions
    paced: Any = SimpleNamespace()
    HeldClock(router, KEYS, paced, speed=1.0, tick_period_ns=50_000_000)
    (refused,) = answers(client, KEYS.clock_command("jump"))
    assert json.loads(refused) == {"error": "'jump' is none of pause, resume, step, speed, status"}
    (status,) = answers(client, KEYS.clock_command("status"))
    assert json.loads(status)["paused"] is False


async def test_a_node_names_the_commands_that_it_has(sessions: tuple[Session, Session]) -> None:
    router, client = sessions
    run: Any = SimpleNamespace(keys=KEYS)
    node: Any = SimpleNamespace(id="0")
    AskedOnBus(router, run, node)
    (refused,) = await asyncio.to_thread(answers, client, KEYS.command("0", "flyy"))
    assert refused.startswith("command 'flyy' is none of arm, disarm, mode, takeoff")


async def test_no_wildcard_commands_several_nodes(sessions: tuple[Session, Session]) -> None:
    """A slip of an operator is not to send a fleet home; what is only looked at may be asked of all."""
    router, client = sessions
    run: Any = SimpleNamespace(keys=KEYS)
    commanded: list[Any] = []
    for node in ("0", "1"):
        asked: Any = SimpleNamespace(
            id=node, node=SimpleNamespace(operator_asked=lambda *a: commanded.append(a))
        )
        AskedOnBus(router, run, asked)
    refused = await asyncio.to_thread(answers, client, KEYS.command("*", "rtl"))
    assert refused == [f"{KEYS.prefix}/node/*/cmd/rtl: a command is for one node, without a wildcard"] * 2
    assert not commanded


async def test_a_goal_that_is_none_is_refused_as_other_mistakes_are(
    sessions: tuple[Session, Session],
) -> None:
    router, client = sessions
    run: Any = SimpleNamespace(keys=KEYS)
    node: Any = SimpleNamespace(id="0")
    AskedOnBus(router, run, node)
    (reply,) = await asyncio.to_thread(
        lambda: list(client._inner.get(KEYS.command("0", "goto"), payload=b"garbage", timeout=20.0))
    )
    event = decode(reply.ok.payload.to_bytes(), CommandEvent)
    assert (event.phase, event.success, event.outcome) == (CommandEvent.RESULT, False, "refused")


class Speechless(HostedAircraft):
    """An aircraft whose autopilot has sent nothing."""

    def __init__(self) -> None:
        self.id = "0"

    def last_message(self, name: str) -> None:
        """There is none yet."""
        return MessageBoard().last(name, 0)


async def test_a_mavlink_message_that_there_is_not_is_an_error(sessions: tuple[Session, Session]) -> None:
    router, client = sessions
    run: Any = SimpleNamespace(keys=KEYS)
    AskedOnBus(router, run, Speechless())
    refused = await asyncio.to_thread(answers, client, KEYS.mavlink("0", "NONSENSE"))
    assert refused == ["there is no MAVLink message 'NONSENSE'"]
    assert await asyncio.to_thread(answers, client, KEYS.mavlink("0", "ATTITUDE")) == []


def test_a_step_is_answered_when_it_is_done(sessions: tuple[Session, Session]) -> None:
    """With the time that it led to, as a record that is played answers."""
    router, client = sessions
    stepped: queue.SimpleQueue[int] = queue.SimpleQueue()
    paced: Any = SimpleNamespace(pause=lambda: None, resume=lambda: None, step=stepped.put)
    clock = HeldClock(router, KEYS, paced, speed=1.0, tick_period_ns=50_000_000)
    clock.ticked(8_100_000_000)
    with ThreadPoolExecutor(3) as pool:
        half = pool.submit(answers, client, KEYS.clock_command("step"), "0.5")
        assert stepped.get(timeout=20.0) == 500_000_000
        behind_it = pool.submit(answers, client, KEYS.clock_command("step"))
        assert stepped.get(timeout=20.0) == 50_000_000
        clock.ticked(8_550_000_000)
        (status,) = answers(client, KEYS.clock_command("status"))
        assert json.loads(status)["sim_time_s"] == 8.55
        assert not half.done()
        clock.ticked(8_600_000_000)
        assert times(half.result(20.0)) == [8.6]
        assert not behind_it.done()
        clock.ticked(8_650_000_000)
        assert times(behind_it.result(20.0)) == [8.65]
        cut = pool.submit(answers, client, KEYS.clock_command("step"), "60")
        assert stepped.get(timeout=20.0) == 60_000_000_000
        clock.ticked(9_000_000_000)
        assert times(answers(client, KEYS.clock_command("pause"))) == [9.0]
        assert times(cut.result(20.0)) == [9.0]
    clock.close()


def times(told: list[str]) -> list[float]:
    return [json.loads(each)["sim_time_s"] for each in told]
