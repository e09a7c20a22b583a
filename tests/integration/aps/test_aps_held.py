"""The held daemon over real sockets: what it says depends on sim time and inputs, and on nothing else."""

import asyncio
import contextlib
import itertools
import socket

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.config import DaemonConfig
from aps.held import HeldDaemon
from aps.inputs import PENDING_LIMIT_BYTES, Input
from aps.links.kinds.held import MAX_WRITE_BYTES

TICK_NS = 50_000_000
ATTITUDE_EVERY_20_MS = mavlink.MAVLink_command_long_message(2, 1, 511, 0, 30, 20_000, 0, 0, 0, 0, 0)
GUIDED = mavlink.MAVLink_command_long_message(2, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0)


class Flight:
    """A held daemon, its autopilot, and a record of what went between them."""

    def __init__(self, autopilot, daemon, record=None):
        self.autopilot, self.daemon = autopilot, daemon
        self.tick = 0
        self.said, self.inputs, self.wall_time, self.states = [], {}, [], []
        self._record = record or {}
        daemon.on_bytes = lambda direction, data: self.said.append((self.tick, direction, data))
        daemon.on_input = lambda item: self.inputs.setdefault(self.tick, []).append(item)
        daemon.on_wall_time = self.wall_time.append

    def exchange(self, decide=lambda: None):
        self.tick += 1
        self.autopilot.tick()
        self.daemon.inject(self._record.get(self.tick, []))
        self.daemon.begin_exchange(self.tick * TICK_NS)
        self.states.append(repr(self.daemon.state))  # as text, so that NaN is NaN
        decide()
        self.daemon.end_exchange()

    def exchange_until(self, condition, limit=400):
        for _ in range(limit):
            if condition():
                return
            self.exchange()
        pytest.fail("not there")

    def to_autopilot(self):
        return b"".join(data for _, direction, data in self.said if direction == "to_autopilot")


@pytest.fixture
def fly(make_held_autopilot):
    """Call for a flight: ``async with fly() as flight``."""

    @contextlib.asynccontextmanager
    async def fly(record=None, takes_input=True, **settings):
        autopilot = make_held_autopilot()
        config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2, **settings)
        async with HeldDaemon(config, takes_input=takes_input) as daemon:
            await daemon.connect()
            autopilot.accept()
            yield Flight(autopilot, daemon, record)

    return fly


async def load(generator):
    """Keep the event loop busy, now and then for long."""
    while True:
        sum(range(generator.integers(20_000)))
        await asyncio.sleep(0 if generator.integers(4) else 0.001)


def mission(flight, tick, told):
    """Commands at ticks and upon the ends of others."""
    commands = flight.daemon.commands

    def climb(result):
        told.append(str(result))
        commands.start("takeoff", 20.0, on_progress=lambda event: told.append(event.text), on_done=home)

    def home(result):
        told.append(str(result))
        commands.start("rtl", on_done=lambda result: told.append(str(result)))

    if tick == 60:
        commands.start("arm", on_done=climb)


async def operate(connect, port, generator):
    """A ground station that does things whenever it likes."""
    for _ in range(3):
        client = await connect(port)
        for message in (
            mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
            ATTITUDE_EVERY_20_MS,
            mavlink.MAVLink_request_data_stream_message(2, 1, 1, 8, 1),
            mavlink.MAVLink_param_request_list_message(2, 1),
            mavlink.MAVLink_command_long_message(2, 1, 511, 0, 33, 500_000, 0, 0, 0, 0, 0),
        ):
            client.send(message)
            client.writer.write(bytes(generator.integers(20)))  # garbage, but no start marker
            await asyncio.sleep(0.01 * generator.random())
        client.close()


async def flown(fly, seed, record=None, operator=None, takes_input=True):
    """One flight of 400 ticks; returns it and what its commands told."""
    generator = np.random.default_rng(seed)
    told = []
    async with fly(record, takes_input) as flight:
        tasks = [asyncio.create_task(load(generator))]
        if operator is not None:
            tasks.append(asyncio.create_task(operator(flight.daemon.listen_port, generator)))
        for tick in range(400):
            flight.exchange(lambda tick=tick: mission(flight, tick, told))
            await asyncio.sleep(0.001 * generator.random() if generator.integers(3) else 0)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        assert not flight.wall_time
        return flight, told


async def test_two_flights_are_the_same_whatever_the_wall_clock_does(fly):
    first, told = await flown(fly, 1)
    second, told_again = await flown(fly, 2)
    assert told[0] == "arm reached"
    assert "takeoff reached" in told
    assert told[-1] == "rtl reached"
    assert told_again == told
    assert second.said == first.said
    assert second.states == first.states
    assert len(first.to_autopilot()) > 1000


async def test_a_record_with_an_operator_flies_again_without_the_operator(fly, connect):
    async def operator(port, generator):
        await operate(connect, port, generator)

    first, told = await flown(fly, 3, operator=operator)
    kinds = [item.kind for items in first.inputs.values() for item in items]
    assert kinds.count("close") >= 1
    assert kinds.count("frame") >= 5
    again, told_again = await flown(fly, 4, record=first.inputs)
    assert again.said == first.said
    assert again.states == first.states
    assert again.inputs == first.inputs
    assert told_again == told
    quiet, _ = await flown(fly, 5)
    assert quiet.to_autopilot() != first.to_autopilot()


async def test_during_a_replay_others_may_listen_but_not_be_heard(fly, connect):
    first, _ = await flown(fly, 6)
    heard = []

    async def listener(port, generator):
        client = await connect(port)
        client.send(ATTITUDE_EVERY_20_MS)
        heard.append(await client.next("ATTITUDE"))
        await operate(connect, port, generator)

    again, _ = await flown(fly, 7, operator=listener, takes_input=False)
    assert heard
    assert again.said == first.said
    assert again.inputs == {}
    assert again.daemon.counters.inputs_ignored > 0


async def test_nothing_is_said_and_nothing_changes_between_two_exchanges(fly, connect):
    async with fly() as flight:
        flight.exchange_until(lambda: flight.daemon.state.mode)
        flight.exchange_until(lambda: flight.daemon.streams.idle)
        flight.autopilot.heard.clear()
        state = flight.daemon.state
        client = await connect(flight.daemon.listen_port)
        client.send(GUIDED)
        flight.daemon.commands.start("arm")
        flight.autopilot.send(mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 5, 4, 3))
        flight.autopilot.streaming = False
        flight.autopilot.tick()
        await asyncio.sleep(1.5)  # a heartbeat of wall time would be due
        flight.autopilot.tick()
        assert flight.autopilot.heard == []
        assert repr(flight.daemon.state) == repr(state)
        assert flight.daemon.router.links == (0,)
        flight.exchange()
        assert flight.daemon.state.mode == "LOITER"
        assert flight.daemon.router.links == (0, 1)
        flight.exchange()
        assert [message.command for message in flight.autopilot.commands[-2:]] == [400, 176]


async def test_state_ages_in_sim_time(fly):
    async with fly() as flight:
        flight.exchange_until(lambda: flight.daemon.state.heartbeat_age_s == 0.0)
        flight.autopilot.streaming = False
        for ticks in range(1, 5):
            flight.exchange()
            assert flight.daemon.state.heartbeat_age_s == pytest.approx(0.05 * ticks)


async def test_what_is_too_much_for_one_exchange_waits_for_the_next(fly, connect, eventually):
    async with fly() as flight:
        client = await connect(flight.daemon.listen_port)
        frames = 600
        for number in range(frames):
            client.send(mavlink.MAVLink_param_set_message(2, 1, b"P", number, 9))
        await eventually(lambda: flight.daemon.statistics()["inputs_pending"] == frames + 1)
        sizes = []
        while sum(message.get_type() == "PARAM_SET" for message in flight.autopilot.heard) < frames:
            flight.exchange()
            sizes.append(flight.daemon.counters.written_bytes)
        assert MAX_WRITE_BYTES - 280 < sizes[0] <= MAX_WRITE_BYTES
        assert max(sizes) <= MAX_WRITE_BYTES
        values = [m.param_value for m in flight.autopilot.heard if m.get_type() == "PARAM_SET"]
        assert values == list(range(frames))
        assert flight.wall_time == []


async def test_what_the_autopilot_answers_from_a_thread_is_told_once(fly, connect, eventually):
    to_another = mavlink.MAVLink_file_transfer_protocol_message(0, 9, 1, [0] * 251)
    files = mavlink.MAVLink_file_transfer_protocol_message(0, 2, 1, [0] * 251)
    log = mavlink.MAVLink_log_request_data_message(2, 1, 1, 0, 90)
    async with fly() as flight:
        client = await connect(flight.daemon.listen_port)
        flight.exchange_until(lambda: flight.daemon.state.autopilot == flight.autopilot.kind)
        for message, told in [(to_another, []), (files, ["FTP"]), (files, ["FTP"]), (log, ["FTP", "a log"])]:
            client.send(message)
            await eventually(lambda: flight.daemon.statistics()["inputs_pending"])
            flight.exchange()
            assert len(flight.wall_time) == len(told)
            assert all(word in reason for word, reason in zip(told, flight.wall_time, strict=True))


async def test_what_px4_answers_by_the_clock_of_the_machine_is_told_in_its_own_words(
    fly, connect, eventually
):
    """It answers MAVLink FTP in its frames, but its list of logs has the times of files; so has ArduPilot's."""
    files = mavlink.MAVLink_file_transfer_protocol_message(0, 2, 1, [0] * 251)
    listed = mavlink.MAVLink_log_request_list_message(2, 1, 0, 0xFFFF)
    for kind, words in [(12, ["PX4"]), (3, ["FTP", "ArduPilot"]), (8, ["FTP", "may have"])]:
        async with fly() as flight:
            flight.autopilot.kind = kind
            flight.exchange_until(lambda flight=flight, kind=kind: flight.daemon.state.autopilot == kind)
            client = await connect(flight.daemon.listen_port)
            for message in (files, listed, listed):
                client.send(message)
                await eventually(lambda flight=flight: flight.daemon.statistics()["inputs_pending"])
                flight.exchange()
            assert len(flight.wall_time) == len(words)
            assert all(word in reason for word, reason in zip(words, flight.wall_time, strict=True))
            assert "LOG_ENTRY" in flight.wall_time[-1]


async def test_autopilot_that_does_not_read_is_told_and_loses_nothing(fly):
    async with fly(queue_limit_bytes=1 << 24) as flight:
        flight.exchange()
        daemon = flight.daemon
        raw = b"\xfd" + bytes(400)
        for now_ns in itertools.count(2 * TICK_NS, TICK_NS):
            daemon.begin_exchange(now_ns)
            for _ in range(MAX_WRITE_BYTES // len(raw)):
                daemon.link.outbox.put(raw)
            daemon.end_exchange()
            if daemon.counters.refused_writes >= 3:
                break
        assert "the autopilot does not read" in flight.wall_time[0]
        assert daemon.statistics()["exchange"]["unsent_bytes"] > 0
        assert daemon.link.unsent_bytes <= 2 * MAX_WRITE_BYTES
        sent = sum(data.count(raw) for _, direction, data in flight.said if direction == "to_autopilot")
        got = b""
        for later_ns in itertools.count(now_ns + TICK_NS, TICK_NS):
            with contextlib.suppress(BlockingIOError):
                got += flight.autopilot._connection.recv(1 << 22)
            daemon.begin_exchange(later_ns)
            daemon.end_exchange()
            if got.count(raw) >= sent and not daemon.link.unsent_bytes and not daemon.link.outbox.waiting:
                break


@pytest.mark.slow
async def test_flooding_client_waits_and_loses_nothing(fly, connect):
    async with fly(queue_limit_bytes=1 << 24, client_frames_per_s=1e6) as flight:
        client = await connect(flight.daemon.listen_port)
        frames = 60_000
        raw = b"".join(
            bytes(mavlink.MAVLink_named_value_int_message(0, b"n", n).pack(client.mav)) for n in range(frames)
        )
        client.writer.write(raw)
        for _ in range(50):
            await asyncio.sleep(0.001)
        pending = flight.daemon.statistics()["inputs_pending"]
        assert 1000 < pending < 30_000
        assert flight.daemon.counters.clients_paused == 1
        while flight.daemon.counters.inputs < frames + 1:
            flight.exchange()
            await asyncio.sleep(0.001)
        assert max(len(items) for items in flight.inputs.values()) < 30_000
        frame_inputs = [i.raw for items in flight.inputs.values() for i in items if i.kind == "frame"]
        assert b"".join(frame_inputs) == raw
        assert len(raw) > PENDING_LIMIT_BYTES


async def test_a_client_by_udp_that_cannot_wait_is_heard_no_further(fly, make_udp_peer, eventually):
    async with fly(client_frames_per_s=1e6) as flight:
        daemon = flight.daemon
        listener = await daemon.open("udp-in:127.0.0.1:0")
        peer = await make_udp_peer(("127.0.0.1", listener.port))
        raw = bytes(mavlink.MAVLink_rc_channels_override_message(2, 1, *[1500] * 8).pack(peer.mav))
        peer.send_raw(raw)
        await eventually(lambda: daemon.links.clients)
        while daemon.counters.inputs_dropped < 100:
            peer.send_raw(raw)
            await asyncio.sleep(0)
        flight.exchange()
        inputs = [item for items in flight.inputs.values() for item in items if item.kind == "frame"]
        assert len(inputs) == -(-PENDING_LIMIT_BYTES // len(raw))
        peer.send_raw(raw)
        await eventually(lambda: daemon.statistics()["inputs_pending"])


async def test_clients_that_come_and_go_between_exchanges_are_bounded(fly, eventually):
    async with fly(max_clients=4) as flight:
        for _ in range(10):
            with socket.create_connection(("127.0.0.1", flight.daemon.listen_port)):
                await asyncio.sleep(0.01)
        await eventually(lambda: flight.daemon.links.turned_away == 6)
        assert flight.daemon.statistics()["inputs_pending"] == 8
        flight.exchange()
        assert flight.daemon.router.links == (0,)
        with socket.create_connection(("127.0.0.1", flight.daemon.listen_port)):
            await eventually(lambda: len(flight.daemon.links.clients) == 1)


async def test_autopilot_that_hangs_up_is_noticed_at_an_exchange_and_connected_to_again(fly):
    downs = []
    async with fly() as flight:
        flight.daemon.on_link_down = lambda: downs.append(flight.tick)
        flight.exchange_until(lambda: flight.daemon.state.mode)
        flight.autopilot.hang_up()
        await asyncio.sleep(0.05)
        assert flight.daemon.link_up
        flight.daemon.begin_exchange(flight.tick * TICK_NS)
        flight.daemon.end_exchange()
        assert downs == [flight.tick]
        assert not flight.daemon.link_up
        await flight.daemon.connect()
        flight.autopilot.accept()
        flight.autopilot.intervals_us = {}
        flight.exchange_until(lambda: len(flight.autopilot.intervals_us) == 15)
        assert flight.daemon.statistics()["autopilot"]["connections"] == 2


async def test_connect_waits_for_an_autopilot_that_is_not_there_yet():
    with socket.socket() as late:
        late.bind(("127.0.0.1", 0))
        port = late.getsockname()[1]
        async with HeldDaemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=2)) as daemon:
            connecting = asyncio.create_task(daemon.connect())
            await asyncio.sleep(0.15)
            assert not daemon.link_up
            daemon.begin_exchange(0)
            daemon.end_exchange()
            late.listen()
            await asyncio.wait_for(connecting, 10)
            assert daemon.link_up


async def test_mistakes_of_the_caller_raise(fly):
    async with fly() as flight:
        daemon = flight.daemon
        flight.exchange()
        with pytest.raises(RuntimeError, match="no exchange has begun"):
            daemon.end_exchange()
        with pytest.raises(ValueError, match="sim time went back from 50000000 to 1 ns"):
            daemon.begin_exchange(1)
        daemon.begin_exchange(TICK_NS)
        with pytest.raises(RuntimeError, match="has not ended"):
            daemon.begin_exchange(TICK_NS)
        daemon.end_exchange()
        for inputs, message in (
            ([Input(1, "frame", b"")], "'frame' on link 1, which is not open"),
            ([Input(1, "open"), Input(1, "open")], "'open' on link 1, which is open"),
            ([Input(0, "open")], "the link of an input is 1 or higher, not 0"),
            ([Input(1, "open"), Input(1, "frame", b"\xfe")], "is not one MAVLink frame: fe"),
        ):
            with pytest.raises(ValueError, match=message):
                daemon.inject(inputs)
        assert daemon.statistics()["inputs_pending"] == 0


async def test_udp_output_is_no_input_until_its_peer_speaks(fly, make_udp_peer):
    peer = await make_udp_peer()
    async with fly(links=(f"udp-out:127.0.0.1:{peer.port}",)) as flight:
        flight.exchange_until(lambda: flight.daemon.state.mode)
        assert (await peer.next("HEARTBEAT")).get_srcSystem() == 2
        assert flight.inputs == {}
        peer.send(GUIDED)
        for _ in range(400):
            flight.exchange()
            await asyncio.sleep(0.001)
            if flight.daemon.state.mode == "GUIDED":
                break
        assert flight.daemon.state.mode == "GUIDED"
        kinds = [item.kind for items in flight.inputs.values() for item in items]
        assert kinds == ["open", "frame"]
        first = flight
    async with fly(record=first.inputs) as again:
        for _ in range(first.tick):
            again.exchange()
        assert again.said == first.said


async def test_a_tcp_link_of_wall_time_is_refused_for_a_held_autopilot():
    with pytest.raises(
        ValueError,
        match="a held autopilot has one link, tcp:HOST:PORT or udp-in:HOST:PORT, not 'serial:/dev/x'",
    ):
        HeldDaemon(DaemonConfig(autopilot="serial:/dev/x", sysid=2))


async def test_what_a_links_rules_keep_out_is_no_input(fly, make_udp_peer, eventually):
    peer = await make_udp_peer()
    async with fly(links=(f"udp-out:127.0.0.1:{peer.port},read-only",)) as flight:
        flight.exchange_until(lambda: flight.daemon.state.mode)
        await peer.next("HEARTBEAT")
        peer.send(GUIDED)
        (link,) = flight.daemon.links.clients.values()
        await eventually(lambda: link.counters.dropped_in == 1)
        for _ in range(20):
            flight.exchange()
        assert flight.inputs == {}
        assert flight.daemon.state.mode != "GUIDED"
