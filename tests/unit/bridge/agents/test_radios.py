"""A node's radios as its agent sees them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bridge.agents.client import UaClient
from bridge.agents.radio import QueueState, UnicastReply
from bridge.agents.running.feed import Arrivals, DeliveredPacket
from bridge.bus.reception import Instants, Reception, attachment, radio_of, signal_of
from bridge.bus.session import Stamp

REACH = {"main": ("0", "1", "gcs"), "mesh": ("0", "1")}


class Outlet:
    """Keeps what is transmitted."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, str, int, str]] = []

    def transmit(
        self, to: str, channel: str, payload: bytes, encoding: str, stamp: Stamp, handling: object, radio: str
    ) -> None:
        self.sent.append((to, channel, stamp.seq, radio))


def client(outlet: Outlet) -> UaClient:
    return UaClient("0", outlet, reach=REACH)  # type: ignore[arg-type]


def test_packets_go_to_a_radio_by_name_and_are_numbered_together() -> None:
    outlet = Outlet()
    ua = client(outlet)
    numbers = [
        ua.transmit("team", b"x"),
        ua.transmit("video", b"x", radio="mesh"),
        ua.transmit("video", b"x", radio="mesh", to="1"),
        ua.transmit("team", b"x", to="gcs"),
        ua.transmit("team", b"x", to=1),  # as scenarios write ids
    ]
    assert numbers == [0, 1, 2, 3, 4]
    assert outlet.sent == [
        ("all", "team", 0, "main"),
        ("all", "video", 1, "mesh"),
        ("1", "video", 2, "mesh"),
        ("gcs", "team", 3, "main"),
        ("1", "team", 4, "main"),
    ]


@pytest.mark.parametrize(
    ("given", "named"),
    [({"channel": 7}, "channel=7"), ({"to": None}, "to=None"), ({"radio": b"mesh"}, "radio=b'mesh'")],
)
def test_what_is_no_text_is_refused_by_name(given: dict[str, Any], named: str) -> None:
    arguments: dict[str, Any] = {"channel": "team", "payload": b"x"} | given
    with pytest.raises(TypeError, match=f"^transmit: {named} is no text$"):
        client(Outlet()).transmit(**arguments)


def test_a_radio_that_is_not_there_and_a_node_that_is_not_on_its_network_are_refused() -> None:
    outlet = Outlet()
    ua = client(outlet)
    with pytest.raises(ValueError, match=r"radio='lora': node 0 has main, mesh"):
        ua.transmit("team", b"x", radio="lora")
    with pytest.raises(ValueError, match=r"to='gcs': on radio mesh node 0 reaches all, 1$"):
        ua.transmit("team", b"x", radio="mesh", to="gcs")
    with pytest.raises(ValueError, match="cannot be part of a key"):
        UaClient("0", outlet).transmit("team", b"x", radio="a/b")  # type: ignore[arg-type]
    assert (ua.sent, outlet.sent) == (0, [])


def test_a_group_is_an_addressee_where_it_has_members_and_an_unknown_one_is_told_with_those_there_are() -> (
    None
):
    outlet = Outlet()
    reach = {"main": ("0", "1", "gcs", "ears", "scouts"), "mesh": ("0", "1", "scouts")}
    ua = UaClient("0", outlet, reach=reach)  # type: ignore[arg-type]
    ua.transmit("team", b"x", to="scouts")
    ua.transmit("team", b"x", to="scouts", radio="mesh")
    with pytest.raises(
        ValueError, match=r"to='scoots': on radio main node 0 reaches all, 1, gcs, ears, scouts$"
    ):
        ua.transmit("team", b"x", to="scoots")
    with pytest.raises(ValueError, match=r"to='ears': on radio mesh node 0 reaches all, 1, scouts$"):
        ua.transmit("team", b"x", to="ears", radio="mesh")
    assert outlet.sent == [("scouts", "team", 0, "main"), ("scouts", "team", 1, "mesh")]


def test_what_radios_say_comes_to_each_and_is_old_at_the_next_tick() -> None:
    ua, arrivals = client(Outlet()), Arrivals()
    reply, heard = UnicastReply(7, True, 2, 90), []
    ua.radios["mesh"].on_reply(heard.append)
    arrivals.reply_came(reply, "mesh")
    arrivals.queue_changed(QueueState(3, 300), "mesh")
    arrivals.queue_changed(QueueState(1, 10))
    for arrival in arrivals.take():
        arrival(ua)
    assert ua.radio is ua.radios["main"]
    assert (ua.radio.queue, ua.radio.replies) == (QueueState(1, 10), ())
    assert (ua.radios["mesh"].queue, ua.radios["mesh"].replies) == (QueueState(3, 300), (reply,))
    assert heard == [reply]
    ua.take_clock(50)
    assert (ua.radios["mesh"].queue, ua.radios["mesh"].replies) == (QueueState(3, 300), ())


def test_a_packet_says_by_which_radio_it_came() -> None:
    ua, arrivals = client(Outlet()), Arrivals()
    came: list[Reception] = []
    ua.on_packet(lambda _sender, _channel, _payload, reception: came.append(reception))
    for radio in ("mesh", "main"):
        arrivals.packet_came(DeliveredPacket("1", "team", b"x", Stamp(4, 5), radio), -80.0, 9.0)
    for arrival in arrivals.take():
        arrival(ua)
    assert [(each.radio, each.seq) for each in came] == [("mesh", 4), ("main", 4)]


def test_packets_from_outside_have_numbers_of_the_node_and_are_no_business_of_its_agent() -> None:
    outlet = Outlet()
    ua, heard = client(outlet), []
    ua.radios["mesh"].on_reply(heard.append)
    ua.transmit("team", b"x", to="1", radio="mesh")
    ua.enter(channel="ip", payload=b"E", to="1", radio="mesh")
    ua.transmit("team", b"x", to="1", radio="mesh")
    assert [(channel, seq) for _, channel, seq, _ in outlet.sent] == [("team", 0), ("ip", 1), ("team", 2)]
    ua.radios["mesh"].take(None, [UnicastReply(seq, True, 1, 90) for seq in (0, 1, 2)])
    assert [reply.seq for reply in heard] == [0, 2] == [reply.seq for reply in ua.radios["mesh"].replies]
    ua.is_over = True
    ua.enter(channel="ip", payload=b"E", to="1", radio="mesh")
    assert ua.sent == len(outlet.sent) == 3


def test_however_many_packets_from_outside_wait_their_agent_hears_of_none() -> None:
    """A node takes 2000 packets from outside a tick, and a queue may hold them for many ticks."""
    ua, heard = client(Outlet()), []
    radio = ua.radios["mesh"]
    radio.on_reply(heard.append)
    own = []
    for tick in range(10):
        own.append(ua.transmit("team", b"x", to="1", radio="mesh"))
        for _ in range(2000):
            ua.enter(channel="ip", payload=b"E", to="1", radio="mesh")
        if tick % 2:
            own.append(ua.transmit("team", b"x", to="1", radio="mesh"))
    radio.take(None, [UnicastReply(seq, True, 1, 90) for seq in range(ua.sent)])
    assert ua.sent == 10 * 2001 + 5
    assert [reply.seq for reply in heard] == own


def test_who_does_not_ask_for_ip_gets_none() -> None:
    ua, arrivals = client(Outlet()), Arrivals()
    came: list[tuple[str, str]] = []
    for asked in ("", "ip", "team"):
        ua.on_packet(lambda _sender, channel, *_, asked=asked: came.append((asked, channel)), channel=asked)  # type: ignore[misc]
    for channel in ("ip", "team", "other"):
        arrivals.packet_came(DeliveredPacket("1", channel, b"x", Stamp(4, 5)), -80.0, 9.0)
    for arrival in arrivals.take():
        arrival(ua)
    assert came == [("ip", "ip"), ("", "team"), ("team", "team"), ("", "other")]


@pytest.mark.parametrize("radio", ["main", "mesh-2.4"])
def test_the_radio_travels_behind_power_and_instants(radio: str) -> None:
    instants = Instants(1, 2, 3, 4)
    raw = attachment(Stamp(4, 5).to_bytes(), -80.0, 9.5, instants, radio)
    sample = SimpleNamespace(attachment=SimpleNamespace(to_bytes=lambda: raw))
    assert raw.endswith(radio.encode())
    assert signal_of(sample) == (-80.0, 9.5, instants)  # type: ignore[arg-type]
    assert radio_of(sample) == radio  # type: ignore[arg-type]
    bare = SimpleNamespace(attachment=None)
    assert radio_of(bare) == "main"  # type: ignore[arg-type]
