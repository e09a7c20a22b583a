"""What an operator asks of the clock, as it goes over Zenoh."""

from __future__ import annotations

import asyncio
import math
from types import SimpleNamespace
from typing import Any

from bridge.bus.clock_commands import read_command
from lostlink.view.sources.operator import Operator


class Asked:
    """A session that keeps what is asked, and grants it."""

    def __init__(self) -> None:
        self.queries: list[tuple[str, bytes]] = []

    def query_bytes(self, key: str, payload: bytes, on_reply: Any, **_: Any) -> None:
        self.queries.append((key, payload))
        on_reply(SimpleNamespace(ok=b"", err=None))


class Joins:
    """Access to no run: what is asked is kept."""

    run = "made"

    def __init__(self, session: Asked) -> None:
        self._session = session

    def open(self) -> Asked:
        return self._session


async def test_a_speed_goes_out_as_a_run_and_a_record_read_it() -> None:
    asked = Asked()
    told: list[str] = []
    operator = Operator(Joins(asked), lambda _node, text: told.append(text))  # type: ignore[arg-type]
    await operator.open()
    operator.speed(math.inf)
    operator.speed(2.0)
    assert [payload for _, payload in asked.queries] == [b"max", b"2.0"]
    assert [read_command("speed", payload).number for _, payload in asked.queries] == [math.inf, 2.0]
    await asyncio.sleep(0)  # answers come by the loop
    assert told == ["speed max: done", "speed 2.0: done"]
