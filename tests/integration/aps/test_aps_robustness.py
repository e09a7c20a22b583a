"""Slow, dead and babbling peers: the others must not notice."""

import asyncio
import socket
import time

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.daemon import Daemon, DaemonConfig


@pytest.fixture
async def daemon(autopilot, eventually):
    config = DaemonConfig(
        autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2, queue_limit_bytes=32 * 1024, max_clients=4
    )
    async with Daemon(config) as daemon:
        await eventually(lambda: set(autopilot.intervals_us) == set(config.stream_rates_hz))
        yield daemon


def deaf_socket(port):
    """A client that never reads, with a small receive buffer."""
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.connect(("127.0.0.1", port))
    return deaf


async def test_client_that_never_reads_costs_only_its_own_frames(daemon, autopilot, connect, eventually):
    with deaf_socket(daemon.listen_port):
        await eventually(lambda: len(daemon.links.clients) == 1)
        (deaf,) = daemon.links.clients.values()
        good = await connect(daemon.listen_port)
        await good.next("HEARTBEAT")
        # Numbered messages, far more than socket and queue of the deaf one hold; paced by the good one.
        batch, batches = 500, 100
        for number in range(batches):
            for at in range(batch):
                autopilot.send(mavlink.MAVLink_named_value_int_message(0, b"n", number * batch + at))
            last = (number + 1) * batch - 1
            await good.next("NAMED_VALUE_INT", lambda message, last=last: message.value == last)
            if deaf.outbox.counters.dropped_full:
                break
        assert deaf.outbox.counters.dropped_full > 0
        assert len(deaf.outbox.waiting) * 20 < 2 * 32 * 1024
        (other,) = (client for client in daemon.links.clients.values() if client is not deaf)
        assert other.outbox.counters.dropped_full == 0
        good.send(mavlink.MAVLink_command_long_message(2, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
        await eventually(lambda: autopilot.armed)
        counters = deaf.outbox.counters
        assert counters.queued_frames == counters.written_frames + counters.dropped_full + len(
            deaf.outbox.waiting
        )


@pytest.mark.slow
async def test_autopilot_that_does_not_read_costs_bounded_memory(daemon, autopilot, connect, eventually):
    client = await connect(daemon.listen_port)
    autopilot.reading.clear()
    blob = b"".join(
        bytes(mavlink.MAVLink_param_set_message(2, 1, b"P", n, 9).pack(client.mav)) for n in range(2000)
    )
    async with asyncio.timeout(30):
        while not daemon.hub.primary.outbox.counters.dropped_full:
            client.writer.write(blob)
            await asyncio.wait({asyncio.create_task(client.writer.drain())}, timeout=0.01)
            await client.next("ATTITUDE")  # state still flows the other way
    assert len(daemon.hub.primary.outbox.waiting) < 2000
    autopilot.reading.set()
    await eventually(lambda: not daemon.hub.primary.outbox.waiting)


async def test_client_that_vanishes_is_forgotten(daemon, connect, eventually):
    client = await connect(daemon.listen_port)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    await eventually(
        lambda: any(daemon.router.knows(n, 255, 190, time.monotonic_ns()) for n in daemon.router.links)
    )
    client.close()
    await eventually(lambda: not daemon.links.clients)
    assert daemon.router.links == (daemon.router.primary,)


async def test_clients_beyond_the_limit_are_turned_away(daemon, connect, eventually):
    clients = [await connect(daemon.listen_port) for _ in range(5)]
    await eventually(lambda: daemon.links.turned_away == 1 and len(daemon.links.clients) == 4)
    for client in clients[:4]:
        await client.next("HEARTBEAT")
    with pytest.raises((AssertionError, ConnectionError), match=r"closed|reset"):
        await clients[4].next("HEARTBEAT")


def babble(generator, seed_frames):
    """Random bytes, mutated frames, cut frames, good frames."""
    kind = generator.integers(4)
    if kind == 0:
        return generator.bytes(generator.integers(400))
    frame = bytearray(seed_frames[generator.integers(len(seed_frames))])
    if kind == 1:
        frame[generator.integers(len(frame))] ^= int(generator.integers(1, 256))
    elif kind == 2:
        del frame[generator.integers(len(frame)) :]
    return bytes(frame)


def some_frames(mav, generator):
    """Good frames of every seventh message type."""
    for cls in list(mavlink.mavlink_map.values())[::7]:
        lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
        values = []
        for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True):
            if kind == "char":
                values.append(generator.bytes(lengths[name]))
            else:
                values.append([1] * lengths[name] if lengths[name] > 1 else 1)
        yield bytes(cls(*values).pack(mav))


async def test_fuzz_from_both_sides_while_a_valid_client_works(daemon, autopilot, connect, caplog):
    generator = np.random.default_rng(7)
    good, bad = await connect(daemon.listen_port), await connect(daemon.listen_port, 77, 77)
    seeds = [*some_frames(bad.mav, generator), *some_frames(autopilot.mav, generator)]
    for round_number in range(40):
        for _ in range(50):
            bad.writer.write(babble(generator, seeds))
            autopilot.send_raw(babble(generator, seeds))
        autopilot.send_raw(bytes(300))  # ends whatever a false start marker waits for
        position = await good.next("GLOBAL_POSITION_INT", lambda message: message.get_srcSystem() == 2)
        assert position.get_srcComponent() == 1
        mode = 4 + round_number % 2
        good.send(mavlink.MAVLink_command_long_message(2, 1, 176, 0, 1, mode, 0, 0, 0, 0, 0))
        ack = await good.next("COMMAND_ACK", lambda message: message.command == 176)
        assert ack.get_srcSystem() == 2
    assert daemon.hub.primary.framer.counters.bad_crc > 100
    assert sum(client.framer.counters.bad_crc for client in daemon.links.clients.values()) > 100
    assert "Traceback" not in caplog.text
    assert len(daemon.links.clients) == 2
