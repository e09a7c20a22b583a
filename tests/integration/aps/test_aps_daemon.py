"""The daemon between a scripted autopilot and pymavlink clients, over real sockets."""

import asyncio
import itertools
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.daemon import Daemon, DaemonConfig
from aps.vehicle.execution import Outcome


def config(autopilot, **kwargs):
    return DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2, **kwargs)


@pytest.fixture
async def daemon(autopilot):
    async with Daemon(config(autopilot)) as daemon:
        yield daemon


async def ready(daemon, eventually):
    await asyncio.wait_for(daemon.wait_heard(), 10)
    await eventually(lambda: daemon.state.ready_to_arm and daemon.state.lat_deg == 47.0)


async def test_state_arrives_and_streams_are_asked_for(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    await eventually(lambda: set(autopilot.intervals_us) == set(daemon.config.stream_rates_hz))
    assert autopilot.intervals_us[33] == 50_000
    await eventually(lambda: daemon.state.landed_state == "on_ground")
    await eventually(lambda: (daemon.state.mode, daemon.state.voltage_v) == ("STABILIZE", 12.0))
    assert daemon.state.connected


async def test_our_heartbeat_is_an_onboard_computer_of_the_ua(daemon, autopilot, eventually):
    await eventually(lambda: any(message.get_type() == "HEARTBEAT" for message in autopilot.heard))
    heartbeat = next(message for message in autopilot.heard if message.get_type() == "HEARTBEAT")
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (2, 191)
    assert heartbeat.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER


async def test_the_only_heartbeats_that_clients_see_are_the_vehicles(daemon, autopilot, connect, eventually):
    client = await connect(daemon.listen_port)

    def ours():
        return sum(message.get_type() == "HEARTBEAT" for message in autopilot.heard)

    before = ours()
    await eventually(lambda: ours() >= before + 2)
    senders = {(await client.next("HEARTBEAT")).get_srcComponent() for _ in range(10)}
    assert senders == {1}


async def test_two_clients_see_heartbeats_and_state(daemon, connect):
    clients = [await connect(daemon.listen_port), await connect(daemon.listen_port, 254)]
    for client in clients:
        heartbeat = await client.next("HEARTBEAT", lambda message: message.get_srcComponent() == 1)
        assert heartbeat.get_srcSystem() == 2
        position = await client.next("GLOBAL_POSITION_INT")
        assert position.lat == 470_000_000


async def test_command_of_a_client_is_answered_to_it_alone(daemon, autopilot, connect):
    alice, bob = await connect(daemon.listen_port), await connect(daemon.listen_port, 254)
    for client in (alice, bob):
        client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        await client.next("HEARTBEAT", lambda message: message.get_srcComponent() == 1)
    alice.send(mavlink.MAVLink_command_long_message(2, 1, 176, 0, 1, 5, 0, 0, 0, 0, 0))
    ack = await alice.next("COMMAND_ACK")
    assert (ack.command, ack.result, ack.target_system) == (176, 0, 255)
    bob.send(mavlink.MAVLink_command_long_message(2, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert (await bob.next("COMMAND_ACK")).command == 400
    assert [command.get_srcSystem() for command in autopilot.commands if command.command in (176, 400)] == [
        255,
        254,
    ]


async def test_fastest_stream_request_wins_and_survives_the_others_and_a_reboot(
    daemon, autopilot, connect, eventually
):
    alice, bob = await connect(daemon.listen_port), await connect(daemon.listen_port, 254)
    alice.send(mavlink.MAVLink_command_long_message(2, 1, 511, 0, 30, 20_000, 0, 0, 0, 0, 0))
    assert (await alice.next("COMMAND_ACK")).result == 0
    bob.send(mavlink.MAVLink_command_long_message(2, 1, 511, 0, 30, 500_000, 0, 0, 0, 0, 0))
    assert (await bob.next("COMMAND_ACK")).result == 0
    assert autopilot.intervals_us[30] == 20_000
    bob.send(mavlink.MAVLink_request_data_stream_message(2, 1, 1, 8, 1))
    await eventually(lambda: autopilot.intervals_us.get(27) == 125_000)
    assert not any(message.get_type() == "REQUEST_DATA_STREAM" for message in autopilot.heard)

    autopilot.boot()
    await eventually(lambda: autopilot.intervals_us.get(30) == 20_000)
    await eventually(lambda: autopilot.intervals_us.get(27) == 125_000)
    alice.close()
    await eventually(lambda: autopilot.intervals_us[30] == 100_000)


async def test_flight_by_commands(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    progress = []
    commands = daemon.commands
    assert (await commands.set_mode("GUIDED")).reached
    assert (await commands.arm()).reached
    assert (await commands.takeoff(30.0, progress.append)).reached
    assert daemon.state.alt_rel_m >= 28.5
    assert progress[0].phase == "accepted"
    remaining = [event.remaining_m for event in progress if event.phase == "feedback"]
    assert len(remaining) >= 2
    assert remaining == sorted(remaining, reverse=True)
    assert (await commands.goto(47.001, 8.001, 40.0)).reached
    assert (daemon.state.lat_deg, daemon.state.lon_deg) == pytest.approx((47.001, 8.001), abs=1e-6)
    assert (await commands.rtl()).reached
    assert daemon.state.flight_time_s > 1.0
    assert autopilot.height_m < 0.5


async def test_refusal_gives_the_autopilots_reason(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    autopilot.refuse[400] = (4, "Arm: Compass not calibrated")
    result = await daemon.commands.arm()
    assert (result.outcome, result.reason) == (Outcome.REFUSED, "FAILED: Arm: Compass not calibrated")


async def test_unanswered_command_is_repeated(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    autopilot.mute.add(400)
    arming = asyncio.create_task(daemon.commands.arm())
    await eventually(lambda: [c.confirmation for c in autopilot.commands if c.command == 400] == [0, 1])
    autopilot.mute.clear()
    assert (await asyncio.wait_for(arming, 10)).reached


async def test_newer_flight_command_interrupts_the_older(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    await daemon.commands.arm()
    climbing = asyncio.create_task(daemon.commands.takeoff(500.0))
    await eventually(lambda: autopilot.height_m > 5.0)
    landing = asyncio.create_task(daemon.commands.land())
    result = await asyncio.wait_for(climbing, 10)
    assert (result.outcome, result.reason) == (Outcome.INTERRUPTED, "by land")
    assert (await asyncio.wait_for(landing, 20)).reached


async def test_command_without_autopilot_is_refused_at_once(autopilot):
    await autopilot.stop()
    async with Daemon(config(autopilot)) as daemon:
        result = await daemon.commands.arm()
    assert (result.outcome, result.reason) == (Outcome.REFUSED, "the autopilot has not been heard")


async def test_autopilot_goes_away_and_comes_back(daemon, autopilot, connect, eventually):
    await ready(daemon, eventually)
    client = await connect(daemon.listen_port)
    await client.next("ATTITUDE")
    await autopilot.stop()
    await eventually(lambda: not daemon.link_up)
    autopilot.boot()
    await autopilot.start()
    await eventually(lambda: daemon.link_up and autopilot.connections == 2)
    await asyncio.wait_for(daemon.wait_heard(), 10)
    await eventually(lambda: set(autopilot.intervals_us) == set(daemon.config.stream_rates_hz))
    attitude = await client.next("ATTITUDE", lambda message: message.time_boot_ms < 60_000)
    assert attitude.get_srcSystem() == 2
    assert (await daemon.commands.arm()).reached


async def test_reboot_interrupts_a_flight(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    await eventually(lambda: daemon.state.time_boot_ms > 5000)
    await daemon.commands.arm()
    climbing = asyncio.create_task(daemon.commands.takeoff(500.0))
    await eventually(lambda: autopilot.height_m > 5.0)
    autopilot.boot()
    autopilot.intervals_us = {30: 1}
    result = await asyncio.wait_for(climbing, 10)
    assert (result.outcome, result.reason) == (Outcome.INTERRUPTED, "the autopilot rebooted")


async def test_streams_that_stop_are_asked_for_anew(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    await eventually(lambda: len(autopilot.intervals_us) == len(daemon.config.stream_rates_hz))
    autopilot.intervals_us = {}  # nothing but heartbeats from now on
    await eventually(lambda: len(autopilot.intervals_us) == len(daemon.config.stream_rates_hz))


async def test_subscription_at_a_rate_of_the_autopilots_time(daemon, eventually):
    await ready(daemon, eventually)
    states = []
    subscription = daemon.subscribe(states.append, rate_hz=2.0)
    await eventually(lambda: len(states) >= 6)
    subscription.cancel()
    count = len(states)
    steps = {after.time_boot_ms - before.time_boot_ms for before, after in itertools.pairwise(states)}
    assert max(steps) <= 600
    assert sum(steps) / len(steps) == pytest.approx(500, abs=100)
    now = daemon.state.time_boot_ms
    await eventually(lambda: daemon.state.time_boot_ms > now + 1500)
    assert len(states) == count
    with pytest.raises(ValueError, match="rate_hz must be positive, not 0"):
        daemon.subscribe(states.append, rate_hz=0)


async def test_subscription_keeps_its_rate_when_much_telemetry_comes_at_once(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    states = []
    daemon.subscribe(states.append, rate_hz=10.0)
    start_ms = autopilot.clock_ms + 1000
    messages = [
        mavlink.MAVLink_attitude_message(start_ms + ms, 0, 0, 0, 0, 0, 0) for ms in range(0, 10_000, 50)
    ]
    autopilot.send_raw(b"".join(bytes(message.pack(autopilot.mav)) for message in messages))
    autopilot.clock_ms = start_ms + 10_000  # its own messages go on from there: its clock must not go back
    await eventually(lambda: daemon.state.time_boot_ms >= start_ms + 9950)
    burst = [state.time_boot_ms for state in states if start_ms <= state.time_boot_ms <= start_ms + 9950]
    assert len(burst) == pytest.approx(100, abs=1)


async def test_autopilot_of_another_system_is_told(autopilot, caplog, eventually):
    async with Daemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=9)) as daemon:
        await eventually(lambda: "calls itself system 2, expected 9" in caplog.text)
        assert daemon.state.mode == ""


async def test_a_link_that_fails_of_itself_is_told_and_hangs_nobody(caplog, monkeypatch):
    def chokes(*_, **__):
        raise UnicodeError("a resolver that chokes on the name")

    told = []
    monkeypatch.setattr(socket, "getaddrinfo", chokes)
    async with Daemon(DaemonConfig(autopilot="tcp:chokes.example:5760", sysid=2)) as daemon:
        daemon.on_failure = told.append
        with pytest.raises(RuntimeError, match="the link to the autopilot failed: UnicodeError"):
            await asyncio.wait_for(daemon.wait_heard(), 10)
        assert isinstance(daemon.failure, UnicodeError)
        assert told == [daemon.failure]
        assert "UnicodeError" in daemon.statistics()["failure"]
    assert "the daemon of system 2 failed" in caplog.text


async def test_a_timer_that_fails_is_told(daemon, eventually, monkeypatch):
    def fail(now_ns):
        raise LookupError("a defect")

    monkeypatch.setattr(daemon.core, "on_time", fail)
    await eventually(lambda: isinstance(daemon.failure, LookupError))


async def test_a_failing_callback_is_counted_and_the_daemon_works_on(daemon, autopilot, eventually, caplog):
    def fail(_):
        raise RuntimeError("mine")

    daemon.texts = fail
    await ready(daemon, eventually)
    autopilot.send(mavlink.MAVLink_statustext_message(6, b"hello"))
    await eventually(lambda: daemon.statistics()["callback_errors"] == 1)
    assert "the callback for texts failed" in caplog.text
    assert (await daemon.commands.arm()).reached
    assert autopilot.connections == 1


async def test_started_commands_tell_their_end_once_and_may_start_others(daemon, autopilot, eventually):
    await ready(daemon, eventually)
    ends = []
    commands = daemon.commands

    def climb(result):
        ends.append(str(result))
        handles.append(commands.start("takeoff", 500.0, on_done=lambda result: ends.append(str(result))))

    handles = [commands.start("arm", on_done=climb)]
    await eventually(lambda: autopilot.height_m > 5.0)
    landing = commands.start("land", on_done=lambda result: ends.append(str(result)))
    assert ends == ["arm reached", "takeoff interrupted: by land"]
    landing.cancel()
    landing.cancel()
    assert ends[2:] == ["land interrupted: the caller gave up"]
    assert [str(handle.result) for handle in handles] == ends[:2]
    assert not commands.busy


@pytest.mark.parametrize(
    ("verb", "arguments", "message"),
    [
        ("fly", (), "command 'fly' is none of arm, disarm, mode, takeoff, hold, goto, "),
        ("takeoff", (), "wrong arguments of takeoff"),
        ("takeoff", ("high",), "alt_rel_m must be a number in"),
        ("takeoff", (1e9,), "alt_rel_m must be in"),
        ("mode", ("SWIM",), "mode 'SWIM' is none of"),
    ],
)
async def test_started_commands_check_their_arguments(daemon, eventually, verb, arguments, message):
    await ready(daemon, eventually)
    with pytest.raises(ValueError, match=message):
        daemon.commands.start(verb, *arguments)
    assert not daemon.commands.busy


async def test_a_daemon_whose_autopilots_port_is_taken_leaves_nothing_open():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with socket.socket(type=socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        taken = f"udp-in:127.0.0.1:{other.getsockname()[1]}"
        daemon = Daemon(DaemonConfig(autopilot=taken, sysid=2, listen_port=port))
        with pytest.raises(OSError, match="already in use"):
            await daemon.__aenter__()
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection("127.0.0.1", port)
