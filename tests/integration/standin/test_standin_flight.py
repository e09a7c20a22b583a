"""The stand-in autopilot as a process, on real sockets, flying JSBSim's F450 in the exchange."""

import contextlib
import math
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridge.program.standins import frame_parameters
from fdm.air.wind import load_wind
from fdm.exchange.exchange import AircraftSpec, Exchange
from fdm.exchange.hosted_aircraft import Disturb
from fdm.model.air_point import Wind
from fdm.model.airframe import Airframe, load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel
from fdm.model.truth import TrueState
from standin import client_socket, sockets
from standin.autopilot import Autopilot
from standin.process import Process
from standin.vehicle.location import Location
from standin.vehicle.parameters import StandinParameters

HEADING_DEG = 120.0
HOME_TEXT = f"45,10,100,{HEADING_DEG}"
SYSID = 3
GUIDED, LOITER, RTL = 4, 5, 6
WALL_TIMEOUT_S = 40.0
POSITION_ONLY, VELOCITY_ONLY = 0x0DF8, 0x0DC7
STREAMED_MS = {32: 100, 245: 200}


class Client:
    """A MAVLink client on TCP."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10.0)
        self._socket.settimeout(WALL_TIMEOUT_S)
        self._codec = dialect.MAVLink(None, 255, 190)
        self._codec.robust_parsing = True
        self.heard: list[Any] = []

    def close(self) -> None:
        self._socket.close()

    def settimeout(self, timeout_s: float) -> None:
        self._socket.settimeout(timeout_s)

    def send(self, message: Any) -> None:
        self._socket.sendall(message.pack(self._codec))

    def send_bytes(self, data: bytes) -> None:
        self._socket.sendall(data)

    def wait(self, wanted: Callable[[Any], bool]) -> Any:
        """Return the next message that is wanted."""
        deadline = time.monotonic() + WALL_TIMEOUT_S
        while time.monotonic() < deadline:
            data = self._socket.recv(65536)
            assert data, "the autopilot closed the connection"
            found = None
            for message in self._codec.parse_buffer(data) or []:
                self.heard.append(message)
                if found is None and wanted(message):
                    found = message
            if found is not None:
                return found
        raise AssertionError("what was waited for did not come")

    def wait_for(self, kind: str, **fields: Any) -> Any:
        return self.wait(
            lambda m: (
                m.get_type() == kind and all(getattr(m, name) == value for name, value in fields.items())
            )
        )

    def command(self, number: int, *parameters: float) -> int:
        padded = [*parameters, *([0.0] * (7 - len(parameters)))]
        self.send(dialect.MAVLink_command_long_message(SYSID, 1, number, 0, *padded))
        return int(self.wait_for("COMMAND_ACK", command=number).result)

    def wait_near(self, north_m: float, east_m: float, down_m: float, radius_m: float = 0.5) -> Any:
        return self.wait(
            lambda m: (
                m.get_type() == "LOCAL_POSITION_NED"
                and math.dist((m.x, m.y, m.z), (north_m, east_m, down_m)) < radius_m
            )
        )

    def wait_disarmed(self) -> None:
        self.wait(lambda m: m.get_type() == "HEARTBEAT" and not m.base_mode & 128)

    def texts(self) -> list[str]:
        return [m.text for m in self.heard if m.get_type() == "STATUSTEXT"]


class Flight:
    """An exchange, the autopilot and a client; ``truth`` is what really happened."""

    def __init__(
        self,
        airframe: Airframe,
        wind_ned_mps: tuple[float, float, float],
        wind: Wind | None,
        disturb: Disturb | None,
        *more: str,
    ) -> None:
        def build(airframe: Airframe, home: Home) -> JsbsimModel:
            model = JsbsimModel(airframe, home)
            model.set_wind(wind_ned_mps)
            return model

        self.truth: list[TrueState] = []
        home = Home(GeodeticPosition(45.0, 10.0, 100.0), HEADING_DEG)
        self.exchange = Exchange(
            [AircraftSpec(0, airframe, home, 0, wind, disturb)],
            speed=math.inf,
            on_truth=self.truth.append,
            build_model=build,
        )
        self.thread = threading.Thread(target=self.exchange.run)
        self.thread.start()
        self.process = start(self.exchange.ports[0], *more)
        self.client = Client(port_of(self.process))
        for message_id, interval_ms in STREAMED_MS.items():
            assert self.client.command(511, message_id, interval_ms * 1000) == 0

    def close(self) -> None:
        self.client.close()
        self.process.terminate()
        try:
            assert self.process.wait(5.0) == 0
        finally:
            self.process.kill()
            self.process.wait()
            if self.process.stdout is not None:
                self.process.stdout.close()
            self.exchange.stop()
            self.thread.join(5.0)
            self.exchange.close()

    def ready_to_fly(self) -> None:
        self.client.wait_for("STATUSTEXT", text="EKF3 IMU0 is using GPS")
        assert self.client.command(176, 1, GUIDED) == 0
        assert self.client.command(400, 1) == 0

    def take_off(self, height_m: float) -> None:
        self.ready_to_fly()
        assert self.client.command(22, 0, 0, 0, 0, 0, 0, height_m) == 0
        self.client.wait(lambda m: m.get_type() == "LOCAL_POSITION_NED" and m.z < -height_m + 0.3)

    def run_for(self, duration_s: float) -> list[TrueState]:
        """Let sim time pass; return what happened."""
        start_ms = self.client.wait_for("LOCAL_POSITION_NED").time_boot_ms
        first = len(self.truth)
        self.client.wait(
            lambda m: m.get_type() == "LOCAL_POSITION_NED" and m.time_boot_ms >= start_ms + duration_s * 1000
        )
        return self.truth[first:]


def start(fdm_port: int, *more: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "standin", "--sysid", str(SYSID), "--home", HOME_TEXT]
    command += ["--fdm-port", str(fdm_port), "--mavlink-port", "0", *more]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def port_of(child: "subprocess.Popen[str]") -> int:
    assert child.stdout is not None
    line = child.stdout.readline()
    assert line.startswith("ready: sysid 3, MAVLink tcp:127.0.0.1:"), line
    return int(line.split("tcp:127.0.0.1:")[1].split(",")[0])


@contextlib.contextmanager
def flying(
    *more: str,
    airframe_name: str = "f450",
    wind_ned_mps: tuple[float, float, float] = (0.0, 0.0, 0.0),
    wind: Wind | None = None,
    thrust_scale: float = 1.0,
    disturb: Disturb | None = None,
) -> Iterator[Flight]:
    airframe = load_airframe(airframe_name)
    if thrust_scale != 1.0:
        channels = tuple(
            channel.model_copy(update={"scale_per_us": channel.scale_per_us * thrust_scale})
            for channel in airframe.channels
        )
        airframe = airframe.model_copy(update={"channels": channels})
    flight = Flight(airframe, wind_ned_mps, wind, disturb, *more)
    try:
        yield flight
    finally:
        flight.close()


def spread_m(truth: list[TrueState], around: tuple[float, float, float]) -> float:
    return max(math.dist(one.position_ned_m, around) for one in truth)


def tilt_deg(one: TrueState) -> float:
    _, x, y, _ = one.attitude_wxyz
    return math.degrees(math.acos(1.0 - 2.0 * (x * x + y * y)))


@pytest.mark.slow
def test_guided_flight_from_refusal_to_disarm() -> None:
    with flying() as flight:
        client = flight.client
        assert client.command(400, 1) == 4, "not ready yet"
        assert client.texts()[-1:] == [] or client.texts()[-1].startswith("Arm: ")
        flight.take_off(10.0)
        flight.run_for(3.0)
        start_ned = flight.truth[-1].position_ned_m
        hover = flight.run_for(10.0)
        assert spread_m(hover, (start_ned[0], start_ned[1], -10.0)) < 0.3
        assert max(math.hypot(*one.position_ned_m[:2]) for one in hover) < 0.3

        def goto(*place_ned_m: float) -> None:
            rest = (*place_ned_m, *[0.0] * 8)
            client.send(
                dialect.MAVLink_set_position_target_local_ned_message(0, SYSID, 1, 1, POSITION_ONLY, *rest)
            )

        goto(0.0, 0.0, -10.0)  # the speed is that of points, and would end with the take-off
        assert client.command(178, 1, 8.0) == 0
        first = len(flight.truth)
        goto(100.0, 0.0, -12.0)
        client.wait_near(100.0, 0.0, -12.0)
        flight.run_for(4.0)
        leg = flight.truth[first:]
        assert max(one.position_ned_m[0] for one in leg) < 100.3, "overshoot"
        assert max(abs(one.position_ned_m[1]) for one in leg) < 0.3, "cross-track"
        speeds = [math.hypot(*one.velocity_ned_mps[:2]) for one in leg]
        assert max(speeds) == pytest.approx(8.0, abs=0.3)
        assert max(tilt_deg(one) for one in leg) < 31.0

        first = len(flight.truth)
        client.send(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, SYSID, 1, 1, VELOCITY_ONLY, 0, 0, 0, 0.0, 3.0, -1.0, 0, 0, 0, 0, 0
            )
        )
        flight.run_for(6.5)
        leg = flight.truth[first:]
        assert max(one.velocity_ned_mps[1] for one in leg) == pytest.approx(3.0, abs=0.4)
        assert min(one.velocity_ned_mps[2] for one in leg) == pytest.approx(-1.0, abs=0.2)
        assert math.hypot(*leg[-1].velocity_ned_mps) < 0.1, "a velocity target ends after GUID_TIMEOUT"

        assert client.command(176, 1, LOITER) == 0
        client.send(dialect.MAVLink_manual_control_message(SYSID, 0, 0, 500, 0, 0))
        held = flight.truth[-1].position_ned_m
        assert spread_m(flight.run_for(2.5), held) < 0.3
        assert flight.run_for(3.0)[-1].velocity_ned_mps[2] > 1.0, "without a stick it sinks"

        assert client.command(400, 0) == 4, "no disarming in flight"
        assert client.command(176, 1, RTL) == 0
        first = len(flight.truth)
        client.wait_disarmed()
        back = flight.truth[first:]
        assert math.hypot(*back[-1].position_ned_m[:2]) < 0.5
        assert back[-1].position_ned_m[2] == pytest.approx(flight.truth[0].position_ned_m[2], abs=0.05)
        landing = [one.velocity_ned_mps[2] for one in back if -5.0 < one.position_ned_m[2] < -0.5]
        assert max(landing) < 0.7, "touches down gently"
        client.wait_for("EXTENDED_SYS_STATE", landed_state=1)
        states = [m.landed_state for m in client.heard if m.get_type() == "EXTENDED_SYS_STATE"]
        assert [a for a, b in zip(states, [*states[1:], None], strict=True) if a != b] == [1, 3, 2, 4, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("airframe_name", "wind_name", "hover_limit_m"),
    [
        ("f450", "calm", 0.3),
        ("hexa550", "breeze", 1.5),
        pytest.param("f450", "breeze", 1.5, marks=pytest.mark.long),
        pytest.param("hexa550", "calm", 0.3, marks=pytest.mark.long),
    ],
)
def test_a_square_is_flown_as_arducopter_flies_it(
    airframe_name: str, wind_name: str, hover_limit_m: float
) -> None:
    brisk = {"WPNAV_ACCEL": 500.0, "RTL_ALT": 1000.0, "LAND_SPEED": 100.0}
    settings = frame_parameters(load_airframe(airframe_name)) | brisk
    given = [word for name, value in settings.items() for word in ("--parameter", f"{name}={value:g}")]
    wind = load_wind(wind_name).build(seed=1, ua_id=0)
    with flying(*given, airframe_name=airframe_name, wind=wind) as flight:
        client = flight.client
        flight.take_off(10.0)
        assert client.command(178, 1, 15.0) == 0

        def goto(north_m: float, east_m: float) -> None:
            client.send(
                dialect.MAVLink_set_position_target_local_ned_message(
                    0, SYSID, 1, 1, POSITION_ONLY, north_m, east_m, -10.0, 0, 0, 0, 0, 0, 0, 0, 0
                )
            )
            client.wait_near(north_m, east_m, -10.0, 1.0)

        goto(0.0, 0.0)
        flight.run_for(4.0)
        hover_m = spread_m(flight.run_for(10.0), (0.0, 0.0, -10.0))
        first = len(flight.truth)
        for corner in ((100.0, 0.0), (100.0, 100.0), (0.0, 100.0), (0.0, 0.0)):
            goto(*corner)
        square = flight.truth[first:]
        assert client.command(176, 1, RTL) == 0
        client.wait_disarmed()
        landed = flight.truth[-1]
        print(f"{landed.sim_time_ns / 1e9:.0f} s of sim time")
    heights = [-one.position_ned_m[2] for one in square]
    print(
        f"{airframe_name}, {wind_name}: hover within {hover_m:.2f} m, square at {min(heights):.1f} to "
        f"{max(heights):.1f} m, landed {math.hypot(*landed.position_ned_m[:2]):.2f} m from home"
    )
    assert hover_m < hover_limit_m
    assert max(abs(height - 10.0) for height in heights) < 2.0
    assert math.hypot(*landed.position_ned_m[:2]) < 1.5


def test_mission_is_flown_in_auto() -> None:
    def item(seq: int, command: int, north_m: float, height_m: float, param1: float = 0.0) -> Any:
        lat = round((45.0 + north_m / 111318.845) * 1e7)
        frame = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        return dialect.MAVLink_mission_item_int_message(
            SYSID, 1, seq, frame, command, 0, 1, param1, 0, 0, 0, lat, 100_000_000, height_m, 0
        )

    items = [
        item(0, 16, 0, 0),
        item(1, 22, 0, 8),
        item(2, 16, 40, 10),
        item(3, 19, 60, 10, 4.0),
        item(4, 21, 50, 0),
    ]
    with flying() as flight:
        client = flight.client
        client.send(dialect.MAVLink_mission_count_message(SYSID, 1, len(items), 0))
        for expected in range(len(items)):
            assert client.wait_for("MISSION_REQUEST").seq == expected
            client.send(items[expected])
        assert client.wait_for("MISSION_ACK").type == 0
        flight.ready_to_fly()
        assert client.command(300) == 0
        client.wait_disarmed()
        assert [m.seq for m in client.heard if m.get_type() == "MISSION_ITEM_REACHED"] == [1, 2, 3], (
            "LAND is not told"
        )
        north = [one.position_ned_m[0] for one in flight.truth]
        assert max(north) == pytest.approx(60.0, abs=0.5)
        loitered = [one for one in flight.truth if math.dist(one.position_ned_m, (60.0, 0.0, -10.0)) < 2.5]
        assert len(loitered) * 0.05 > 4.0
        assert math.dist(flight.truth[-1].position_ned_m[:2], (50.0, 0.0)) < 0.5


@pytest.mark.slow
def test_eight_metres_of_wind_are_borne() -> None:
    with flying(wind_ned_mps=(-5.0, 6.2, 0.0)) as flight:
        client = flight.client
        flight.take_off(6.0)
        flight.run_for(8.0)
        hold = flight.truth[-1].position_ned_m
        hover = flight.run_for(10.0)
        assert spread_m(hover, (hold[0], hold[1], -6.0)) < 0.5
        assert client.command(178, 1, 12.0) == 0
        first = len(flight.truth)
        client.send(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, SYSID, 1, 1, POSITION_ONLY, 120.0, 0.0, -6.0, 0, 0, 0, 0, 0, 0, 0, 0
            )
        )
        client.wait_near(120.0, 0.0, -6.0)
        flight.run_for(5.0)
        assert max(one.position_ned_m[0] for one in flight.truth[first:]) < 120.5
        assert max(tilt_deg(one) for one in flight.truth) < 32.0
        client.send(dialect.MAVLink_command_long_message(SYSID, 1, 512, 0, 168, 0, 0, 0, 0, 0, 0))
        wind = client.wait_for("WIND")
        assert wind.speed == pytest.approx(8.0, abs=1.0)
        assert (wind.direction - math.degrees(math.atan2(-6.2, 5.0)) + 180) % 360 - 180 == pytest.approx(
            0, abs=10
        )
        assert client.command(21) == 0
        client.wait_disarmed()


@pytest.mark.parametrize("thrust_scale", [0.65, 1.6])
def test_the_hover_throttle_is_learned(thrust_scale: float) -> None:
    with flying(thrust_scale=thrust_scale) as flight:
        flight.take_off(5.0)
        assert max(-one.position_ned_m[2] for one in flight.truth) < 6.0
        flight.run_for(5.0)
        hold = flight.truth[-1].position_ned_m
        assert spread_m(flight.run_for(4.0), (hold[0], hold[1], -5.0)) < 0.3


# --- the process and its sockets ---


@contextlib.contextmanager
def physics() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        udp.settimeout(10.0)
        yield udp


@contextlib.contextmanager
def autopilot(fdm_port: int, *more: str) -> Iterator[tuple["subprocess.Popen[str]", int]]:
    child = start(fdm_port, *more)
    try:
        yield child, port_of(child)
    finally:
        child.kill()
        child.wait()
        if child.stdout is not None:
            child.stdout.close()


FRAME = (
    '\n{{"timestamp":{:.4f},"imu":{{"gyro":[0,0,0],"accel_body":[0,0,-9.8]}},"position":[0,0,0],'
    '"velocity":[0,0,0],"quaternion":[1,0,0,0],"no_time_sync":1}}\n'
)


def exchange_frames(udp: socket.socket, first: int, count: int) -> None:
    for index in range(first, first + count):
        packet, source = udp.recvfrom(256)
        assert int.from_bytes(packet[4:8], "little") == index
        udp.sendto(FRAME.format((index + 1) / 400).encode(), source)


def test_silent_physics_gets_the_same_frame_again_and_mavlink_waits_for_the_next() -> None:
    with physics() as udp, autopilot(udp.getsockname()[1]) as (_, port):
        exchange_frames(udp, 0, 10)
        client = Client(port)
        packet, source = udp.recvfrom(256)
        client.send(dialect.MAVLink_param_request_read_message(SYSID, 1, b"RTL_ALT", -1))
        asked = time.monotonic()
        assert udp.recv(256) == udp.recv(256) == packet
        assert 1.5 < time.monotonic() - asked < 4.0
        assert packet[4:8] == bytes((10, 0, 0, 0))
        client.settimeout(0.1)
        with pytest.raises(TimeoutError):
            client.wait_for("PARAM_VALUE")
        client.settimeout(WALL_TIMEOUT_S)
        udp.sendto(FRAME.format(11 / 400).encode(), source)
        assert client.wait_for("PARAM_VALUE").param_value == 1500.0
        client.close()


def test_physics_that_comes_later_is_found_at_once() -> None:
    with physics() as udp:
        address = udp.getsockname()
    with autopilot(address[1]), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(address)
        udp.settimeout(10.0)
        since = time.monotonic()
        udp.recv(256)
        assert time.monotonic() - since < 1.0  # not after 1.1 s, as in silence
        udp.settimeout(0.5)
        with pytest.raises(TimeoutError):
            udp.recv(256)


def test_garbage_on_both_sockets_is_survived() -> None:
    with physics() as udp, autopilot(udp.getsockname()[1]) as (child, port):
        exchange_frames(udp, 0, 10)
        packet, source = udp.recvfrom(256)
        for junk in (b"", b"{", b"\xff" * 2000, b"[" * 60000, b'{"timestamp":NaN}', packet):
            udp.sendto(junk, source)
        client = Client(port)
        client.send_bytes(bytes(range(256)) * 40 + b"\xfd\xff\x00" + b"\xfe" * 300)
        client.send_bytes(bytes(300))
        client.send(dialect.MAVLink_param_request_read_message(SYSID, 1, b"RTL_ALT", -1))
        udp.sendto(FRAME.format(11 / 400).encode(), source)
        assert client.wait_for("PARAM_VALUE").param_value == 1500.0
        exchange_frames(udp, 11, 10)
        assert child.poll() is None
        client.close()


def test_one_client_at_a_time_and_the_next_is_served_when_it_is_gone() -> None:
    with physics() as udp, autopilot(udp.getsockname()[1]) as (_, port):
        first, second = Client(port), Client(port)
        request = dialect.MAVLink_param_request_read_message(SYSID, 1, b"RTL_ALT", -1)
        first.send(request)
        second.send(request)
        exchange_frames(udp, 0, 5)
        first.wait_for("PARAM_VALUE")
        second.settimeout(0.2)
        with pytest.raises(TimeoutError):
            second.wait_for("PARAM_VALUE")
        second.settimeout(WALL_TIMEOUT_S)
        first.close()
        exchange_frames(udp, 5, 5)
        assert second.wait_for("PARAM_VALUE").param_id == "RTL_ALT", "what it had asked is answered now"
        second.close()


@contextlib.contextmanager
def deaf_client_of_a_served_autopilot(
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[tuple[sockets.AutopilotSockets, socket.socket, socket.socket]]:
    """An autopilot in a thread, its physics, and a client that asked for all messages and reads none."""
    monkeypatch.setattr(client_socket, "SEND_BUFFER_BYTES", 8192)
    core = Autopilot(Location(45.0, 10.0, 100.0), StandinParameters(), frame_rate_hz=400, boot_unix_us=0)
    with physics() as udp, socket.socket() as deaf:
        served = sockets.AutopilotSockets(core, udp.getsockname(), ("127.0.0.1", 0))
        server = Process([served])
        thread = threading.Thread(target=server.run)
        thread.start()
        try:
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16384)
            deaf.connect(("127.0.0.1", served.mavlink_port))
            codec = dialect.MAVLink(None, 255, 190)
            for message_id in range(256):  # those that it has not it refuses
                request = dialect.MAVLink_command_long_message(1, 1, 511, 0, message_id, 3000, 0, 0, 0, 0, 0)
                deaf.sendall(request.pack(codec))
            yield served, udp, deaf
        finally:
            server.stop()
            thread.join(5.0)
            assert not thread.is_alive()
            server.close()


def exchange_until_held_back(udp: socket.socket, silence_s: float = 0.5) -> int:
    """Answer frames until the autopilot waits for its client; return how many it sent."""
    udp.settimeout(silence_s)
    frames = 0
    with contextlib.suppress(TimeoutError):
        for frames in range(100_000):
            exchange_frames(udp, frames, 1)
    udp.settimeout(10.0)
    return frames


def test_a_client_that_is_slow_to_read_holds_the_simulation_back_and_loses_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with deaf_client_of_a_served_autopilot(monkeypatch) as (server, udp, deaf):
        frames = exchange_until_held_back(udp)
        assert frames > 20, "the kernel holds more than a tick"
        deaf.setblocking(False)
        heard = b""
        while True:
            with contextlib.suppress(BlockingIOError):
                heard += deaf.recv(65536)
            with contextlib.suppress(BlockingIOError):
                packet = udp.recv(256, socket.MSG_DONTWAIT)
                break
        assert int.from_bytes(packet[4:8], "little") == frames
        deaf.setblocking(True)
        deaf.settimeout(0.3)
        with contextlib.suppress(TimeoutError):
            while data := deaf.recv(65536):
                heard += data
        numbers = [m.get_seq() for m in dialect.MAVLink(None).parse_buffer(heard) or []]
        assert numbers == [index % 256 for index in range(len(numbers))]
        assert not server.errors


def test_a_client_that_stays_deaf_is_let_go_and_the_flight_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_socket, "DEAF_MAX_S", 1.5)
    with deaf_client_of_a_served_autopilot(monkeypatch) as (server, udp, _):
        frames = exchange_until_held_back(udp)
        assert not server.errors
        other = Client(server.mavlink_port)
        deadline = time.monotonic() + WALL_TIMEOUT_S
        while not server.errors and time.monotonic() < deadline:
            exchange_frames(udp, frames, 1)
            frames += 1
        assert server.errors == {"client_deaf": 1}
        other.send(dialect.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1))
        exchange_frames(udp, frames, 10)
        assert other.wait_for("PARAM_VALUE").param_value == 1500.0
        other.close()


def test_it_can_be_stopped_while_a_client_holds_it_back(monkeypatch: pytest.MonkeyPatch) -> None:
    with deaf_client_of_a_served_autopilot(monkeypatch) as (_, udp, _):
        exchange_until_held_back(udp)


def test_ends_on_sigterm_and_tells_mistakes_in_one_line() -> None:
    with physics() as udp, autopilot(udp.getsockname()[1]) as (child, port):
        taken = [sys.executable, "-m", "standin", "--home", HOME_TEXT]
        result = subprocess.run(
            [*taken, "--mavlink-port", str(port)], capture_output=True, text=True, timeout=20, check=False
        )
        assert result.returncode == 2
        assert result.stderr.count("\n") == 1
        assert f"TCP 127.0.0.1:{port}" in result.stderr
        assert "--mavlink-port" in result.stderr
        for setting, says in (
            ("FRAME_CLASS", "is not the name of a parameter"),
            ("NONE=1", "is not the name"),
        ):
            result = subprocess.run(
                [*taken, "--parameter", setting], capture_output=True, text=True, timeout=20, check=False
            )
            assert result.returncode == 2
            assert says in result.stderr
        result = subprocess.run(
            [*taken, "--mavlink-port", "0", "--parameter", "FRAME_CLASS=3"],
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
        )
        assert result.returncode == 2
        assert result.stderr.startswith("standin: FRAME_CLASS 3 with FRAME_TYPE 1: the stand-in flies")
        asked = time.monotonic()
        child.terminate()
        assert child.wait(5.0) == 0
        assert time.monotonic() - asked < 1.0


# --- several in one process ---


def answer_frame(udp: socket.socket, index: int) -> None:
    """Answer servo packet ``index``; those that were sent again are passed over."""
    while True:
        packet, source = udp.recvfrom(256)
        if int.from_bytes(packet[4:8], "little") == index:
            udp.sendto(FRAME.format((index + 1) / 400).encode(), source)
            return


def test_two_in_one_process_are_apart() -> None:
    with physics() as one, physics() as other:
        more = ["+", "--sysid", "9", "--home", HOME_TEXT, "--mavlink-port", "0"]
        more += ["--fdm-port", str(other.getsockname()[1]), "--parameter", "RTL_ALT=77"]
        with autopilot(one.getsockname()[1], *more) as (child, port):
            assert child.stdout is not None
            line = child.stdout.readline()
            assert line.startswith("ready: sysid 9, MAVLink tcp:127.0.0.1:")
            first, second = Client(port), Client(int(line.split("tcp:127.0.0.1:")[1].split(",")[0]))
            first.send(dialect.MAVLink_param_request_read_message(0, 1, b"RTL_ALT", -1))
            second.send(dialect.MAVLink_param_request_read_message(0, 1, b"RTL_ALT", -1))
            for index in range(20):
                answer_frame(one, index)
            told = first.wait_for("PARAM_VALUE")
            assert (told.get_srcSystem(), told.param_value) == (SYSID, 1500.0)
            second.settimeout(0.1)
            with pytest.raises(TimeoutError):
                second.wait_for("PARAM_VALUE")  # its physics has not moved on, whatever the other's does
            second.settimeout(WALL_TIMEOUT_S)
            first.close()
            # One whose physics is silent says its packet again while the other flies on.
            quiet_since = time.monotonic()
            index, repeats = 20, 0
            while repeats < 2 and time.monotonic() - quiet_since < 10.0:
                answer_frame(one, index)
                index += 1
                with contextlib.suppress(BlockingIOError):
                    repeats += other.recv(256, socket.MSG_DONTWAIT)[4:8] == bytes(4)
            assert repeats == 2
            for frame in range(10):
                answer_frame(other, frame)
            told = second.wait_for("PARAM_VALUE")
            assert (told.get_srcSystem(), told.param_value) == (9, 77.0)
            second.close()


ONE_FAILS = """\
import sys
from standin import autopilot, cli

def step(self):
    if self.vehicle.parameters["MAV_SYSID"] == 9 and self.vehicle.sim_time_ns > 20_000_000:
        return 1 / 0
    return STEP(self)

STEP = autopilot.Autopilot.step
autopilot.Autopilot.step = step
sys.exit(cli.main())
"""


def test_one_that_fails_is_named_and_tells_why_in_its_own_log(tmp_path: Path) -> None:
    with physics() as one, physics() as other:
        command = [sys.executable, "-c", ONE_FAILS]
        for udp, sysid in ((one, 3), (other, 9)):
            command += ["+"] if udp is other else []
            command += [
                "--sysid",
                str(sysid),
                "--name",
                f"the stand-in of UA {sysid - 1}",
                "--home",
                HOME_TEXT,
            ]
            command += ["--mavlink-port", "0", "--fdm-port", str(udp.getsockname()[1])]
            command += ["--log", str(tmp_path / f"{sysid}.log")]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
            assert child.stderr is not None
            for index in range(8):
                answer_frame(one, index)
                answer_frame(other, index)
            answer_frame(other, 8)
            assert child.wait(10.0) == 1
            told = child.stderr.read()
    log = tmp_path / "9.log"
    assert told == (
        f"the stand-in of UA 8 cannot go on: ZeroDivisionError: division by zero; its log is {log}\n"
    )
    assert "Traceback" in log.read_text()
    assert (tmp_path / "3.log").read_text().startswith("ready: sysid 3, ")
    assert "Traceback" not in (tmp_path / "3.log").read_text()
