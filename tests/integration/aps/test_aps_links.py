"""Every kind of link, over real sockets and a pseudo-terminal."""

import asyncio
import contextlib
import hashlib
import os
import socket
import time
import tty

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.daemon import Daemon, DaemonConfig
from aps.links.kinds import udp
from aps.links.kinds.serial import SerialOutbox
from aps.links.link import Role
from aps.wire.signing import EPOCH_UNIX_US

HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
ARM = mavlink.MAVLink_command_long_message(2, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


def config(autopilot, *links, **settings):
    return DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2, links=links, **settings)


async def armed_by(client):
    """Have a client arm, and be told so."""
    client.send(HEARTBEAT)
    await client.next("HEARTBEAT", lambda message: message.get_srcComponent() == 1)
    client.send(ARM)
    ack = await client.next("COMMAND_ACK")
    assert (ack.command, ack.result) == (400, 0)


async def test_udp_out_sends_unasked_and_takes_commands(autopilot, make_udp_peer):
    peer = await make_udp_peer()
    async with Daemon(config(autopilot, f"udp-out:127.0.0.1:{peer.port}")):
        assert (await peer.next("ATTITUDE")).get_srcSystem() == 2
        await armed_by(peer)
    assert autopilot.armed


async def test_whoever_hears_a_broadcast_may_answer(autopilot, eventually):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("0.0.0.0", 0))
        station.setblocking(False)
        async with Daemon(config(autopilot, f"udp-out:127.255.255.255:{station.getsockname()[1]}")):
            loop = asyncio.get_running_loop()
            data, peer = await asyncio.wait_for(loop.sock_recvfrom(station, 2000), 10)
            assert data[0] == 0xFD
            mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
            station.sendto(bytes(HEARTBEAT.pack(mav)) + bytes(ARM.pack(mav)), peer)
            await eventually(lambda: autopilot.armed)


async def test_udp_out_waits_for_a_peer_that_comes_later(autopilot, make_udp_peer, eventually):
    peer = await make_udp_peer()
    port = peer.port
    peer.close()
    async with Daemon(config(autopilot, f"udp-out:127.0.0.1:{port}")) as daemon:
        (link,) = daemon.links.clients.values()
        await eventually(lambda: link.outbox.counters.written_frames > 10)
        loop = asyncio.get_running_loop()
        arrived = loop.create_future()

        class Late(asyncio.DatagramProtocol):
            def datagram_received(self, data, addr):
                if not arrived.done():
                    arrived.set_result(data)

        late, _ = await loop.create_datagram_endpoint(Late, local_addr=("127.0.0.1", port))
        assert (await asyncio.wait_for(arrived, 10))[0] == 0xFD
        late.close()


async def test_udp_in_serves_several_peers_each_by_itself(autopilot, make_udp_peer, eventually):
    async with Daemon(config(autopilot)) as daemon:
        listener = await daemon.open("udp-in:127.0.0.1:0")
        to = ("127.0.0.1", listener.port)
        alice, bob = await make_udp_peer(to), await make_udp_peer(to, sysid=254)
        for peer in (alice, bob):
            peer.send(HEARTBEAT)
            await peer.next("ATTITUDE")
        await armed_by(alice)
        assert len(daemon.links.clients) == 2
        await daemon.shut(listener)
        await eventually(lambda: not daemon.links.clients)


async def test_udp_peer_that_falls_silent_is_forgotten_and_its_wishes_with_it(
    autopilot, make_udp_peer, eventually, monkeypatch
):
    monkeypatch.setattr(udp, "PEER_SILENCE_S", 0.2)
    peer = await make_udp_peer()
    async with Daemon(config(autopilot, f"udp-out:127.0.0.1:{peer.port}")) as daemon:
        listener = await daemon.open("udp-in:127.0.0.1:0")
        other = await make_udp_peer(("127.0.0.1", listener.port))
        for number, client in ((26, peer), (27, other)):
            await daemon.wait_heard()
            if client is peer:
                await peer.next("ATTITUDE")
            client.send(mavlink.MAVLink_command_long_message(2, 1, 511, 0, number, 50_000, 0, 0, 0, 0, 0))
            await eventually(lambda number=number: autopilot.intervals_us.get(number) == 50_000)
        await eventually(lambda: autopilot.intervals_us[26] == autopilot.intervals_us[27] == 0)
        assert len(daemon.links.clients) == 1  # the port that is sent to stays
        assert (await peer.next("ATTITUDE")).get_srcSystem() == 2


async def test_tcp_connects_to_a_ground_stations_server_again_and_again(autopilot, eventually):
    connections = []

    async def serve(reader, writer):
        connections.append((reader, writer))

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    async with Daemon(config(autopilot, f"tcp:127.0.0.1:{port}")) as daemon:
        await eventually(lambda: len(connections) == 1)
        assert await connections[0][0].readexactly(1) in (b"\xfd", b"\xfe")
        connections[0][1].transport.abort()
        await eventually(lambda: len(connections) == 2)
        assert await connections[1][0].readexactly(1) in (b"\xfd", b"\xfe")
        assert len(daemon.links.clients) == 1
    for _, writer in connections:
        writer.transport.abort()
    server.close()


class Line:
    """The other end of a pseudo-terminal."""

    def __init__(self, sysid=255, compid=190):
        self.end, self.device_end = os.openpty()
        tty.setraw(self.device_end)
        self.device = os.ttyname(self.device_end)
        os.set_blocking(self.end, False)
        self.mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        self.mav.robust_parsing = True
        self.messages = []
        asyncio.get_running_loop().add_reader(self.end, self._read)

    def _read(self):
        with contextlib.suppress(BlockingIOError, OSError):
            self.messages += self.mav.parse_buffer(os.read(self.end, 4096)) or []

    def send(self, message):
        os.write(self.end, bytes(message.pack(self.mav)))

    def count(self, kind):
        return sum(message.get_type() == kind for message in self.messages)

    def close(self):
        asyncio.get_running_loop().remove_reader(self.end)
        os.close(self.end)
        os.close(self.device_end)


async def test_a_server_that_speaks_no_mavlink_and_hangs_up_is_tried_less_and_less_often(autopilot):
    loop, came_s, enough = asyncio.get_running_loop(), [], asyncio.Event()

    async def hang_up(_, writer):
        came_s.append(loop.time())
        writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        writer.close()
        if len(came_s) == 5:
            enough.set()

    server = await asyncio.start_server(hang_up, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    async with (
        server,
        Daemon(
            DaemonConfig(
                autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2, links=(f"tcp:127.0.0.1:{port}",)
            )
        ),
    ):
        await asyncio.wait_for(enough.wait(), 20)
    assert came_s[-1] - came_s[0] > 1.4  # 0.1 + 0.2 + 0.4 + 0.8 s


async def test_serial_line_to_a_ground_station(autopilot, eventually):
    line = Line()
    async with Daemon(config(autopilot, f"serial:{line.device}:57600")) as daemon:
        await eventually(lambda: line.count("ATTITUDE") > 3)
        line.send(ARM)
        await eventually(lambda: autopilot.armed)
        await eventually(lambda: line.count("COMMAND_ACK") >= 1)
        line.close()
        await eventually(lambda: not daemon.links.clients)


async def test_a_serial_line_that_cannot_keep_up_gets_what_is_new_and_one_that_can_gets_all():
    """57600 baud carry 5760 bytes a second. A list of 40 kB passes whole; of twice as much as it carries half does."""
    adapter, device = socket.socketpair()  # of which the system keeps little, as of a UART
    for line in (adapter, device):
        line.setblocking(False)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    now_s, frame = 0.0, bytes(96)
    outbox = SerialOutbox(1 << 18, device.fileno(), 5760, lambda: now_s)

    async def second(frames):
        """Ten ticks, in which the line carries what it can."""
        nonlocal now_s
        for _ in range(10):
            now_s += 0.1
            outbox.put_all([frame] * frames, 96 * frames)
            outbox.flush()
            with contextlib.suppress(BlockingIOError):
                adapter.recv(576)
            await asyncio.sleep(0)  # for the loop's own look at the line

    outbox.put_all([frame] * 420, 420 * 96)
    for _ in range(8):
        await second(0)
    assert (outbox.counters.dropped_full, len(outbox.waiting)) == (0, 0)
    while not outbox.counters.stalls:
        await second(12)
    assert now_s > 18.0
    for _ in range(30):
        await second(12)
        assert 0 < sum(map(len, outbox.waiting)) <= 5760
    while outbox.waiting:
        await second(0)
    dropped = outbox.counters.dropped_full
    await second(12)
    assert (outbox.counters.stalls, outbox.counters.dropped_full) == (1, dropped)
    outbox.close()
    for line in (adapter, device):
        line.close()


async def test_autopilot_on_a_serial_line(eventually):
    line = Line(sysid=2, compid=1)
    async with Daemon(DaemonConfig(autopilot=f"serial:{line.device}:115200", sysid=2)) as daemon:
        line.send(mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 5, 4, 3))
        await eventually(lambda: daemon.state.mode == "LOITER")
        await eventually(lambda: line.count("HEARTBEAT") >= 1)
        await eventually(lambda: line.count("COMMAND_LONG") >= 1)  # it asks for streams
    line.close()


async def test_an_unplugged_line_is_known_at_once_and_counts_on_when_it_is_back(tmp_path, eventually):
    device = tmp_path / "line"
    line = Line(sysid=2, compid=1)
    device.symlink_to(line.device)

    def beat(seq):
        line.mav.seq = seq
        line.send(mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 5, 4, 3))

    async with Daemon(DaemonConfig(autopilot=f"serial:{device}:115200", sysid=2)) as daemon:
        for seq in (1, 2, 5):  # two are missing
            beat(seq)
        await eventually(lambda: daemon.statistics()["autopilot"].get("frames_in") == 3)
        assert daemon.state.connected
        arming = daemon.commands.start("arm")
        device.unlink()
        line.close()
        await eventually(lambda: not daemon.link_up)
        assert not daemon.state.connected
        assert daemon.state.heartbeat_age_s < 5.0
        told = daemon.statistics()["autopilot"]
        assert (told["up"], told["lost_in"]) == (False, 2)
        assert arming.result.reason == "no link to the autopilot"
        assert (await daemon.commands.arm()).reason == "no link to the autopilot"

        line = Line(sysid=2, compid=1)
        device.symlink_to(line.device)
        await eventually(lambda: daemon.link_up)
        assert daemon.statistics()["autopilot"]["up"] is False
        beat(10)  # four more
        await eventually(lambda: daemon.statistics()["autopilot"]["up"])
        told = daemon.statistics()["autopilot"]
        assert (told["frames_in"], told["lost_in"], told["framer"]["frames"]) == (4, 6, 4)
        await eventually(lambda: line.count("HEARTBEAT") >= 1)
        commands = [message.command for message in line.messages if message.get_type() == "COMMAND_LONG"]
        assert 400 not in commands
    line.close()


async def test_autopilot_that_sends_to_our_udp_port(make_udp_peer, eventually):
    async with Daemon(DaemonConfig(autopilot="udp-in:127.0.0.1:0", sysid=2)) as daemon:
        (listener,) = (d for d in daemon.drivers if d.address.kind == "udp-in")
        vehicle = await make_udp_peer(("127.0.0.1", listener.port), sysid=2, compid=1)
        vehicle.send(mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 5, 4, 3))
        await eventually(lambda: daemon.state.mode == "LOITER")
        assert (await vehicle.next("COMMAND_LONG")).command == 511


async def test_second_way_to_the_autopilot_takes_over_when_the_first_falls_silent(
    autopilot, make_udp_peer, connect, eventually, monkeypatch
):
    monkeypatch.setattr("aps.links.traffic.CONNECTED_S", 0.5)
    async with Daemon(config(autopilot, more_autopilots=("udp-in:127.0.0.1:0",))) as daemon:
        await asyncio.wait_for(daemon.wait_heard(), 10)
        (listener,) = (d for d in daemon.drivers if d.address.kind == "udp-in")
        radio = await make_udp_peer(("127.0.0.1", listener.port), sysid=2, compid=1)
        client = await connect(daemon.listen_port)
        guided = mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 4, 4, 3)
        radio.send(guided)
        await eventually(lambda: len(daemon.router.links) == 3)
        assert daemon.state.mode == "STABILIZE"  # as the primary link says
        assert daemon.hub.primary.name.startswith("tcp:")
        await autopilot.stop()

        async def beat():
            while True:
                radio.send(guided)
                await asyncio.sleep(0.1)

        beating = asyncio.create_task(beat())
        await eventually(lambda: daemon.state.mode == "GUIDED")
        client.send(ARM)
        await radio.next("COMMAND_LONG", lambda message: message.command == 400)
        beating.cancel()


async def test_read_only_links_filters_and_rates(autopilot, make_udp_peer, eventually):
    peers = [await make_udp_peer() for _ in range(3)]
    links = [
        f"udp-out:127.0.0.1:{peer.port},{rules}"
        for peer, rules in zip(peers, ("read-only", "allow-out=30", "max-hz=30:2"), strict=True)
    ]
    async with Daemon(config(autopilot, *links)) as daemon:
        listener, only_attitude, slow = daemon.links.clients.values()
        for peer in peers:
            await peer.next("ATTITUDE")
        peers[0].send(ARM)
        await eventually(lambda: listener.counters.dropped_in == 1)
        assert not autopilot.armed
        await eventually(lambda: only_attitude.counters.dropped_out > 20)
        with pytest.raises(TimeoutError):
            await peers[1].next("GLOBAL_POSITION_INT", timeout_s=0.2)
        before_s = asyncio.get_running_loop().time()
        for _ in range(3):
            await peers[2].next("ATTITUDE")
        assert asyncio.get_running_loop().time() - before_s > 0.8
        assert slow.counters.dropped_rate_out > 50


async def test_links_that_cannot_be_opened_say_so_at_once(autopilot, make_udp_peer):
    peer = await make_udp_peer()
    with pytest.raises(OSError, match="in use"):
        async with Daemon(config(autopilot, f"udp-in:127.0.0.1:{peer.port}")):
            pass
    with pytest.raises(ValueError, match="cannot run at 123 baud"):
        async with Daemon(config(autopilot, "serial:/dev/null:123")):
            pass
    with pytest.raises(ValueError, match="is no link"):
        Daemon(config(autopilot, "carrier-pigeon:1"))


async def test_statistics_of_a_link(autopilot, make_udp_peer, eventually):
    peer = await make_udp_peer()
    async with Daemon(config(autopilot, f"udp-out:127.0.0.1:{peer.port}")) as daemon:
        await peer.next("ATTITUDE")
        assert daemon.statistics()["clients"][0]["up"] is False  # a socket is no link
        for seq in (1, 2, 5):  # two are missing
            peer.mav.seq = seq
            peer.send(HEARTBEAT)
        await eventually(lambda: daemon.statistics()["clients"][0]["frames_in"] == 3)
        told = daemon.statistics()["clients"][0]
        assert (told["up"], told["lost_in"], told["role"]) == (True, 2, Role.CLIENT.value)
        await eventually(lambda: daemon.statistics()["autopilot_links"][0]["rate_in_hz"] > 50)


async def test_autopilot_killed_and_restarted_ten_times_under_three_clients(
    autopilot, connect, make_udp_peer, eventually
):
    peer = await make_udp_peer()
    async with Daemon(config(autopilot, f"udp-out:127.0.0.1:{peer.port}")) as daemon:
        clients = [await connect(daemon.listen_port), await connect(daemon.listen_port, 254), peer]
        for client in clients:
            await client.next("ATTITUDE")
        clients[0].send(mavlink.MAVLink_command_long_message(2, 1, 511, 0, 30, 20_000, 0, 0, 0, 0, 0))
        await eventually(lambda: autopilot.intervals_us.get(30) == 20_000)
        links = set(daemon.links.clients)
        for restart in range(10):
            await autopilot.stop()
            await eventually(lambda: not daemon.link_up)
            autopilot.boot()
            before_s = asyncio.get_running_loop().time()
            await autopilot.start()
            await asyncio.wait_for(daemon.wait_heard(), 3.0)
            await eventually(lambda: autopilot.intervals_us.get(30) == 20_000, 3.0)
            assert asyncio.get_running_loop().time() - before_s < 3.0
            for client in clients:
                await client.next("ATTITUDE", lambda message: message.time_boot_ms < 60_000)
            assert autopilot.connections == restart + 2
        assert set(daemon.links.clients) == links


async def test_state_is_stale_while_the_autopilot_is_away(autopilot, eventually):
    async with Daemon(config(autopilot)) as daemon:
        await eventually(lambda: daemon.state.connected)
        await autopilot.stop()
        await eventually(lambda: not daemon.state.connected)
        await eventually(lambda: daemon.state.heartbeat_age_s > 0.3)
        assert daemon.statistics()["autopilot_links"] == []


@pytest.mark.slow
async def test_what_was_signed_counts_once_whatever_way_it_comes(
    autopilot, make_udp_peer, eventually, tmp_path
):
    (tmp_path / "key").write_text("a passphrase")
    keyed = f",key={tmp_path / 'key'}"
    async with Daemon(config(autopilot, tlog_directory=tmp_path / "logs")) as daemon:
        tcp = await daemon.open(f"tcp-server:127.0.0.1:0{keyed}")
        udp_in = await daemon.open(f"udp-in:127.0.0.1:0{keyed}")
        station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        signing = station.signing
        signing.secret_key, signing.sign_outgoing = hashlib.sha256(b"a passphrase").digest(), True
        signing.timestamp = time.time_ns() // 10_000 - EPOCH_UNIX_US // 10
        raw = bytes(ARM.pack(station))

        async def say_by_tcp():
            _, writer = await asyncio.open_connection("127.0.0.1", tcp.port)
            writer.write(raw)
            return writer

        def refused():
            return sum(link.signing.counters.old for link in daemon.links if link.signing is not None)

        writers = [await say_by_tcp()]
        await eventually(lambda: len(autopilot.commands) == 1)
        writers.append(await say_by_tcp())
        peer = await make_udp_peer(("127.0.0.1", udp_in.port))
        peer.send_raw(raw)
        await eventually(lambda: refused() == 2)
        for writer in writers:
            writer.close()
        assert len(autopilot.commands) == 1
    (tlog,) = (tmp_path / "logs").iterdir()
    assert raw not in tlog.read_bytes()
    log = mavutil.mavlink_connection(str(tlog))
    assert log.recv_match(type="COMMAND_LONG").command == 400
    log.close()


async def test_links_of_one_key_say_by_which_a_frame_goes(autopilot, tmp_path, eventually):
    (tmp_path / "key").write_text("a passphrase")
    keyed = f",key={tmp_path / 'key'}"
    async with Daemon(config(autopilot)) as daemon:
        port = (await daemon.open(f"tcp-server:127.0.0.1:0{keyed}")).port

        def ids():
            return sorted(link.signing.link_id for link in daemon.links if link.signing is not None)

        first, second = [await asyncio.open_connection("127.0.0.1", port) for _ in range(2)]
        await eventually(lambda: ids() == [0, 1])
        first[1].close()
        await eventually(lambda: ids() == [1])
        third = await asyncio.open_connection(
            "127.0.0.1", port
        )  # as one that comes back: the lowest that is free
        await eventually(lambda: ids() == [0, 1])
        for _, writer in (second, third):
            writer.close()
