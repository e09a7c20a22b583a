"""A port behind a modem: by the rules of ArduPilot's GCS_Common.cpp and GCS_Param.cpp, written out here."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.autopilot import MODES
from standin.protocols.endpoint import MavlinkEndpoint
from standin.protocols.flow import FlowControl
from standin.protocols.streams import Streams
from standin.vehicle.location import Location
from standin.vehicle.parameters import TABLE, StandinParameters
from standin.vehicle.vehicle import StandinVehicle

S, MS = 1_000_000_000, 1_000_000
BAUD = 57_600
STEP_NS = 2_500_000


@pytest.mark.parametrize(
    ("txbufs", "slowdown_ms"),
    [
        ([19], 60),
        ([20], 20),
        ([49], 20),
        ([50, 90], 0),
        ([19, 19, 91], 100),
        ([19] * 5 + [96], 260),
        ([19] * 3 + [96], 160),
        ([20, 95], 0),
        ([19] * 40, 2040),
        ([49] * 200, 2000),
    ],
)
def test_streams_are_slowed_down_by_the_modems_buffer(txbufs: list[int], slowdown_ms: int) -> None:
    flow = FlowControl(BAUD)
    for second, txbuf in enumerate(txbufs):
        flow.radio_status(txbuf, second * S)
    assert flow.slowdown_ms == slowdown_ms


def test_parameters_wait_for_room_in_the_modem_unless_it_has_been_silent() -> None:
    flow = FlowControl(BAUD)
    assert flow.takes_parameters(0)
    flow.radio_status(33, S)
    assert not flow.takes_parameters(S)
    assert not flow.takes_parameters(6 * S)
    assert flow.takes_parameters(6 * S + 1)
    flow.radio_status(34, 7 * S)
    assert flow.takes_parameters(7 * S)


def test_a_slowed_stream_has_its_interval_and_the_slowdown_and_heartbeats_theirs() -> None:
    streams = Streams()
    streams.set_interval(dialect.MAVLINK_MSG_ID_ATTITUDE, 100_000, 0)
    sent = {dialect.MAVLINK_MSG_ID_HEARTBEAT: 0, dialect.MAVLINK_MSG_ID_ATTITUDE: 0}
    for now_ns in range(0, 60 * S, 10 * MS):
        for message in streams.take_due(now_ns, 400 * MS):
            sent[message] += 1
    assert sent[dialect.MAVLINK_MSG_ID_HEARTBEAT] == 60
    assert sent[dialect.MAVLINK_MSG_ID_ATTITUDE] == pytest.approx(120, abs=1)


class Port:
    """A port of a vehicle at rest."""

    def __init__(self, baud: int) -> None:
        self.vehicle = StandinVehicle(Location(47.0, 8.0, 500.0), StandinParameters(), MODES)
        self.endpoint = MavlinkEndpoint(self.vehicle, 0, baud)
        self.endpoint.connect()
        self.now_ns = 0

    def live(self, seconds: float) -> bytes:
        out = b""
        for _ in range(round(seconds * S / STEP_NS)):
            self.now_ns += STEP_NS
            self.vehicle.sim_time_ns = self.now_ns
            self.endpoint.obey()
            self.endpoint.report()
            out += self.endpoint.data_to_send()
        return out

    def hear(self, message: dialect.MAVLink_message) -> None:
        self.endpoint.receive(message.pack(dialect.MAVLink(None, 255, 190)))


def test_no_more_leaves_than_the_line_carries() -> None:
    port = Port(BAUD)
    port.hear(dialect.MAVLink_request_data_stream_message(1, 1, 0, 50, 1))
    port.live(2.0)
    assert len(port.live(10.0)) == pytest.approx(10 * BAUD / 10, rel=0.01)
    fast = Port(0)
    fast.hear(dialect.MAVLink_request_data_stream_message(1, 1, 0, 50, 1))
    fast.live(2.0)
    assert len(fast.live(10.0)) > 2 * 10 * BAUD / 10


def test_a_list_takes_three_tenths_of_the_line() -> None:
    port = Port(BAUD)
    port.hear(dialect.MAVLink_param_request_list_message(1, 1))
    reader = dialect.MAVLink(None)
    seen: list[int] = []
    began_ns = port.now_ns
    while len(seen) < len(TABLE):
        seen += [
            message.param_index
            for message in reader.parse_buffer(port.live(0.01)) or []
            if message.get_type() == "PARAM_VALUE"
        ]
    assert seen == list(range(len(TABLE)))
    apart_s = 37 * 10 / (BAUD * 0.3)
    took_s = (port.now_ns - began_ns) / S
    assert (len(TABLE) - 1) * apart_s <= took_s <= len(TABLE) * (apart_s + 0.01) + 0.05


def test_what_happens_to_the_vehicle_is_told_at_all_ports() -> None:
    vehicle = StandinVehicle(Location(47.0, 8.0, 500.0), StandinParameters(), MODES)
    ports = MavlinkEndpoint(vehicle, 0), MavlinkEndpoint(vehicle, 0, BAUD)
    for port in ports:
        port.told_together = ports
        port.connect()
    order = dialect.MAVLink_command_long_message(
        1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0
    )
    ports[0].receive(order.pack(dialect.MAVLink(None, 255, 190)))
    vehicle.sim_time_ns = 10 * MS
    ports[0].obey()
    vehicle.sim_time_ns = S
    texts = [
        [
            message.text
            for message in dialect.MAVLink(None).parse_buffer(port.data_to_send()) or []
            if message.get_type() == "STATUSTEXT"
        ]
        for port in ports
    ]
    assert texts[0]
    assert texts[0][0] == texts[1][0]
