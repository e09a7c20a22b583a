"""Real ArduCopter flown again: the same bytes, if MAVLink comes and goes only at held ticks."""

import contextlib
import hashlib
import math
import socket
import subprocess
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from fdm.clock.events import EventKind
from fdm.exchange.aircraft_spec import AircraftSpec, default_port
from fdm.exchange.exchange import Exchange
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home

pytestmark = pytest.mark.ardupilot

HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0), 0.0)
PARAMETERS = Path(__file__).parents[4] / "sitl_configs" / "params" / "copter.parm"
WAIT_S = 40.0
SIM_S = 20.0
TICKS_PER_S = 20
RESEND_S = 1.1


class Flight:
    """What one autopilot says at the ticks, and how it is talked to there.

    Args:
        slot: its port slot.
        dawdle: waits in the ticks, now shorter, now longer, and once until the autopilot asks again.
    """

    def __init__(self, slot, coupling, dawdle):
        self.link, self.dawdle = None, dawdle
        self.slot, self.tick, self.armed, self.up = slot, 0, False, False
        self.said, self.servos, self.truth = hashlib.sha256(), hashlib.sha256(), None
        self.events = []
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.mav = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
        self.exchange = Exchange(
            [AircraftSpec(0, load_airframe("f450"), HOME, default_port(slot))],
            speed=math.inf,
            coupling=coupling,
            hold_ticks=True,
            on_tick=self.at_tick,
            on_truth=self.note_truth,
            on_event=self.events.append,
        )
        (seat,) = self.exchange._seats.values()
        receive = seat.aircraft.receive

        def noted(datagram, sender, wall_ns):
            verdict = receive(datagram, sender, wall_ns)
            if verdict is not None and verdict.value in ("boots", "frames"):
                self.servos.update(datagram)
            return verdict

        seat.aircraft = _Noted(seat.aircraft, noted)

    def note_truth(self, truth):
        self.truth = truth

    def connect(self):
        deadline = time.monotonic() + WAIT_S
        while self.link is None:
            try:
                self.link = socket.create_connection(("127.0.0.1", 5760 + 10 * self.slot), 1.0)
            except OSError:
                assert time.monotonic() < deadline
                time.sleep(0.05)
        self.link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def at_tick(self, status):
        if self.link is None:
            self.connect()
        if self.dawdle:
            time.sleep(1.5 * RESEND_S if self.tick == 100 else 0.001 * (self.tick * 7 % 5))
        self.hear()
        self.link.sendall(self.answer())
        self.tick += 1
        if self.tick > SIM_S * TICKS_PER_S:
            self.exchange.stop()
        else:
            self.exchange.release_tick(status.sim_time_ns)

    def hear(self):
        self.link.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while data := self.link.recv(65536):
                self.said.update(data)
                for message in self.parser.parse_buffer(data) or ():
                    if message.get_type() == "HEARTBEAT":
                        self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.link.setblocking(True)

    def answer(self):
        """What is said to the autopilot at this tick: streams, then arming in STABILIZE until it does."""
        out = b""
        if self.tick % TICKS_PER_S == 0:
            out += self.mav.heartbeat_encode(6, 8, 0, 0, 0).pack(self.mav)
        if self.tick == 10:
            for number in (mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_RAW_IMU):
                out += self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 20_000)
        if self.tick == 12 * TICKS_PER_S:
            out += self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 21196)
        return out

    def command(self, number, *parameters):
        parameters += (0,) * (7 - len(parameters))
        return self.mav.command_long_encode(1, 1, number, 0, *parameters).pack(self.mav)

    def close(self):
        if self.link is not None:
            self.link.close()
        self.exchange.close()


class _Noted:
    """An aircraft whose packets are noted on their way."""

    def __init__(self, aircraft, receive):
        self._aircraft, self.receive = aircraft, receive

    def __getattr__(self, name):
        return getattr(self._aircraft, name)


def fly(binary, slot, directory, coupling, dawdle):
    """One flight; gives its digests, its last truth and what was counted."""
    directory.mkdir()
    home = f"{HOME.position.lat_deg},{HOME.position.lon_deg},{HOME.position.alt_amsl_m},0"
    arguments = ["-w", "--model", "JSON:127.0.0.1", f"-I{slot}", "--home", home, "--speedup", "100"]
    arguments += ["--defaults", str(PARAMETERS), "--serial0", "tcp:0", "--start-time", "1700000000"]
    with (
        contextlib.closing(Flight(slot, coupling, dawdle)) as flight,
        subprocess.Popen(
            [str(binary), *arguments],
            cwd=directory,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as autopilot,
    ):
        try:
            flight.exchange.run()
        finally:
            autopilot.kill()
        counters = flight.exchange.counters(0)
    assert [event.kind for event in flight.events] == [EventKind.JOINED]
    assert counters.keys() <= {"boots", "frames", "repeats_while_waiting", "duplicates"}, counters
    return flight.servos.hexdigest(), flight.said.hexdigest(), flight.truth, flight.armed


@pytest.mark.parametrize("coupling", ["serial", "parallel"])
def test_a_flight_of_a_real_arducopter_repeats_byte_for_byte(arducopter, free_slot, tmp_path, coupling):
    slot = free_slot(1)
    first = fly(arducopter, slot, tmp_path / "first", coupling, dawdle=False)
    again = fly(arducopter, slot, tmp_path / "again", coupling, dawdle=True)
    assert first == again
    assert first[3], "it did not arm: this shows less than it should"
