"""What hosts get: each packet once, for the nodes that it reached; and who was heard."""

from __future__ import annotations

from bridge.agents.client import LookAtStatus
from bridge.agents.running.feed import DeliveredPacket
from bridge.bus.messages import CommunicationStatus, Header, Heard, decode, encode
from bridge.bus.reception import Instants
from bridge.host.arrivals import hand_out
from bridge.radio.heard import Hosts
from bridge.radio.picture import Picture
from bridge.radio.radio import SettledTick
from bridge.radio.virtual_radio import VirtualRadio
from channel.medium.reception import DELIVERED
from tests.unit.bridge.radio.core import place, send, virtual_radio

NODES = ("0", "1", "2", "gcs")
GROUPS = {"host-0": ("0", "2"), "host-1": ("1",)}


class Ear:
    """A node that keeps what comes."""

    def __init__(self) -> None:
        self.packets: list[DeliveredPacket] = []
        self.signals: list[tuple[float, float]] = []
        self.looks: list[LookAtStatus] = []

    def packet_came(self, packet: DeliveredPacket, rssi_dbm: float, snr_db: float, _: Instants) -> None:
        self.packets.append(packet)
        self.signals.append((rssi_dbm, snr_db))

    def comm_status_came(self, look: LookAtStatus) -> None:
        self.looks.append(look)


def apart() -> VirtualRadio:
    """Node 1 is out of everybody's range."""
    core = virtual_radio("disk", nodes=NODES)
    place(core, 0, n0=0.0, n1=1e6, n2=10.0, ngcs=20.0)
    return core


def shares(core: VirtualRadio, picture: Picture) -> dict[str, Heard]:
    return {host: decode(encode(share), Heard) for host, share in called(core, picture).items()}


def called(core: VirtualRadio, picture: Picture) -> dict[str, Heard]:
    """The same without a bus between."""
    settled = core.settle()
    picture.take(settled.columns)
    return Hosts(NODES, GROUPS).shares(SettledTick(7, settled, picture.changed(), ()))


def test_a_packet_is_there_once_for_all_nodes_of_a_host() -> None:
    core = apart()
    send(core, "gcs", payload=b"to all")
    send(core, "0", payload=b"more")
    heard = shares(core, Picture(NODES, ["main"]))["host-0"]
    assert heard.data == b"moreto all"
    ears = {"0": Ear(), "2": Ear()}
    hand_out(heard, NODES, ears)
    assert [(p.sender, p.channel, p.payload) for p in ears["0"].packets] == [("gcs", "team", b"to all")]
    assert [p.payload for p in ears["2"].packets] == [b"more", b"to all"]
    assert ears["0"].packets[0] is ears["2"].packets[1]


def test_what_is_called_hands_out_what_the_bus_would() -> None:
    """To the bit and the type: an agent computes with it."""
    told = []
    for path in (shares, called):
        core = apart()
        send(core, "gcs", payload=b"to all")
        ear = Ear()
        hand_out(path(core, Picture(NODES, ["main"]))["host-0"], NODES, {"0": ear, "2": Ear()})
        told.append((ear.packets, ear.signals, [look() for look in ear.looks]))
    assert told[0] == told[1]
    assert [type(number) for signal in told[1][1] for number in signal] == [float, float]
    assert type(told[1][0][0].stamp.seq) is int


def test_a_host_hears_of_losses_too() -> None:
    core, picture = apart(), Picture(NODES, ["main"])
    send(core, "0")
    heard = shares(core, picture)["host-1"]
    assert (heard.packet, heard.data) == ((), b"")
    ear = Ear()
    hand_out(heard, NODES, {"1": ear})
    assert [look() for look in ear.looks] == [CommunicationStatus(Header.at(7, "1"), ("0",), (False,))]
    assert shares(core, picture) == {}


def test_the_status_is_of_the_latest_packet_of_each_node() -> None:
    core, picture = apart(), Picture(NODES, ["main"])
    send(core, "0")
    send(core, "2")
    send(core, "1")
    ear, other = Ear(), Ear()
    hand_out(shares(core, picture)["host-0"], NODES, {"0": ear, "2": other})
    (look,) = ear.looks
    assert look() == CommunicationStatus(Header.at(7, "0"), ("1", "2"), (False, True))
    place(core, 50_000_000, n0=0.0, n1=30.0, n2=1e6, ngcs=20.0)
    send(core, "1", 1, 50_000_000)
    hand_out(shares(core, picture)["host-0"], NODES, {"0": ear, "2": other})
    assert ear.looks[1]() == CommunicationStatus(Header.at(7, "0"), ("1", "2"), (True, True))


def test_links_have_the_latest_figures_and_the_counts() -> None:
    core, picture = apart(), Picture(NODES, ["main"])
    for seq in range(3):
        send(core, "0", seq)
    picture.take(core.settle().columns)
    links = picture.links(9, [air.settled for air in core.airs], core.radios_off(9))
    names = [(links.node[tx], links.node[rx]) for tx, rx in zip(links.tx, links.rx, strict=True)]
    assert names == [("0", "1"), ("0", "2"), ("0", "gcs")]
    assert list(links.sent) == [3, 3, 3]
    assert list(links.delivered) == [0, 3, 3]
    assert list(links.distance_m) == [1e6, 10.0, 20.0]
    assert decode(encode(links), type(links)).distance_m == (1e6, 10.0, 20.0)


def test_each_receiver_is_told_the_power_that_the_packet_had_there() -> None:
    core = virtual_radio("corrected", nodes=NODES)
    place(core, 0, n0=0.0, n1=40.0, n2=30.0, ngcs=20.0)
    for seq in range(20):
        send(core, "gcs", seq)
        send(core, "1", seq)
    settled = core.settle()
    ears = {node: Ear() for node in NODES}
    for host, share in Hosts(NODES, GROUPS).shares(SettledTick(7, settled, [], ())).items():
        hand_out(decode(encode(share), Heard), NODES, {node: ears[node] for node in GROUPS[host]})
    r = settled.receptions
    for rx, node in enumerate(NODES[:3]):
        mine = (r.rx == rx) & (r.fate == DELIVERED)
        told = [(round(rssi, 3), round(snr, 3)) for rssi, snr in ears[node].signals]
        assert told == list(zip(r.received_power_dbm[mine], r.snr_db[mine], strict=True))
        assert len({rssi for rssi, _ in told}) >= 20
