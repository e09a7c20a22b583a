"""A ground station outside, behind a SiK modem of a ground node: it hears and says all over the run's radio."""

from __future__ import annotations

import json
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from aps.wire.framer import Framer
from bridge.bus.session import free_port
from bridge.record.names import Kind, Stream
from bridge.record.packets import packets_of
from bridge.record.streams import read_stream
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from lostlink import load_run
from standin.vehicle.parameters import TABLE
from tests.integration.bridge.conftest import Run, StartRun
from tests.warm import run_lostlink

ITEMS = 20
SPEED = 4
MODEMS = Path(__file__).parents[3] / "data" / "modems.yaml"
ON_AIR = """\
schema: 1
name: on-air
seed: 3
speed: {speed}
duration_s: {duration_s}
origin: {{lat_deg: 47.0, lon_deg: 8.0, alt_amsl_m: 500.0}}
radio: perfect
networks: {{telemetry: {{preset: sik-433, transmit_power_dbm: POWER}}}}
ports: {{zenoh: 0, first_slot: {slot}}}
nodes:
  - {{id: 0, modems: {{telemetry: {{serial: 1}}}}, agent: {{type: still}}}}
  - id: gcs
    kind: ground
    place: {{east_m: 20}}
    modems: {{telemetry: {{serve: ["tcpin::PORT"]}}}}
    agent: {{type: still}}
"""


HOPS = """\
schema: 1
name: hops
seed: 3
speed: {speed}
duration_s: {duration_s}
origin: {{lat_deg: 47.0, lon_deg: 8.0, alt_amsl_m: 500.0}}
radio: perfect
networks:
  telemetry:
    preset: disk
    frequency_hz: 915.0e+6
    bit_rate_bps: 250.0e+3
    max_range_m: 150
    mtu_bytes: 300
    medium: {{model: csma}}
    routing: {{model: flood, hop_limit: 4}}
ports: {{zenoh: 0, first_slot: {slot}}}
nodes:
  - {{id: 0, modems: {{telemetry: {{serial: 1, baud: 57600}}}}, agent: {{type: still}}}}
  - {{id: near, kind: ground, place: {{north_m: 100}}, agent: {{type: still}}}}
  - {{id: mid, kind: ground, place: {{north_m: 200}}, agent: {{type: still}}}}
  - id: gcs
    kind: ground
    place: {{north_m: 300}}
    modems: {{telemetry: {{serve: ["tcpin::PORT"], baud: 57600}}}}
    agent: {{type: still}}
"""


class Station:
    """A ground station: it sends heartbeats all the time."""

    def __init__(self, port: int) -> None:
        self.link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=255, retries=60)
        self._over = Event()
        self._beats = Thread(target=self._beat, daemon=True)
        self._beats.start()

    def _beat(self) -> None:
        while not self._over.wait(1.0 / SPEED):
            self.link.mav.heartbeat_send(mav.MAV_TYPE_GCS, mav.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def close(self) -> None:
        self._over.set()
        self._beats.join()
        self.link.close()

    def heard(self, kind: str, condition: str | None = None, timeout_s: float = 30.0) -> Any:
        found = self.link.recv_match(type=kind, condition=condition, blocking=True, timeout=timeout_s)
        assert found is not None, f"no {kind} {condition or ''}"
        return found

    def asks(self, ask: Callable[[], object], kind: str, condition: str | None = None) -> Any:
        """Ask until it is answered: either way may be lost."""
        for _ in range(20):
            ask()
            answer = self.link.recv_match(type=kind, condition=condition, blocking=True, timeout=2.0)
            if answer is not None:
                return answer
        raise AssertionError(f"no {kind} {condition or ''}")

    def commands(self, command: int, *parameters: float) -> None:
        values = [*parameters, *[0.0] * (7 - len(parameters))]
        self.asks(
            lambda: self.link.mav.command_long_send(1, 1, command, 0, *values),
            "COMMAND_ACK",
            f"COMMAND_ACK.command=={command} and COMMAND_ACK.result==0",
        )


@contextmanager
def station_at(run: Run, port: int) -> Iterator[Station]:
    run.wait_for("sim time")
    station = Station(port)
    try:
        yield station
    finally:
        station.close()


def parameters(station: Station) -> set[str]:
    names: dict[int, str] = {}
    station.link.mav.param_request_list_send(1, 1)
    while len(names) < len(TABLE):
        value = station.link.recv_match(type="PARAM_VALUE", blocking=True, timeout=2.0)
        if value is not None:
            names[value.param_index] = value.param_id
            continue
        for index in set(range(len(TABLE))) - set(names):
            station.link.mav.param_request_read_send(1, 1, b"", index)
    return set(names.values())


def missions(station: Station) -> None:
    """Twenty items up, and down again."""
    items = [
        mav.MAVLink_mission_item_int_message(1, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, 470_000_000 + seq, 8, 20.0)
        for seq in range(ITEMS)
    ]
    message = station.asks(lambda: station.link.mav.mission_count_send(1, 1, ITEMS), "MISSION_REQUEST")
    while message.get_type() != "MISSION_ACK":
        station.link.mav.send(items[message.seq])
        message = station.link.recv_match(
            type=["MISSION_REQUEST", "MISSION_ACK"], blocking=True, timeout=30.0
        )
        assert message is not None, "the upload stands still"
    assert message.type == mav.MAV_MISSION_ACCEPTED
    count = station.asks(lambda: station.link.mav.mission_request_list_send(1, 1), "MISSION_COUNT").count
    assert count == ITEMS
    for seq in range(count):
        item = station.asks(
            lambda seq=seq: station.link.mav.mission_request_int_send(1, 1, seq),  # type: ignore[misc]
            "MISSION_ITEM_INT",
            f"MISSION_ITEM_INT.seq=={seq}",
        )
        if seq:  # the first is home
            assert item.x == 470_000_000 + seq
    station.link.mav.mission_ack_send(1, 1, mav.MAV_MISSION_ACCEPTED)


def takes_off(station: Station) -> None:
    station.link.mav.request_data_stream_send(1, 1, 0, 4, 1)
    station.commands(mav.MAV_CMD_DO_SET_MODE, 1, 4)
    station.heard("HEARTBEAT", "HEARTBEAT.custom_mode==4 and HEARTBEAT.autopilot==3")
    station.commands(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    station.commands(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
    station.heard("GLOBAL_POSITION_INT", "GLOBAL_POSITION_INT.relative_alt>9000", 60.0)


def started(start_run: StartRun, duration_s: float, power_dbm: float = 20.0) -> tuple[Run, int]:
    port = free_port()
    scenario = ON_AIR.replace("PORT", str(port)).replace("POWER", str(power_dbm))
    return start_run(scenario=scenario, speed=str(SPEED), duration_s=duration_s), port


def refly(run: Run, tmp_path: Path, slot: int, processes: str) -> dict[str, Any]:
    command = ["refly", str(run.directory), "--out", str(tmp_path / "again"), "--json"]
    command += ["--first-slot", str(slot), "--zenoh-port", "0", "--processes", processes]
    done = run_lostlink(*command, timeout=280)
    assert done.returncode == 0, done.stderr
    content: dict[str, Any] = json.loads(done.stdout)
    return content


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
def test_a_station_flies_a_copter_over_the_air_and_the_run_repeats_without_it(
    processes: str, start_run: StartRun, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    run, port = started(start_run, 400.0)
    with station_at(run, port) as station:
        station.heard("HEARTBEAT", "HEARTBEAT.autopilot==3")
        assert parameters(station) == {row.name for row in TABLE}
        missions(station)
        takes_off(station)
        own = station.heard("RADIO_STATUS")
        assert (own.get_srcSystem(), own.get_srcComponent()) == (51, 68)
    run.stop(signal.SIGINT)  # it has seen what it wanted
    assert run.summary["ending"] == "interrupted", run.output.decode()
    sent = {link["tx"]: link["sent"] for link in run.summary["links"] if link["radio"] == "telemetry"}
    assert min(sent.values()) > 2 * ITEMS
    with socket.create_server(("127.0.0.1", port)):  # somebody else's by now: it is not asked for
        again = refly(run, tmp_path, free_slot(2), processes)
    assert again["difference"] is None  # up to the last whole tick


@pytest.mark.slow
def test_what_comes_out_is_what_arrived_on_the_air(start_run: StartRun) -> None:
    run, port = started(start_run, 15.0)
    with station_at(run, port) as station:
        station.link.mav.request_data_stream_send(1, 1, 0, 4, 1)
        station.heard("ATTITUDE")
    assert run.finish() == 0, run.output.decode()
    rows = read_columns(run.directory, DELIVERIES, ("radio", "tx", "seq", "fate", "channel", "arrived_ns"))
    ours = (rows["radio"] == "telemetry") & (rows["tx"] == "0")
    assert set(rows["channel"][ours]) == {"mavlink"}
    came = ours & (rows["fate"] == "delivered")
    order = rows["seq"][came][np.argsort(rows["arrived_ns"][came], kind="stable")].tolist()
    payloads = {packet.seq: packet.payload for _, packet in packets_of(run.directory, "0")}
    heard = Stream(Kind.FROM_MODEM, "gcs", "telemetry").path(run.directory)
    out = Framer(trusting=True).receive(b"".join(entry.payload for entry in read_stream(heard)))
    of_the_air = [frame.raw for frame in out if frame.msg_id != mav.MAVLINK_MSG_ID_RADIO_STATUS]
    assert len(of_the_air) > 100
    assert of_the_air == [payloads[seq] for seq in order][: len(of_the_air)]
    assert len(order) - len(of_the_air) < 20  # what is on the serial line when the run ends
    command = ["redecide", str(run.directory)]
    anew = run_lostlink(*command, timeout=120)
    assert "fates are the same, with their powers and error rates" in anew.stdout, anew.stderr


@pytest.mark.slow
def test_a_station_flies_a_copter_over_three_hops(start_run: StartRun) -> None:
    """300 m away, with radios that reach 150 m: the two between them hand frames on, each once."""
    port = free_port()
    run = start_run(scenario=HOPS.replace("PORT", str(port)), speed=str(SPEED), duration_s=400.0)
    with station_at(run, port) as station:
        station.heard("HEARTBEAT", "HEARTBEAT.autopilot==3")
        takes_off(station)
    run.stop(signal.SIGINT)
    assert run.summary["ending"] == "interrupted", run.output.decode()
    ways = {
        (tx, rx): part.sort_values("hop").node.astype(str).tolist()
        for (tx, rx), part in load_run(run.directory).routes.groupby(["tx", "rx"], observed=True)
    }
    assert ways["0", "gcs"][:3] == ["0", "near", "mid"]
    assert ways["gcs", "0"][:3] == ["gcs", "mid", "near"]


@pytest.mark.slow
def test_two_modems_at_a_ua_and_a_network_that_all_share(start_run: StartRun) -> None:
    """By `tests/data/modems.yaml`: UA 0 and gcs are on near, all are on far."""
    text = MODEMS.read_text().replace("{", "{{").replace("}", "}}")
    run = start_run(scenario=text + "ports: {{zenoh: 0, first_slot: {slot}}}\n")
    assert run.finish() == 0, run.output.decode()

    def heard(node: str, radio: str) -> set[tuple[int, int]]:
        """System and message ids."""
        path = Stream(Kind.FROM_MODEM, node, radio).path(run.directory)
        frames = Framer(trusting=True).receive(b"".join(entry.payload for entry in read_stream(path)))
        return {(frame.sysid, frame.msg_id) for frame in frames}

    beat, status = mav.MAVLINK_MSG_ID_HEARTBEAT, mav.MAVLINK_MSG_ID_RADIO_STATUS
    assert heard("0", "near") == {(51, status)}
    assert {one for one in heard("gcs", "near") if one[1] == beat} == {(1, beat)}
    assert {one for one in heard("0", "far") if one[1] == beat} == {(2, beat)}
    assert {one for one in heard("1", "far") if one[1] == beat} == {(1, beat)}
    assert {one for one in heard("gcs", "far") if one[1] == beat} == {(1, beat), (2, beat)}


@pytest.mark.slow
def test_a_copter_that_flies_out_of_range_is_lost_and_found_again(start_run: StartRun) -> None:
    run, port = started(start_run, 400.0, power_dbm=-45.0)
    with station_at(run, port) as station:
        takes_off(station)
        station.commands(mav.MAV_CMD_DO_SET_MODE, 1, 4)
        far = (0b110111111000, round(47.004e7), round(8.0e7), 10.0, 0, 0, 0, 0, 0, 0, 0, 0)
        station.link.mav.set_position_target_global_int_send(0, 1, 1, 6, *far)
        began = time.monotonic()
        while station.link.recv_match(
            type="HEARTBEAT", condition="HEARTBEAT.autopilot==3", blocking=True, timeout=10.0 / SPEED
        ):
            assert time.monotonic() - began < 60.0, "it is never out of range"
        station.heard("RADIO_STATUS", "RADIO_STATUS.remrssi==0", 60.0)  # of its own modem, which goes on
        over = mavutil.mavlink_connection(f"tcp:127.0.0.1:{6760 + 10 * run.slot}")  # the maintenance cable
        over.wait_heartbeat(timeout=20)
        over.mav.command_long_send(1, 1, mav.MAV_CMD_DO_SET_MODE, 0, 1, 6, 0, 0, 0, 0, 0)
        # A cable that is pulled out with bytes unread may lose what was sent.
        assert over.recv_match(
            type="HEARTBEAT", condition="HEARTBEAT.custom_mode==6", blocking=True, timeout=20.0
        )
        over.close()
        station.heard("HEARTBEAT", "HEARTBEAT.autopilot==3 and HEARTBEAT.custom_mode==6", 180.0)
