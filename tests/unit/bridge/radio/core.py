"""A virtual radio to try things on: nodes at places, packets by their numbers."""

from __future__ import annotations

from bridge.bus.keys import Address
from bridge.bus.messages import Header, Quaternion, Truth, Vector3
from bridge.bus.session import Stamp
from bridge.radio.network_air import NetworkAir, Settled
from bridge.radio.ring import Ring
from bridge.radio.virtual_radio import VirtualRadio
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import FATES
from channel.presets import radio_from_mapping

TICK_NS = 50_000_000
MTU_BYTES = 1000


def virtual_radio(
    preset: str = "perfect", nodes: tuple[str, ...] = ("0", "1"), *, seed: int = 1
) -> VirtualRadio:
    """A radio whose nodes are all regulated."""
    radio = Radio(radio_from_mapping({"preset": preset, "mtu_bytes": MTU_BYTES}))
    return VirtualRadio(
        [NetworkAir(Medium(radio, seed=seed, nodes=nodes))], Ring(nodes, tick_period_ns=TICK_NS)
    )


def place(core: VirtualRadio, sim_time_ns: int, **north_m: float) -> None:
    """Tell where nodes are: ``n0=5.0`` is node 0, 5 m north, 40 m up."""
    core.on_truths(
        Truth(
            Header.at(sim_time_ns, node.removeprefix("n")),
            position_ned_m=Vector3(north, 0.0, -40.0),
            attitude=Quaternion(),
        )
        for node, north in north_m.items()
    )


def send(
    core: VirtualRadio, tx: str, seq: int = 0, sim_time_ns: int = 0, payload: bytes = b"x", to: str = "all"
) -> bool:
    """Give a packet to the radio; whether it was taken."""
    return core.on_packet(Address(tx, "main", to, "team"), payload, "text/plain", Stamp(seq, sim_time_ns))


def fates(core: VirtualRadio, settled: Settled) -> list[tuple[str, str, int, str]]:
    """Sender, receiver, number and fate of each reception."""
    r = settled.receptions
    return [
        (core.nodes[r.packets.tx[i]], core.nodes[rx], int(r.packets.seq[i]), FATES[fate].value)
        for i, rx, fate in zip(r.packet.tolist(), r.rx.tolist(), r.fate.tolist(), strict=True)
    ]
