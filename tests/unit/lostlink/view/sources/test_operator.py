"""What an operator asks of the clock, as it goes over Zenoh."""

from __future__ import annotations

import asyncio
import math
from types import SimpleNamespace
from typing import Any

from bridge.bus.clock_commands import read_command
from bridge.bus.messages import CommandEvent, CommandGoal, encode
from lostlink.view.sources.operator import Operator


class Asked:
    """A session that keeps what is asked, and grants it."""

    def __init__(self) -> None:
        self.queries: list[tuple[str, bytes]] = []
        self.reply: Any = None

    def query(self, _key: str, _goal: CommandGoal, on_reply: Any, *_: Any, **__: Any) -> None:
        on_reply(self.reply)

    def query_bytes(self, key: str, payload: bytes, on_reply: Any, **_: Any) -> None:
        self.queries.append((key, payload))
        on_reply(SimpleNamespace(ok=b"", err=None))


class Bytes(bytes):
    """A payload of Zenoh."""

    def to_bytes(self) -> bytes:  # type: ignore[override]
        return bytes(self)


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


async def test_a_target_that_another_took_the_place_of_is_not_told_to_be_reached() -> None:
    asked, told, done = Asked(), [], []  # type: Asked, list[str], list[str]
    operator = Operator(Joins(asked), lambda _node, text: told.append(text))  # type: ignore[arg-type]
    await operator.open()
    for outcome, text in (("superseded", "goto superseded: by goto"), ("reached", "goto reached")):
        event = CommandEvent(CommandEvent.RESULT, success=True, text=text, outcome=outcome)
        asked.reply = SimpleNamespace(ok=SimpleNamespace(payload=Bytes(encode(event))))
        operator.command("0", "goto", on_done=lambda outcome=outcome: done.append(outcome))  # type: ignore[misc]
    await asyncio.sleep(0)
    results = [line for line in told if "asked" not in line]
    assert results == ["goto: superseded (goto superseded: by goto)", "goto: done (goto reached)"]
    assert done == ["reached"]
