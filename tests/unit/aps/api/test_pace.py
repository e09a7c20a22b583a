"""Who floods an API waits, or is told to come again; what is due in between gets its turn."""

from __future__ import annotations

import asyncio
import selectors
from dataclasses import dataclass, field
from typing import Any, Final

import pytest

from aps.api.guard import HOLD_S
from aps.api.pace import PacedApi


class Waits(selectors.DefaultSelector):
    """Does not wait: the clock is then what would have been waited for."""

    now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        assert timeout is not None, "nothing is due any more"
        self.now_s += max(0.0, timeout)
        return super().select(0)


class Clocked(asyncio.SelectorEventLoop):
    """An event loop by such a clock."""

    def __init__(self) -> None:
        self.waits = Waits()
        super().__init__(self.waits)

    def time(self) -> float:
        return self.waits.now_s


POST: Final = {"type": "http", "method": "POST"}
GET: Final = {"type": "http", "method": "GET"}
STREAM: Final = {"type": "websocket"}


@dataclass
class Client:
    """One request: what it sends, when it hangs up, and what became of it."""

    scope: dict[str, str]
    body: bytes = b""
    leaves_s: float | None = None
    """If None it stays."""
    reached_s: float | None = None
    """The app."""
    done_s: float = 0.0
    told: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    _has_sent: bool = False

    async def receive(self) -> dict[str, Any]:
        """As of a server."""
        if not self._has_sent:
            self._has_sent = True
            if self.scope["type"] == "websocket":
                return {"type": "websocket.connect"}
            return {"type": "http.request", "body": self.body, "more_body": False}
        if self.leaves_s is None:
            await asyncio.Event().wait()
        await asyncio.sleep(self.leaves_s - asyncio.get_running_loop().time())  # type: ignore[operator]
        return {"type": f"{self.scope['type']}.disconnect"}

    async def send(self, message: Any) -> None:
        """As of a server."""
        self.told.append((asyncio.get_running_loop().time(), message))

    @property
    def is_refused(self) -> bool:
        """Told to come again."""
        return bool(self.told) and self.told[0][1]["status"] == 429


def ask(*clients: Client, then_s: float = 0.0, then: Client | None = None) -> None:
    """All at once, and after that time one more."""
    loop = Clocked()
    asked: dict[int, Client] = {}

    async def app(scope: Any, receive: Any, _send: Any) -> None:
        await receive()
        asked[id(scope)].reached_s = loop.time()

    async def run(paced: PacedApi, client: Client) -> None:
        scope: dict[str, Any] = dict(client.scope)
        asked[id(scope)] = client
        await paced(scope, client.receive, client.send)
        client.done_s = loop.time()

    async def later(paced: PacedApi, client: Client) -> None:
        await asyncio.sleep(then_s)
        await run(paced, client)

    async def come() -> None:
        paced = PacedApi(app, 100.0)
        last = [] if then is None else [later(paced, then)]
        await asyncio.gather(*(run(paced, client) for client in clients), *last)

    try:
        loop.run_until_complete(come())
    finally:
        loop.close()


@pytest.mark.parametrize(("scope", "most_s"), [(GET, 0.25), (STREAM, 0.25), (POST, 0.5)])
def test_half_a_seconds_worth_comes_at_once_some_wait_and_the_rest_is_told_to_come_again(
    scope: dict[str, str], most_s: float
) -> None:
    clients = [Client(scope) for _ in range(2000)]
    ask(*clients)
    reached = [client.reached_s for client in clients if client.reached_s is not None]
    assert sum(instant == 0.0 for instant in reached) in (50, 51)
    assert most_s - 0.02 <= max(reached) <= most_s + 0.01
    assert len(reached) == pytest.approx(50 + 100 * most_s, abs=2)
    refused = [client for client in clients if client.reached_s is None]
    assert all(client.is_refused and client.told[0][0] == 0.0 for client in refused)
    assert all((b"retry-after", b"1") in client.told[0][1]["headers"] for client in refused)


def test_a_refused_one_has_its_answer_at_once_and_its_connection_is_read_later() -> None:
    clients = [Client(GET) for _ in range(100)]
    ask(*clients)
    last = clients[-1]
    assert [at_s for at_s, _ in last.told] == [0.0, 0.0, HOLD_S]
    length = dict(last.told[0][1]["headers"])[b"content-length"]
    assert last.told[1][1]["body"] == b'{"detail":"too many requests"}'
    assert (int(length), last.told[2][1].get("more_body", False)) == (len(last.told[1][1]["body"]), False)


def test_a_refused_one_that_hangs_up_is_held_no_longer() -> None:
    clients = [*(Client(GET) for _ in range(100)), Client(GET, leaves_s=0.1)]
    ask(*clients)
    assert clients[-1].is_refused
    assert clients[-1].done_s == pytest.approx(0.1)


def test_a_flood_of_looks_keeps_no_command_out() -> None:
    land = Client(POST)
    ask(*(Client(GET) for _ in range(3000)), then=land)
    assert land.reached_s == pytest.approx(0.26, abs=0.02)


@pytest.mark.parametrize("scope", [GET, POST, STREAM])
def test_who_hangs_up_before_its_turn_gives_its_share_back(scope: dict[str, str]) -> None:
    gone = [Client(scope, leaves_s=0.001) for _ in range(3000)]
    land = Client(POST)
    ask(*gone, then_s=0.02, then=land)
    assert sum(client.reached_s is not None for client in gone) <= 51
    assert land.reached_s == pytest.approx(0.02, abs=0.011)


def test_a_long_body_counts_as_many_requests() -> None:
    long = Client(POST, b"x" * (150 * 4096))
    ask(long)
    assert long.reached_s == pytest.approx(1.0, abs=0.1)


def test_long_bodies_keep_no_command_out() -> None:
    land = Client(POST)
    ask(*(Client(POST, b"x" * (60 * 4096)) for _ in range(30)), then_s=1.0, then=land)
    assert land.reached_s is not None
    assert land.reached_s <= 1.5
