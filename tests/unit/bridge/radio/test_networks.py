"""Several radio networks at the radio: who is on which, what is taken, and what each books."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bridge.bus.keys import Address
from bridge.bus.messages import Header, Heard, decode, encode
from bridge.bus.session import Stamp
from bridge.host.arrivals import hand_out
from bridge.radio.heard import Hosts
from bridge.radio.network_air import NetworkAir, Settled
from bridge.radio.picture import Picture
from bridge.radio.radio import SettledTick
from bridge.radio.ring import Ring
from bridge.radio.senders import Refused
from bridge.radio.virtual_radio import VirtualRadio
from bridge.record.tables.deliveries import FATES
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import radio_from_mapping
from tests.unit.bridge.radio.core import TICK_NS, place

NODES = ("0", "1", "2", "gcs")
ON_MESH = ("2", "0", "gcs")
"""In an order of their own."""
GROUPS = {"scouts": ("1", "2"), "masts": ("gcs", "2"), "alone": ("1",)}
MTU_BYTES = {"main": 100, "mesh": 1000}


def air(name: str, nodes: Sequence[str], number: int) -> NetworkAir:
    radio = Radio(radio_from_mapping({"preset": "perfect", "mtu_bytes": MTU_BYTES[name]}))
    groups = {group: [node for node in members if node in nodes] for group, members in GROUPS.items()}
    medium = Medium(radio, seed=1, nodes=nodes, groups=groups, network="" if name == "main" else name)
    return NetworkAir(medium, name=name, nodes=NODES, place=number)


def two_networks() -> VirtualRadio:
    core = VirtualRadio([air("main", NODES, 0), air("mesh", ON_MESH, 1)], Ring(NODES, tick_period_ns=TICK_NS))
    place(core, 0, n0=0.0, n1=10.0, n2=20.0, ngcs=30.0)
    return core


def send(core: VirtualRadio, tx: str, seq: int, radio: str, to: str = "all", length: int = 10) -> bool:
    return core.on_packet(Address(tx, radio, to, "team"), bytes(length), "", Stamp(seq, 0))


def told(settled: Settled) -> list[tuple[str, str, int, str]]:
    c = settled.columns
    rows = zip(*(c[name].tolist() for name in ("tx", "rx", "seq", "fate")), strict=True)
    return [(NODES[tx], NODES[rx], seq, FATES[fate]) for tx, rx, seq, fate in rows]


def test_a_packet_comes_to_the_nodes_of_its_network_and_nobody_else() -> None:
    core = two_networks()
    assert send(core, "0", 0, "main")
    assert send(core, "0", 1, "mesh")
    assert send(core, "2", 0, "mesh", to="gcs")
    settled = core.settle()
    assert sorted(told(settled)) == [
        ("0", "1", 0, "delivered"),
        ("0", "2", 0, "delivered"),
        ("0", "2", 1, "delivered"),
        ("0", "gcs", 0, "delivered"),
        ("0", "gcs", 1, "delivered"),
        ("2", "gcs", 0, "delivered"),
    ]
    distances = settled.columns["distance_m"][settled.columns["tx"] == 2]
    assert distances.tolist() == [10.0]
    r = settled.receptions
    sent = [settled.packets[row] for row in r.packet.tolist()]
    assert [p.seq for p in sent] == settled.columns["seq"].tolist()
    radios = [core.words.names["radio"][row] for row in settled.columns["radio"].tolist()]
    assert [p.radio for p in sent] == radios


def test_a_radio_that_a_node_has_not_takes_nothing() -> None:
    core = two_networks()
    assert not send(core, "1", 0, "mesh")
    assert not send(core, "0", 0, "lora")
    assert core.refused == {Refused.UNKNOWN_RADIO: 2}
    assert not send(core, "0", 0, "mesh", to="1")
    assert core.refused[Refused.UNKNOWN_ADDRESS] == 1
    assert send(core, "0", 0, "mesh", to="2")


def test_each_radio_has_its_mtu_and_what_is_too_long_has_a_row_for_each_of_its_receivers() -> None:
    core = two_networks()
    assert send(core, "0", 0, "main", length=101)
    assert send(core, "0", 1, "mesh", length=101)
    assert send(core, "0", 2, "mesh", length=1001)
    settled = core.settle()
    assert {(seq, rx) for _, rx, seq, _ in told(settled)} == {(1, "2"), (1, "gcs")}
    assert [(gap.radio, gap.first_seq, gap.to) for gap in settled.gaps] == [
        ("main", 0, -1),
        ("mesh", 2, 2),
        ("mesh", 2, 3),
    ]


def test_a_packet_to_a_group_comes_to_its_members_on_the_network_and_nobody_else_has_a_fate() -> None:
    core = two_networks()
    assert send(core, "0", 0, "main", to="scouts")
    assert send(core, "0", 1, "mesh", to="scouts")
    assert send(core, "2", 0, "mesh", to="masts")  # as a member, which does not hear itself
    assert send(core, "1", 0, "main", to="alone")  # for nobody: no fate, and the books balance
    assert not send(core, "0", 2, "mesh", to="alone")
    assert not send(core, "0", 2, "main", to="scoots")
    assert core.refused == {Refused.UNKNOWN_ADDRESS: 2}
    settled = core.settle()
    assert sorted(told(settled)) == [
        ("0", "1", 0, "delivered"),
        ("0", "2", 0, "delivered"),
        ("0", "2", 1, "delivered"),
        ("2", "gcs", 0, "delivered"),
    ]
    core.finish()
    main, mesh = ({link: a.sent for link, a in air.ledger.links.items()} for air in core.airs)
    assert main == {("0", "1"): 1, ("0", "2"): 1}
    assert mesh == {("0", "2"): 1, ("2", "gcs"): 1}


def test_what_is_too_long_for_a_group_is_lost_at_its_members() -> None:
    core = two_networks()
    send(core, "0", 0, "main", to="scouts", length=101)
    send(core, "2", 0, "mesh", to="masts", length=1001)
    gaps = [(gap.radio, gap.tx, gap.to, gap.cause) for gap in core.settle().gaps]
    assert gaps == [("main", 0, 1, "too_long"), ("main", 0, 2, "too_long"), ("mesh", 2, 3, "too_long")]
    core.finish()
    main, mesh = ({link: dict(a.lost) for link, a in air.ledger.links.items()} for air in core.airs)
    assert main == {("0", "1"): {"too_long": 1}, ("0", "2"): {"too_long": 1}}
    assert mesh == {("2", "gcs"): {"too_long": 1}}


def test_each_network_balances_and_tells_its_counts_by_places_among_all_nodes() -> None:
    core = two_networks()
    for seq, radio in enumerate(("main", "mesh", "mesh")):
        send(core, "0", seq, radio)
    core.on_sent_total("0", 5)  # two that never came count as of main
    core.settle()
    core.finish()
    main, mesh = (each.ledger for each in core.airs)
    assert {link: (a.sent, a.delivered, dict(a.lost)) for link, a in main.links.items()} == {
        ("0", rx): (3, 1, {"transport": 2}) for rx in ("1", "2", "gcs")
    }
    assert {link: (a.sent, a.delivered) for link, a in mesh.links.items()} == {
        ("0", "2"): (2, 2),
        ("0", "gcs"): (2, 2),
    }
    counts = [
        [(tx, rx, n) for (tx, rx), n in np.ndenumerate(air.settled.sum(axis=-1)) if n] for air in core.airs
    ]
    assert counts == [[(0, 1, 3), (0, 2, 3), (0, 3, 3)], [(0, 2, 2), (0, 3, 2)]]


def test_a_switch_is_for_all_radios_of_a_node() -> None:
    core = two_networks()
    core.on_switch("2", 0, on=False)
    send(core, "0", 0, "main", to="2")
    send(core, "0", 1, "mesh", to="2")
    assert [fate for *_, fate in told(core.settle())] == ["radio_off", "radio_off"]


def test_hosts_are_told_by_which_radio_a_packet_came() -> None:
    class Ear:
        def __init__(self) -> None:
            self.came: list[tuple[str, int]] = []

        def packet_came(self, packet: object, *_: object) -> None:
            self.came.append((packet.radio, packet.stamp.seq))  # type: ignore[attr-defined]

        def comm_status_came(self, _: object) -> None:
            pass

    core, ears = two_networks(), {node: Ear() for node in NODES}
    send(core, "0", 0, "main")
    send(core, "0", 1, "mesh")
    settled, picture = core.settle(), Picture(NODES, ("main", "mesh"))
    picture.take(settled.columns)
    tick = SettledTick(7, settled, picture.changed(), ())
    for path in (lambda heard: heard, lambda heard: decode(encode(heard), Heard)):
        for ear in ears.values():
            ear.came = []
        heard = path(Hosts(NODES, {"host": NODES}).shares(tick)["host"])
        assert heard.header == Header.at(7, "host")
        hand_out(heard, NODES, ears, ("main", "mesh"))  # type: ignore[arg-type]
        assert {node: ear.came for node, ear in ears.items()} == {
            "0": [],
            "1": [("main", 0)],
            "2": [("main", 0), ("mesh", 1)],
            "gcs": [("main", 0), ("mesh", 1)],
        }
