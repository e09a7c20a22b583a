"""Commands over Zenoh: whoever asks for one that there is not is told which there are."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from bridge.bus.keys import Keys
from bridge.bus.session import Session, free_port, open_client, open_router
from bridge.host.on_bus import AskedOnBus
from bridge.physics.held_clock import HeldClock

KEYS = Keys("asked")


@pytest.fixture
def sessions() -> Iterator[tuple[Session, Session]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint) as router, open_client(endpoint) as client:
        yield router, client


def answers(client: Session, key: str) -> list[str]:
    replies = list(client._inner.get(key, timeout=20.0))
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
