"""A script's view of a node, over a real Zenoh router and a real socket."""

from __future__ import annotations

import asyncio
import itertools
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bridge.agents import CommandFailed, RunOver, UaClient, connect_ua
from bridge.bus.keys import Keys
from bridge.bus.messages import (
    AircraftState,
    Clock,
    CommandEvent,
    CommunicationStatus,
    Header,
    Measurements,
)
from bridge.bus.reception import attachment
from bridge.bus.replies import reply_event
from bridge.bus.session import Query, Session, SessionError, Stamp
from bridge.run.access import Access, NoAccess
from tests.integration.bridge.clients.guarded import RUN, Guarded, guarded_router

KEYS = Keys(RUN)
TICK_NS = 50_000_000
STATE = AircraftState(Header.at(TICK_NS, "1"), mode="RTL")
STATUS = CommunicationStatus(Header.at(0, "1"), ("0",), (True,))
MEASURED = Measurements(Header.at(0, "1"), (1,), (3,), (-70.0,), (2.4e9,), ("e0",))


@pytest.fixture
def router(tmp_path: Path) -> Iterator[Guarded]:
    with guarded_router(tmp_path / "secrets") as guarded:
        yield guarded


def access_to(router: Guarded) -> Access:
    return Access(RUN, router.endpoint, router.keyring.credentials("node-1"))


async def test_condition_that_raises_ends_the_wait_with_its_error(router: Guarded) -> None:
    def condition(state: AircraftState) -> bool:
        raise KeyError("somebody's mistake")

    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        waiting = asyncio.create_task(ua.wait_for(condition))
        while not waiting.done():  # until the subscription is known to the router
            router.session.put(KEYS.state("1"), AircraftState())
            router.session.put(KEYS.clock, Clock(Header.at(0, "")))
            await asyncio.wait({waiting}, timeout=0.05)
        with pytest.raises(KeyError, match="somebody's mistake"):
            await asyncio.wait_for(waiting, 10.0)
        assert (await asyncio.wait_for(ua.wait_for(lambda state: not state.armed), 10.0)).armed is False


async def test_a_tick_comes_in_the_order_on_board_whatever_the_order_on_the_wire(router: Guarded) -> None:
    """At tick T: the state of T, what the radio settled at T-1, what became of commands, and then the tick."""
    got: list[tuple[object, ...]] = []
    session = router.session
    session.serve(KEYS.command("1", "rtl"), lambda query: answer(query, session))

    def answer(query: Query, session: Session) -> None:
        reply_event(query, str(query.key_expr), CommandEvent(CommandEvent.RESULT, True, outcome="reached"))
        session.put(KEYS.answer("1"), Header.at(TICK_NS, "1"))

    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        there = asyncio.Event()
        ua.on_tick(lambda _: there.set())
        while (
            not there.is_set()
        ):  # until the subscriptions are known to the router; the node answers its ticks
            session.put(KEYS.clock, Clock(Header.at(0, "")))
            session.put(KEYS.answer("1"), Header.at(0, "1"))
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.1)
        ua.on_packet(lambda sender, _channel, _payload, came: got.append((sender, came.seq, came.age_s)))
        ua.on_measurement(lambda measurement: got.append((measurement.power_dbm, ua.state)))
        ua.on_tick(lambda now_ns: got.append((now_ns, ua.state, ua.comm_status)))
        for seq in (7, 8):
            stamp = attachment(Stamp(seq, 0).to_bytes(), -80.0, 20.0)
            session.put_bytes(KEYS.rx("1", "0", "team"), b"x", attachment=stamp)
        session.put(KEYS.measurements("1"), MEASURED)
        session.put(KEYS.clock, Clock(Header.at(TICK_NS, "")))
        session.put(KEYS.comm_status("1"), STATUS)
        session.put(KEYS.clock_release, Header.at(0, ""))
        session.put(KEYS.answer("1"), Header.at(TICK_NS // 2, "1"))  # of an exchange of MAVLink: no tick
        session.put(KEYS.state("1"), STATE)
        flight = asyncio.create_task(ua.rtl())
        flight.add_done_callback(lambda _: got.append(("rtl", ua.sim_time_ns)))
        await asyncio.wait_for(flight, 10.0)
        await asyncio.sleep(0)
    assert got == [
        (-70.0, STATE),
        ("0", 7, 0.05),
        ("0", 8, 0.05),
        (TICK_NS, STATE, STATUS),
        ("rtl", TICK_NS),
    ]


@pytest.mark.slow
async def test_a_wait_is_as_long_as_it_says_whenever_a_script_joined(router: Guarded) -> None:
    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        waiting = asyncio.create_task(ua.wait_for(lambda _: False, timeout_s=5.0))
        clock_s = 100.0
        while not waiting.done():
            router.session.put(KEYS.clock, Clock(Header.at(round(clock_s * 1e9), "")))
            await asyncio.wait({waiting}, timeout=0.02)
            if ua.sim_time_ns:
                clock_s += 1.0
        with pytest.raises(TimeoutError, match=r"still waiting at 105\.00 s"):
            await waiting


def served(router: Guarded, verb: str) -> asyncio.Queue[Query]:
    """What is asked of the aircraft."""
    asked: asyncio.Queue[Query] = asyncio.Queue()
    loop = asyncio.get_running_loop()
    router.session.serve(
        KEYS.command("1", verb), lambda query: loop.call_soon_threadsafe(asked.put_nowait, query)
    )
    return asked


async def joined(ua: UaClient, session: Session) -> None:
    """Wait until the script's subscriptions are known to the router."""
    there = asyncio.Event()
    ua.on_tick(lambda _: there.set())
    async with asyncio.timeout(10.0):
        while not there.is_set():
            session.put(KEYS.clock, Clock(Header.at(0, "")))
            await asyncio.sleep(0.02)


@pytest.mark.parametrize("is_killed", [False, True])
@pytest.mark.slow
async def test_what_a_script_waits_for_ends_with_the_run(router: Guarded, is_killed: bool) -> None:
    """A run says that it is over, or its router is gone without a word."""
    router.session.declare_alive(KEYS.alive("router"))
    asked = served(router, "rtl")
    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        await joined(ua, router.session)
        never = (ua.wait_for(lambda _: False), ua.wait_for(lambda _: False, timeout_s=30.0), ua.rtl())
        waiting = [asyncio.create_task(each) for each in never]
        async with asyncio.timeout(10.0):
            open_query = await asked.get()  # kept, as by an aircraft that is on its way
            assert not any(each.done() for each in waiting)
            if is_killed:
                router.session.close()
            else:
                router.session.put(KEYS.clock_end, Header.at(TICK_NS, ""))
            ends = await asyncio.gather(*waiting, return_exceptions=True)
            assert [repr(end) for end in ends[:2]] == ["RunOver('UA 1: wait_for: the run is over')"] * 2
            assert repr(ends[2]) == "RunOver('UA 1: rtl: the run is over')"
            for late in (ua.wait_for(lambda _: False), ua.land()):
                with pytest.raises(RunOver, match="the run is over"):
                    await late
    del open_query


async def test_a_command_that_ends_with_the_last_tick_has_its_result(router: Guarded) -> None:
    asked = served(router, "rtl")
    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        await joined(ua, router.session)
        flight = asyncio.create_task(ua.command("rtl"))
        async with asyncio.timeout(10.0):
            query = await asked.get()
            reply_event(
                query, str(query.key_expr), CommandEvent(CommandEvent.RESULT, True, outcome="reached")
            )
            router.session.put(KEYS.clock_end, Header.at(TICK_NS, ""))
            assert (await flight).outcome == "reached"


async def test_what_a_callback_of_a_script_raises_is_told_by_name(
    router: Guarded, caplog: pytest.LogCaptureFixture
) -> None:
    def stumble(_: int) -> None:
        raise KeyError("somebody's mistake")

    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        ua.on_tick(stumble)
        async with asyncio.timeout(10.0):
            while not caplog.records:
                router.session.put(KEYS.clock, Clock(Header.at(TICK_NS, "")))
                await asyncio.sleep(0.02)
    assert caplog.records[0].getMessage().startswith("at a tick, at 0.050 s")
    assert "somebody's mistake" in caplog.text


async def test_a_program_is_not_let_in_as_a_sender_where_no_radio_answers(
    router: Guarded, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridge.agents.beside.RADIO_ANSWER_S", 0.5)
    with pytest.raises(SessionError, match="the radio does not answer with the next packet of node 1"):
        async with connect_ua(RUN, "1", is_sender=True, access=access_to(router)):
            pass


@pytest.fixture
def radio(router: Guarded) -> Session:
    """A radio that says that the node's next packet is the seventh."""
    key = KEYS.next_packet("1")
    value = json.dumps({"seq": 7, "sim_time_ns": 0})
    event = CommandEvent(CommandEvent.RESULT, True, value=value)
    router.session.serve(key, lambda query: reply_event(query, key, event))
    return router.session


@contextmanager
def ticking(session: Session, *, has_host: bool) -> Iterator[None]:
    """A clock that ticks; a host answers, and says the state of its node at every other tick."""
    stop = threading.Event()

    def tick() -> None:
        for now_ns in itertools.count(TICK_NS, TICK_NS):
            if stop.wait(0.01):
                return
            session.put(KEYS.clock, Clock(Header.at(now_ns, "")))
            if has_host:
                if now_ns % (2 * TICK_NS) == 0:
                    session.put(KEYS.state("1"), STATE)
                session.put(KEYS.answer("1"), Header.at(now_ns, "1"))
            session.put(KEYS.clock_release, Header.at(now_ns, ""))

    clock = threading.Thread(target=tick)
    clock.start()
    try:
        yield
    finally:
        stop.set()
        clock.join()


async def test_a_program_that_flies_a_free_node_begins_with_its_state(
    router: Guarded, radio: Session
) -> None:
    with ticking(radio, has_host=True):
        async with connect_ua(RUN, "1", is_sender=True, access=access_to(router)) as ua:
            assert ua.state == STATE
            assert ua.transmit("team", b"x") == 7


async def test_a_node_that_no_host_serves_has_no_state_and_takes_no_commands(
    router: Guarded, radio: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridge.agents.beside.FIRST_STATE_S", 600.0)
    with ticking(radio, has_host=False):
        async with (
            asyncio.timeout(10.0),
            connect_ua(RUN, "1", is_sender=True, access=access_to(router)) as ua,
        ):
            assert ua.state is None
            with pytest.raises(CommandFailed, match="node 1: rtl: nobody answers: a node on the ground"):
                await ua.rtl()


async def test_what_still_waits_when_a_program_leaves_is_told(router: Guarded) -> None:
    with ticking(router.session, has_host=True):
        async with connect_ua(RUN, "1", access=access_to(router)) as ua:
            waiting = asyncio.create_task(ua.wait_for(lambda _: False))
            await asyncio.sleep(0)
        with pytest.raises(RunOver, match="UA 1: wait_for: the program has left the run"):
            await asyncio.wait_for(waiting, 10.0)
        with pytest.raises(RunOver, match="UA 1: rtl: the program has left the run"):
            await ua.rtl()


async def test_a_script_beside_the_agent_is_told_that_it_cannot_transmit(router: Guarded) -> None:
    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        with pytest.raises(PermissionError, match="only the agent of node 1 may transmit"):
            ua.transmit("team", b"x")
        assert ua.sent == 0


async def test_a_run_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(NoAccess, match="there is no run nowhere, nor runs/nowhere"):
        async with connect_ua("nowhere", "1"):
            pass
    with pytest.raises(NoAccess, match="is no run"):
        async with connect_ua(tmp_path, "1"):
            pass
