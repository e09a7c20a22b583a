"""What a network can carry: how much of its time packets of a length need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Literal

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN
from bridge.scenario.resolve.channel import medium_settings
from bridge.scenario.resolve.radio import radios_of
from channel.access.settings.air_time import AirTimeMedium
from channel.access.settings.base import Ideal, Shared
from channel.access.settings.elrs import ElrsMedium
from channel.access.settings.medium import MediumSettings
from channel.access.settings.sik import SikMedium
from channel.access.settings.tdma import TdmaMedium
from channel.link.radio import Radio

SharedBy = Literal["all", "group", "sender"]
UNITS = ((1e9, "Gbit/s"), (1e6, "Mbit/s"), (1e3, "kbit/s"))


def rate_text(bits_per_s: float) -> str:
    """A bit rate with three digits: ``10.9 Mbit/s``."""
    for size, unit in UNITS:
        if bits_per_s >= size:
            return f"{bits_per_s / size:.3g} {unit}"
    return f"{bits_per_s:.3g} bit/s"


@dataclass(frozen=True, slots=True)
class Capacity:
    """What a network of a run can carry.

    With `ideal`, where nothing takes time, it is what a radio's bit rate could: packets one after the other, without
    pauses. Otherwise it is what the medium's ``capacity_bps`` says.

    Attributes:
        settings: of the medium.
        radios: by node, of those that are on it.
        network: its name.
    """

    settings: MediumSettings
    radios: Mapping[str, Radio]
    network: str = MAIN

    @classmethod
    def of(cls, scenario: Scenario, network: str = MAIN) -> Capacity:
        """Of a scenario whose names are known to be right."""
        radios = radios_of(scenario, (), network)
        return cls(medium_settings(radios), radios, network)

    @property
    def medium(self) -> str:
        """Its name; of a medium of one's own, that of its class."""
        return str(getattr(self.settings, "model", type(self.settings).__name__))

    @property
    def takes_time(self) -> bool:
        """Whether packets take time on it."""
        return not isinstance(self.settings, Ideal)

    @property
    def has_turns(self) -> bool:
        """Whether a node waits until others are done, so that what is too much waits; else frames overlap."""
        return not isinstance(self.settings, AirTimeMedium)

    @property
    def is_tried(self) -> bool:
        """Whether what it carries of packets of a length is tried on the medium itself, which takes time."""
        return isinstance(self.settings, SikMedium)

    @property
    def max_length_bytes(self) -> float:
        """The longest payload that it takes."""
        return float(getattr(self.settings, "max_length_bytes", inf))

    @property
    def shared_by(self) -> SharedBy:
        """Who shares it: all nodes, those of a group (NETID, channel), or each sender has so much for itself."""
        if isinstance(self.settings, TdmaMedium) or not getattr(self.settings, "is_shared", True):
            return "sender"
        return "group" if len(self._linked) > 1 else "all"

    @property
    def sharers(self) -> tuple[tuple[str, ...], ...]:
        """Nodes that share what it carries; not those that the medium links with nobody."""
        if self.shared_by == "sender":
            return tuple((node,) for ids in self._linked for node in ids)
        return self._linked

    @property
    def _linked(self) -> tuple[tuple[str, ...], ...]:
        """Nodes that hear each other."""
        nodes, settings = tuple(self.radios), self.settings
        if isinstance(settings, ElrsMedium | SikMedium):
            return tuple(settings.links(nodes).values())
        if not isinstance(settings, Shared):
            return (nodes,)
        on_channel: dict[int, list[str]] = {}
        for node in nodes:
            on_channel.setdefault(settings.channels.get(node, 0), []).append(node)
        return tuple(map(tuple, on_channel.values()))

    def may_send(self, node: str) -> bool:
        """Whether the medium gives a node any time: not one without a slot, where there are slots."""
        return not isinstance(self.settings, TdmaMedium) or self.settings.has_slot(node)

    def packet_s(self, node: str, payload_bytes: int, priority: int | None = None) -> float:
        """The time that the network needs for a packet of a node: 0 if it has no room for it at all.

        Args:
            node: its id.
            payload_bytes: of the packet.
            priority: of the packet, where only some slots take it; None: it may be any.
        """
        settings, radio = self.settings, self.radios[node]
        if not self.may_send(node) or payload_bytes > self.max_length_bytes:
            return 0.0
        bit_rate_bps = radio.config.bit_rate_bps
        if isinstance(settings, Ideal):  # a fixed length may be less than the payload's
            return 8.0 * max(payload_bytes, radio.length_bytes(payload_bytes)) / bit_rate_bps
        length_bytes = max(payload_bytes, 1)
        nodes = tuple(self.radios)
        if isinstance(settings, TdmaMedium):
            capacity_bps = settings.node_capacity_bps(node, nodes, length_bytes, bit_rate_bps, priority)
        elif isinstance(settings, ElrsMedium):
            capacity_bps = settings.node_capacity_bps(node, nodes)
        else:
            capacity_bps = settings.capacity_bps(length_bytes, bit_rate_bps)
        return 8.0 * length_bytes / capacity_bps if capacity_bps > 0.0 else 0.0

    def own_s(self, node: str, payload_bytes: int) -> float:
        """The time that a packet needs of the part of what is shared that a node alone can use; 0 where that is all."""
        if not isinstance(self.settings, SikMedium) or not self.packet_s(node, payload_bytes):
            return 0.0
        length_bytes = max(payload_bytes, 1)
        capacity_bps = self.settings.node_capacity_bps(length_bytes)
        return 8.0 * length_bytes / capacity_bps if capacity_bps > 0.0 else 0.0

    def payload_bytes(self, node: str, counted_bytes: int) -> int:
        """The payload of a packet by the length that the error model counts; that length, if all have one."""
        radio = self.radios[node]
        overhead_bytes = radio.length_bytes(0)
        is_fixed = radio.length_bytes(1) == overhead_bytes
        return counted_bytes if is_fixed else counted_bytes - overhead_bytes
