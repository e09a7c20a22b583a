"""ArduPilot's forwarding rules (MAVLink_routing.cpp, mavlink.io "Routing"), case by case, through a whole hub.

One UA, system 5. Links: its autopilot; a ground station (255, 190); a companion with a camera (5, 100) and a program
that shares our own ids (5, 191); another UA (7, 1) with its gimbal (7, 154); and somebody who has never spoken.
"""

import pytest
from pymavlink.dialects.v10 import ardupilotmega as v1
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.hub.hub import Hub
from aps.hub.routing import Router
from aps.links.link import Link, Opening, Role
from aps.links.outbox import FrameQueue
from aps.links.rules import Filter, LinkRules
from aps.wire.framer import Framer

S = 1_000_000_000
AP, GCS, CAM, UAV, MUTE = "autopilot", "ground station", "companion", "other UA", "mute"
SENDERS = {AP: [(5, 1)], GCS: [(255, 190)], CAM: [(5, 100), (5, 191)], UAV: [(7, 1), (7, 154)], MUTE: []}
ALL = set(SENDERS)


def heartbeat():
    return mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def attitude():
    return mavlink.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 1)


def command(system, component):
    return mavlink.MAVLink_command_long_message(system, component, 400, 0, *[0] * 6, 1)


def bytes_of(message, sender, protocol=mavlink):
    return bytes(message.pack(protocol.MAVLink(None, srcSystem=sender[0], srcComponent=sender[1])))


class Bench:
    """A hub whose links have heard their peers."""

    def __init__(self, rules=None):
        self.hub = Hub(Router(5, 191, route_expiry_ns=60 * S))
        self.links = {}
        for number, name in enumerate(SENDERS):
            opening = Opening(
                Role.AUTOPILOT if name == AP else Role.CLIENT, (rules or {}).get(name, LinkRules())
            )
            self.links[name] = Link(name, FrameQueue(), opening)
            self.links[name].id = number + 10  # no number means anything
            self.links[name].outbox.admit()
            self.hub.add(self.links[name])
        for name, senders in SENDERS.items():
            for sender in senders:
                self.say(name, bytes_of(heartbeat(), sender), 0)
        self.sent()

    def say(self, name, data, now_ns=S):
        link = self.links[name]
        self.hub.receive(link.receive(data, now_ns), link, now_ns)

    def sent(self):
        """What has gone out since the last call: link -> bytes."""
        sent = {name: link.outbox.take(1 << 20) for name, link in self.links.items()}
        return {name: data for name, data in sent.items() if data}


CASES = [
    # What; from where, by whom; message; to where it goes.
    # Untargeted messages: everywhere else.
    ("telemetry of the autopilot", AP, (5, 1), attitude(), ALL - {AP}),
    ("telemetry of the other UA", UAV, (7, 1), attitude(), ALL - {UAV}),
    ("an untargeted message of the ground station", GCS, (255, 190), attitude(), ALL - {GCS}),
    ("of the companion", CAM, (5, 100), attitude(), ALL - {CAM}),
    ("of one who shares our ids", CAM, (5, 191), attitude(), ALL - {CAM}),
    ("of a sender that is new on its link", MUTE, (9, 9), attitude(), ALL - {MUTE}),
    ("of system 0", GCS, (0, 0), attitude(), ALL - {GCS}),
    # Target system 0: everywhere else, whatever the component.
    ("command to everybody", GCS, (255, 190), command(0, 0), ALL - {GCS}),
    ("command to everybody's autopilot", GCS, (255, 190), command(0, 1), ALL - {GCS}),
    ("command to all components 100", GCS, (255, 190), command(0, 100), ALL - {GCS}),
    ("the autopilot's to everybody", AP, (5, 1), command(0, 0), ALL - {AP}),
    # Our own system.
    ("command to the autopilot", GCS, (255, 190), command(5, 1), {AP}),
    ("from a companion", CAM, (5, 100), command(5, 1), {AP}),
    ("from one who has never spoken", MUTE, (254, 190), command(5, 1), {AP}),
    ("from another UA", UAV, (7, 1), command(5, 1), {AP}),
    ("to all components of our system", GCS, (255, 190), command(5, 0), {AP, CAM}),
    ("to all components, from one of them", CAM, (5, 100), command(5, 0), {AP}),
    ("to all components, from the autopilot", AP, (5, 1), command(5, 0), {CAM}),
    ("to the camera", GCS, (255, 190), command(5, 100), {CAM}),
    ("from the autopilot to the camera", AP, (5, 1), command(5, 100), {CAM}),
    ("to our ids, which the companion has, too", GCS, (255, 190), command(5, 191), {CAM}),
    ("to a component that nobody has seen", GCS, (255, 190), command(5, 154), {AP}),
    ("to one that nobody has seen, from the autopilot", AP, (5, 1), command(5, 154), set()),
    ("to a component behind the same link", CAM, (5, 191), command(5, 100), {AP}),
    # Other systems: links that have seen the system, whatever the component.
    ("autopilot to the ground station", AP, (5, 1), command(255, 190), {GCS}),
    ("to another component of the ground station", AP, (5, 1), command(255, 1), {GCS}),
    ("to all components of the ground station", AP, (5, 1), command(255, 0), {GCS}),
    ("ground station to the other UA", GCS, (255, 190), command(7, 1), {UAV}),
    ("to the gimbal of the other UA", GCS, (255, 190), command(7, 154), {UAV}),
    ("to a component of it that nobody has seen", GCS, (255, 190), command(7, 99), {UAV}),
    ("to a system that nobody has seen", GCS, (255, 190), command(77, 1), set()),
    ("to a system behind the same link", UAV, (7, 1), command(7, 154), set()),
    ("UA to UA", AP, (5, 1), command(7, 1), {UAV}),
    # Heartbeats: to those that do not reach the sender by themselves.
    ("heartbeat of the autopilot", AP, (5, 1), heartbeat(), ALL - {AP}),
    ("heartbeat of the ground station", GCS, (255, 190), heartbeat(), ALL - {GCS}),
    ("heartbeat of a station that another link reaches, too", UAV, (255, 190), heartbeat(), ALL - {UAV, GCS}),
    ("heartbeat of one who shares our ids", CAM, (5, 191), heartbeat(), ALL - {CAM}),
    # Never forwarded.
    ("RADIO_STATUS", GCS, (51, 68), mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7), set()),
    ("RADIO", AP, (51, 68), mavlink.MAVLink_radio_message(1, 2, 3, 4, 5, 6, 7), set()),
    ("what the autopilot says, from elsewhere", GCS, (5, 1), attitude(), set()),
    ("the autopilot's heartbeat from elsewhere", UAV, (5, 1), heartbeat(), set()),
    # Targets in other places of the payload.
    ("PARAM_SET", GCS, (255, 190), mavlink.MAVLink_param_set_message(5, 1, b"A", 1.0, 9), {AP}),
    ("PARAM_REQUEST_LIST", GCS, (255, 190), mavlink.MAVLink_param_request_list_message(7, 1), {UAV}),
    ("MISSION_COUNT", GCS, (255, 190), mavlink.MAVLink_mission_count_message(5, 1, 3), {AP}),
    ("SET_MODE has no component", GCS, (255, 190), mavlink.MAVLink_set_mode_message(7, 1, 4), {UAV}),
    ("SET_MODE of our own", GCS, (255, 190), mavlink.MAVLink_set_mode_message(5, 1, 4), {AP, CAM}),
    (
        "MANUAL_CONTROL's target",
        GCS,
        (255, 190),
        mavlink.MAVLink_manual_control_message(5, 0, 0, 0, 0, 0),
        {AP, CAM},
    ),
    ("GPS_INJECT_DATA", GCS, (255, 190), mavlink.MAVLink_gps_inject_data_message(5, 1, 2, bytes(110)), {AP}),
    # MAVLink 2 trims trailing zeros: a target past the end is 0.
    (
        "COMMAND_ACK with target",
        AP,
        (5, 1),
        mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190),
        {GCS},
    ),
    (
        "COMMAND_ACK whose target is trimmed",
        AP,
        (5, 1),
        mavlink.MAVLink_command_ack_message(400, 0),
        ALL - {AP},
    ),
    ("PING to everybody", GCS, (255, 190), mavlink.MAVLink_ping_message(1, 1, 0, 0), ALL - {GCS}),
    ("PING's answer", AP, (5, 1), mavlink.MAVLink_ping_message(1, 1, 255, 190), {GCS}),
]


@pytest.mark.parametrize(("what", "name", "sender", "message", "to"), CASES, ids=[case[0] for case in CASES])
def test_frame_goes_as_ardupilot_routes_it_with_its_original_bytes(what, name, sender, message, to):
    bench = Bench()
    raw = bytes_of(message, sender)
    bench.say(name, raw)
    assert bench.sent() == dict.fromkeys(to, raw), what


def test_there_are_forty_cases_and_each_is_another():
    assert len({case[0] for case in CASES}) == len(CASES) >= 40


def test_mavlink_1_signed_and_unknown_frames_pass_whole():
    bench = Bench()
    old = bytes_of(v1.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 1), (255, 190), v1)
    signer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    signer.signing.secret_key, signer.signing.sign_outgoing = bytes(32), True
    signer.signing.link_id, signer.signing.timestamp = 1, 1000
    signed = bytes(attitude().pack(signer))
    assert (old[0], signed[2]) == (0xFE, 1)
    unknown = unknown_frame((255, 190))
    for raw in (old, signed, unknown):
        bench.say(GCS, raw)
        assert bench.sent() == dict.fromkeys(ALL - {GCS}, raw)


def unknown_frame(sender):
    from fastcrc.crc16 import mcrf4xx

    body = bytes([3, 0, 0, 0, *sender]) + (60_001).to_bytes(3, "little") + b"abc"
    return b"\xfd" + body + mcrf4xx(body + b"\x33").to_bytes(2, "little")


def test_an_unknown_frame_of_an_unknown_sender_goes_nowhere():
    bench = Bench()
    bench.say(GCS, unknown_frame((99, 99)))
    assert bench.sent() == {}


@pytest.mark.parametrize(
    ("rules", "message", "to"),
    [
        ({MUTE: LinkRules(outgoing=Filter(block_messages=frozenset({30})))}, attitude(), ALL - {AP, MUTE}),
        ({MUTE: LinkRules(outgoing=Filter(allow_messages=frozenset({0})))}, attitude(), ALL - {AP, MUTE}),
        ({MUTE: LinkRules(outgoing=Filter(block_systems=frozenset({5})))}, attitude(), ALL - {AP, MUTE}),
        ({GCS: LinkRules(outgoing=Filter(allow_components=frozenset({1})))}, attitude(), ALL - {AP}),
        ({GCS: LinkRules(read_only=True)}, attitude(), ALL - {AP}),
        ({AP: LinkRules(incoming=Filter(block_messages=frozenset({30})))}, attitude(), set()),
    ],
)
def test_rules_of_links(rules, message, to):
    bench = Bench(rules)
    bench.say(AP, bytes_of(message, (5, 1)))
    assert set(bench.sent()) == to


def test_what_a_read_only_link_says_is_not_even_learned_from():
    bench = Bench({GCS: LinkRules(read_only=True)})
    bench.say(GCS, bytes_of(command(5, 1), (255, 190)))
    bench.say(AP, bytes_of(command(255, 190), (5, 1)))
    assert bench.sent() == {}
    assert bench.links[GCS].counters.dropped_in == 2


def test_rates_thin_telemetry_and_never_answers():
    bench = Bench({GCS: LinkRules(max_rate_hz={30: 2.0})})
    for tenth in range(100):
        bench.say(AP, bytes_of(attitude(), (5, 1)), S + tenth * S // 10)
        bench.say(AP, bytes_of(mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190), (5, 1)), S)
    counts = {name: len(Framer().receive(data)) for name, data in bench.sent().items()}
    assert counts[MUTE] == 100
    assert counts[GCS] == 100 + 20
    assert bench.links[GCS].counters.dropped_rate_out == 80


def test_a_hub_without_a_vehicle_joins_its_links():
    hub = Hub(Router(None, 191, route_expiry_ns=60 * S))
    links = [Link(str(number), FrameQueue()) for number in range(3)]
    for number, link in enumerate(links):
        link.id = number
        link.outbox.admit()
        hub.add(link)
    taps = []
    hub.taps.append(lambda raw, link: taps.append((raw, link.id)))
    raw = bytes_of(attitude(), (5, 1))
    hub.receive(links[0].framer.receive(raw), links[0], 7)
    assert [link.outbox.take(1000) for link in links] == [b"", raw, raw]
    hub.remove(1)
    asked = bytes_of(command(5, 1), (255, 190))
    hub.receive(links[2].framer.receive(asked), links[2], 8)
    hub.send(raw, links[2])
    assert links[0].outbox.take(1000) == asked
    assert taps == [(raw, 0), (asked, 2), (raw, 2)]
