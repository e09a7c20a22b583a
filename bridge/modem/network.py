"""Modems of one network, and the units that are on the air between them: each hears all that is sent.

At each instant of `next_ns` whoever has it calls `step`, runs the medium in between, and gives it the fates of packets:

    network.listen(now_ns - 1)
    network.step(now_ns, fates_until(now_ns))
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

from bridge.modem.modem import HostBytes, Modem
from bridge.modem.units import Unit
from channel.access.packets import AirFate
from channel.medium.reception import Fate


class Output(NamedTuple):
    """Bytes for the host of a modem: the node that it is at."""

    end: int
    bytes: HostBytes


class OnAir(NamedTuple):
    """A packet that was given to the radio.

    Attributes:
        number: of its sender.
        receivers: who has a fate of it.
    """

    number: int
    receivers: Sequence[int]


Offer = Callable[[int, bytes, int], OnAir]
"""Puts bytes of a node on the air at an instant, as one packet."""

CauseOf = Callable[[AirFate], Fate]
"""The record's word for why a packet was lost."""


@dataclass(slots=True)
class _Sent:
    """A unit on the air; by receiver its packets without a fate, the pieces in which others came, why it is lost."""

    unit: Unit
    open_packets: dict[int, int] = field(default_factory=dict)
    parts: dict[int, int] = field(default_factory=dict)
    losses: dict[int, Fate] = field(default_factory=dict)
    was_on_air: bool = False
    is_told: bool = False


class ModemNetwork:
    """Modems on one medium.

    Args:
        modems: by node.
        offer: gives a packet to the radio.
        cause: says why one was lost.
    """

    def __init__(self, modems: Mapping[int, Modem], offer: Offer, cause: CauseOf) -> None:
        self.modems = dict(sorted(modems.items()))
        self._offer, self._cause = offer, cause
        self._sent: dict[tuple[int, int, int], _Sent] = {}
        """Units by sender, number of a packet of theirs, and receiver that has no fate of it."""

    @property
    def units_under_way(self) -> int:
        """Given to a radio, and not yet both arrived or lost everywhere."""
        return len({id(sent) for sent in self._sent.values()})

    def next_ns(self, agenda_ns: int | None) -> float:
        """The next instant at which anything can happen.

        Args:
            agenda_ns: when something is due on the medium; None: nothing is.
        """
        at_ns = inf if agenda_ns is None else agenda_ns
        for modem in self.modems.values():
            acts_ns = modem.acts_ns()
            if acts_ns is not None and acts_ns < at_ns:
                at_ns = acts_ns
        return at_ns

    def listen(self, until_ns: int) -> None:
        """Take in what hosts have sent up to an instant: before the medium goes on, which makes room for more.

        Args:
            until_ns: not beyond `next_ns`.
        """
        for node, modem in self.modems.items():
            for unit in modem.listen(until_ns):
                self._send(node, unit, until_ns)

    def step(self, now_ns: int, fates: Iterable[AirFate]) -> None:
        """All that happens now; it was listened up to just before, and nothing else happened since the last step.

        Args:
            now_ns: the medium has come to this instant.
            fates: of packets, decided since the last step.
        """
        self.listen(now_ns)
        for fate in fates:
            self._settle(fate, now_ns)
        for modem in self.modems.values():
            modem.tell(now_ns)

    def outputs(self, until_ns: int) -> list[Output]:
        """What has come out at hosts by an instant, in the order of instants."""
        outputs = [
            Output(node, each) for node, modem in self.modems.items() for each in modem.outputs(until_ns)
        ]
        outputs.sort(key=lambda output: (output.bytes.at_ns, output.end))
        return outputs

    def _send(self, node: int, unit: Unit, now_ns: int) -> None:
        """Give a unit to the radio, in packets that its medium takes."""
        longest = self.modems[node].settings.packet_bytes
        sent = _Sent(unit)
        for begin in range(0, len(unit.data), longest):
            number, receivers = self._offer(node, unit.data[begin : begin + longest], now_ns)
            for receiver in receivers:
                sent.open_packets[receiver] = sent.open_packets.get(receiver, 0) + 1
                self._sent[node, number, receiver] = sent

    def _settle(self, fate: AirFate, now_ns: int) -> None:
        """A packet has arrived somewhere or is lost there; a unit is lost with any of its packets."""
        node, receiver = fate.packet.node, fate.receiver
        sent = self._sent.pop((node, fate.packet.number, receiver), None)
        if sent is None:  # somebody else's on the same air
            return
        sent.open_packets[receiver] -= 1
        sent.parts[receiver] = sent.parts.get(receiver, 0) + fate.parts
        if fate.loss is not None:
            sent.losses.setdefault(receiver, self._cause(fate))
        sent.was_on_air |= fate.started_ns >= 0
        if sent.open_packets[receiver]:
            return
        sender, counts = self.modems[node], self.modems[node].counts
        if sent.was_on_air and not sent.is_told:
            sent.is_told = True
            sender.was_on_air(sent.unit)
        cause = sent.losses.get(receiver)
        if cause is not None:
            counts.units_lost[cause] += 1
            return
        counts.units_arrived += 1
        counts.bytes_arrived += len(sent.unit.data)
        if receiver in self.modems:
            self.modems[receiver].deliver(sent.unit.data, now_ns, sent.parts[receiver])
