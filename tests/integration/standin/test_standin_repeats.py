"""The same bytes in give the same bytes out, whatever the clock on the wall does.

The test is physics and MAVLink client at once. At every tick (50 ms of sim time) it withholds the sensor frame, reads
what the stand-in wrote until nothing is there, writes what it has to say, and only then answers.
"""

from __future__ import annotations

import hashlib
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel
from fdm.model.sensor_noise import SensorNoise
from fdm.wire.sensor_frame import make_encoder
from fdm.wire.servo_packet import unpack_servo_packet

RATE_HZ = 400
TICK_FRAMES = RATE_HZ // 20
FLIGHT_S = 32
STREAMS_HZ = {0: 1, 1: 2, 2: 1, 24: 2, 30: 10, 32: 20, 33: 20, 62: 1, 74: 5, 147: 1, 193: 1, 242: 1, 245: 5}
GUIDED, AUTO = 4, 3
AIRFRAME = load_airframe("f450")
HOME = Home(GeodeticPosition(45.0, 10.0, 100.0), 120.0)


def command(number: int, *parameters: float) -> Any:
    padded = [*parameters, *([0.0] * (7 - len(parameters)))]
    return dialect.MAVLink_command_long_message(1, 1, number, 0, *padded)


def place_e7(north_m: float) -> int:
    return round((45.0 + north_m / 111318.845) * 1e7)


def mission_item(seq: int, number: int, north_m: float) -> Any:
    return dialect.MAVLink_mission_item_int_message(
        1, 1, seq, 6, number, 0, 1, 0, 0, 0, 0, place_e7(north_m), 100_000_000, 8.0, 0
    )


MISSION = [mission_item(0, 16, 0), mission_item(1, 22, 0), mission_item(2, 16, 20), mission_item(3, 21, 20)]
SCRIPT = {
    2: [command(511, message_id, 1e6 / rate_hz) for message_id, rate_hz in STREAMS_HZ.items()],
    10: [dialect.MAVLink_param_request_list_message(1, 1)],
    20: [dialect.MAVLink_mission_count_message(1, 1, len(MISSION), 0)],
    100: [command(176, 1, GUIDED), command(400, 1)],
    101: [command(22, 0, 0, 0, 0, 0, 0, 6.0), dialect.MAVLink_timesync_message(0, 77)],
    260: [
        dialect.MAVLink_command_int_message(
            1, 1, 6, 192, 0, 0, -1, 1, 0, 0, place_e7(15.0), 100_000_000, 10.0
        )
    ],
    400: [command(178, 1, 4.0), command(176, 1, AUTO), command(300)],
}
"""What the client says, by tick."""


class Driver:
    """Physics and client of one flight."""

    def __init__(self, pause: Callable[[int], None]) -> None:
        self._pause = pause
        self._model = JsbsimModel(AIRFRAME, HOME)
        noise = SensorNoise(position_sigma_m=0.1, velocity_sigma_mps=0.05, gyro_sigma_radps=0.01)
        self._sense = noise.disturb(seed=1, ua_id=0)(self._model.sense)
        self._encode = make_encoder(AIRFRAME.sensors)
        self._codec, self._parser = dialect.MAVLink(None, 255, 190), dialect.MAVLink(None)
        self._servo, self._said = hashlib.sha256(), hashlib.sha256()
        self.heard: list[Any] = []
        self.highest_m = 0.0
        self.sent_again = 0

    def fly(self) -> tuple[str, str]:
        """Fly; return the digests of all servo packets and of all MAVLink bytes."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
            udp.bind(("127.0.0.1", 0))
            udp.settimeout(20.0)
            options = ["--home", "45,10,100,120", "--mavlink-port", "0", "--rate-hz", str(RATE_HZ)]
            options += ["--fdm-port", str(udp.getsockname()[1])]
            with subprocess.Popen(
                [sys.executable, "-m", "standin", *options], stdout=subprocess.PIPE, text=True
            ) as child:
                try:
                    assert child.stdout is not None
                    port = int(child.stdout.readline().split("tcp:127.0.0.1:")[1].split(",")[0])
                    with socket.create_connection(("127.0.0.1", port), timeout=10.0) as tcp:
                        tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        self._fly(udp, tcp)
                finally:
                    child.kill()
        return self._servo.hexdigest(), self._said.hexdigest()

    def _fly(self, udp: socket.socket, tcp: socket.socket) -> None:
        frame = 0
        while frame < FLIGHT_S * RATE_HZ:
            packet, sender = udp.recvfrom(256)
            fields = unpack_servo_packet(packet)
            assert not isinstance(fields, str)
            if fields[2] < frame:  # sent again: it has been answered meanwhile
                self.sent_again += 1
                continue
            assert fields[2] == frame
            self._servo.update(packet)
            self._model.step(fields, RATE_HZ)
            frame += 1
            self.highest_m = max(self.highest_m, -self._model.truth(0, 0).position_ned_m[2])
            self._pause(frame)
            if frame % TICK_FRAMES == 0:
                self._tick(tcp, frame // TICK_FRAMES)
            udp.sendto(self._encode((frame / RATE_HZ, *self._sense())), sender)

    def _tick(self, tcp: socket.socket, tick: int) -> None:
        tcp.setblocking(False)
        answers = list(SCRIPT.get(tick, ()))
        while True:
            try:
                data = tcp.recv(65536)
            except BlockingIOError:
                break
            assert data, "the stand-in closed the connection"
            self._said.update(data)
            for message in self._parser.parse_buffer(data) or []:
                self.heard.append(message)
                if message.get_type() == "MISSION_REQUEST":
                    answers.append(MISSION[message.seq])
        tcp.setblocking(True)
        for message in answers:
            tcp.sendall(message.pack(self._codec))

    def of_kind(self, kind: str) -> list[Any]:
        return [m for m in self.heard if m.get_type() == kind]


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_two_flights_are_the_same_in_every_byte_whatever_the_clock_does() -> None:
    generator = np.random.default_rng()

    def dawdle(frame: int) -> None:
        if frame == 5000:
            time.sleep(1.4)  # longer than after what a servo packet is sent again
        elif frame % 13 == 0 and generator.random() < 0.2:
            time.sleep(0.003 * generator.random())

    prompt, dawdling = Driver(lambda _: None), Driver(dawdle)
    assert prompt.fly() == dawdling.fly()
    assert dawdling.sent_again >= 1
    # And it was a flight: what was asked for happened.
    assert [m.type for m in prompt.of_kind("MISSION_ACK")] == [0]
    assert {m.result for m in prompt.of_kind("COMMAND_ACK")} == {0}
    assert [m.seq for m in prompt.of_kind("MISSION_ITEM_REACHED")][-1] == 2
    assert prompt.highest_m > 9.0
    parameters = prompt.of_kind("PARAM_VALUE")
    assert [m.param_index for m in parameters] == list(range(parameters[0].param_count))
    (timesync,) = prompt.of_kind("TIMESYNC")
    assert (timesync.tc1, timesync.ts1) == (101 * 50_000_000, 77)
    boots_us = {m.time_unix_usec - 1000 * m.time_boot_ms for m in prompt.of_kind("SYSTEM_TIME")}
    assert boots_us == {1_700_000_000_000_000}
