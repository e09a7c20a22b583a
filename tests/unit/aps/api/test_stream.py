import asyncio
import json

import pytest

from aps.api.jobs import MAX_KEPT, Jobs
from aps.api.stream import MAX_WAITING, Listener
from aps.vehicle.execution import CommandResult, Outcome


async def test_of_too_many_events_the_oldest_give_way_and_the_client_is_told():
    listener = Listener(0.0, ())
    for number in range(MAX_WAITING + 10):
        listener.put({"number": number})
    got = [json.loads(await listener.next()) for _ in range(MAX_WAITING + 1)]
    assert got[0] == {"type": "missed", "events": 10}
    assert [event["number"] for event in got[1:]] == list(range(10, MAX_WAITING + 10))


async def test_what_waits_for_an_event_goes_on_with_the_next():
    listener = Listener(0.0, ())
    waiting = asyncio.create_task(listener.next())
    await asyncio.sleep(0)
    listener.put({"a": 1})
    assert await waiting == '{"a": 1}'


def test_states_come_no_oftener_than_asked_from_the_first_on(monkeypatch):
    now_s = 1000.0
    monkeypatch.setattr("aps.api.stream.time.monotonic_ns", lambda: round(now_s * 1e9))
    monkeypatch.setattr("aps.api.stream.state_json", lambda state: {})
    listener = Listener(2.0, ())
    came = []
    monkeypatch.setattr(listener, "put", lambda event: came.append(now_s - 1000.0))
    for tick in range(61):
        now_s = 1000.02 + tick * 0.05
        listener.look(None, None)
    assert came == pytest.approx([0.02, 0.52, 1.02, 1.52, 2.02, 2.52, 3.02])


class Instant:
    """A backend whose commands end at once."""

    def start(self, verb, arguments, on_progress, on_done):
        on_done(CommandResult(verb, Outcome.REACHED))


async def test_only_the_latest_commands_are_remembered():
    jobs = Jobs(Instant(), lambda event: None)
    for _ in range(MAX_KEPT + 5):
        jobs.start("arm", {})
    assert len(jobs.all()) == MAX_KEPT
    assert jobs.get(5) is None
    assert jobs.get(6).as_json()["result"]["outcome"] == "reached"
