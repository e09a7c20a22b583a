"""The virtual radio: everything that one node transmits goes through here, and what survives goes on.

`VirtualRadio` is the core: it takes packets, true positions and answers to ticks, and says what became of them. It
knows no Zenoh: the process around it is `bridge.radio.router.process`.

The router also closes each tick: once every regulated node has answered it, all packets of that tick are settled at
once, in one order whoever was first, and on their way; only then is the fleet clock released. So no packet is late
because the host was slow, and a run does not depend on how fast it went.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bridge.bus.handling import PLAIN, Handling
from bridge.bus.keys import Address
from bridge.bus.messages import Truth
from bridge.bus.session import Stamp
from bridge.radio.network_air import NetworkAir, Settled, joined
from bridge.radio.ring import Closed, Ring
from bridge.radio.senders import Refused, Senders, TxPacket
from bridge.radio.serial_output import SerialOutput
from bridge.record.tables.deliveries import Gap, Vocabulary
from channel.checks import ChannelInputError

if TYPE_CHECKING:
    from bridge.radio.modems import ModemsOfRun

FUTURE_MAX_NS = 10_000_000_000
"""A sim time further ahead of the newest truth than this is garbage."""
ENCODING_MAX = 1000
"""Characters that a program may say of a payload."""
AHEAD_MAX_NS = 1_000_000_000
"""A packet further ahead than this is: what waits for its truth has to be bounded."""


class VirtualRadio:
    """Settles the fate of each packet for each node that it is meant for. No I/O, no clock.

    Args:
        airs: the radio networks; all nodes are on the first.
        ring: who is waited for.
        modems: of nodes, on these networks; None: there are none.
        free: nodes as which programs transmit that the clock does not wait for, whether or not it waits for the node.
    """

    def __init__(
        self,
        airs: Sequence[NetworkAir],
        ring: Ring,
        modems: ModemsOfRun | None = None,
        free: Collection[str] = (),
    ) -> None:
        self.airs = tuple(airs)
        self._modems = modems
        self.nodes = self.airs[0].nodes
        self.ring = ring
        self.free = frozenset(free)
        self.words = Vocabulary()
        self.words.places("radio", [air.name for air in self.airs])
        self.transmitted: list[TxPacket] = []
        """Packets given to the medium, in canonical order; whoever writes them clears the list."""
        self._by_name = {air.name: air for air in self.airs}
        self._index = self.airs[0].index
        self._emitters = frozenset(self.airs[0].medium.emitters.names)
        self._senders = Senders([air.mtu_bytes for air in self.airs], self._book_gap)
        self.refused = self._senders.refused
        self._latest_ns = 0
        self._gaps: list[Gap] = []

    # What comes in.

    def on_truths(self, truths: Sequence[Truth]) -> None:
        """Take the true states of nodes, each once, in the fleet's frame."""
        good = [truth for truth in truths if self._is_good(truth)]
        nodes = [truth for truth in good if truth.header.frame_id in self._index]
        emitters = [truth for truth in good if truth.header.frame_id in self._emitters]
        one_by_one = [(self._observe_emitter, each) for each in emitters]
        if nodes and not self._took(self._observe, nodes):
            one_by_one += [(self._observe, each) for each in nodes]
        for observe, each in one_by_one:
            if not self._took(observe, [each]):
                self.refused[Refused.MALFORMED] += 1

    def _is_good(self, truth: Truth) -> bool:
        node = truth.header.frame_id
        if node not in self._index and node not in self._emitters:
            self.refused[Refused.UNKNOWN_NODE] += 1
        elif not self._is_plausible(truth.header.stamp.ns):
            self.refused[Refused.MALFORMED] += 1
        else:
            return True
        return False

    def _took(self, observe: Callable[[Sequence[Truth]], None], truths: Sequence[Truth]) -> bool:
        """Whether they are numbers that a radio can work with."""
        try:
            observe(truths)
        except ChannelInputError:
            return False
        self._latest_ns = max(self._latest_ns, *(truth.header.stamp.ns for truth in truths))
        return True

    def _observe(self, truths: Sequence[Truth]) -> None:
        for air in self.airs:
            air.observe(truths)

    def _observe_emitter(self, truths: Sequence[Truth]) -> None:
        for air in self.airs:
            air.observe_emitter(truths)

    def on_packet(
        self,
        address: Address,
        payload: bytes,
        encoding: str,
        stamp: Stamp | None,
        handling: Handling = PLAIN,
    ) -> bool:
        """Take a packet with its sender's stamp; returns whether it was. `settle` decides its fate.

        One that comes late, from a program that the clock does not wait for, is transmitted at the tick that is open.
        """
        air = self._by_name.get(address.radio)
        why = self._why_refused(address, air, encoding, stamp)
        if stamp is None or air is None or why is not None:
            self.refused[why or Refused.WITHOUT_STAMP] += 1
            return False
        to = air.addressees[address.to]
        route = f"{address.radio}/{address.to}/{address.channel}"
        tx, at_ns = self._index[address.node], stamp.sim_time_ns
        if address.node in self.free:
            at_ns = max(at_ns, self.ring.received_ns)
        return self._senders.take(
            TxPacket(
                stamp.seq,
                at_ns,
                route,
                payload,
                encoding,
                air.handling_of(payload, handling),
                tx=tx,
                to=to,
                network=air.place,
            )
        )

    def _why_refused(
        self, address: Address, air: NetworkAir | None, encoding: str, stamp: Stamp | None
    ) -> Refused | None:
        if address.node not in self._index:
            return Refused.UNKNOWN_NODE
        if stamp is None:
            return Refused.WITHOUT_STAMP
        if air is None or address.node not in air.index:
            return Refused.UNKNOWN_RADIO
        if address.to == address.node or address.to not in air.addressees:
            return Refused.UNKNOWN_ADDRESS
        if len(encoding) > ENCODING_MAX:
            return Refused.MALFORMED
        return None if 0 <= stamp.sim_time_ns <= self._latest_ns + AHEAD_MAX_NS else Refused.MALFORMED

    def _is_plausible(self, sim_time_ns: int) -> bool:
        return 0 <= sim_time_ns <= self._latest_ns + FUTURE_MAX_NS

    def on_tick(self, sim_time_ns: int) -> None:
        """Take a tick of the fleet clock."""
        if not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED] += 1
            return
        self._latest_ns = max(self._latest_ns, sim_time_ns)
        self.ring.tick(sim_time_ns)

    def on_switch(self, node: str, sim_time_ns: int, *, on: bool) -> None:
        """Take a node's word that an operator switched its radios; it comes ahead of its answer to that instant."""
        if node not in self._index:
            self.refused[Refused.UNKNOWN_NODE] += 1
        elif not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED] += 1
        else:
            for air in self.airs:
                air.switch_radio(node, sim_time_ns, on=on)

    def on_answer(self, node: str, sim_time_ns: int) -> Closed | None:
        """Take a node's word that it has done all it will do at a tick, or at an exchange of MAVLink between two."""
        if node not in self.ring or not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED if node in self.ring else Refused.UNKNOWN_NODE] += 1
            return None
        return self.ring.answer(node, sim_time_ns)

    def radios_off(self, sim_time_ns: int) -> NDArray[np.bool_]:
        """Which radios are off at an instant, in the order of `nodes`."""
        return self.airs[0].medium.radios_off(sim_time_ns)

    def on_serial(self, node: str, radio: str, data: bytes, sim_time_ns: int) -> bool:
        """Take what the host of a node's modem said by an instant; returns whether it was taken."""
        network = None if self._modems is None else self._modems.networks.get(radio)
        if self._modems is None or network is None or not network.has(node):
            self.refused[Refused.UNKNOWN_RADIO] += 1
            return False
        if not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED] += 1
            return False
        self._modems.receive(node, radio, data, sim_time_ns)
        return True

    def on_sent_total(self, node: str, sent: int) -> None:
        """Take a sender's own count of what it gave to the radio; what never came here is booked."""
        if node not in self._index:
            self.refused[Refused.UNKNOWN_NODE] += 1
        elif not self._senders.told_total(self._index[node], sent, self._latest_ns):
            self.refused[Refused.MALFORMED] += 1

    def next_packet(self, node: str) -> Stamp:
        """What the next packet of ``node`` may be stamped with."""
        seq, latest_ns = self._senders.next_packet(self._index[node])
        return Stamp(seq, max(latest_ns, self._latest_ns))

    def on_dropped(self, node: str, seq: int) -> None:
        """Take note that the process dropped a node's packets up to number ``seq``: too much came at once."""
        if node in self._index and not self._senders.told_total(self._index[node], seq + 1, self._latest_ns):
            self.refused[Refused.MALFORMED] += 1

    def on_gap(self, gap: Gap) -> None:
        """Take packets that were lost before the channel in a run that is repeated."""
        self._senders.lose(gap)

    # What becomes of it.

    def settle(self) -> Settled:
        """Give what was taken to the networks, and take from them what they can decide."""
        self._send()
        serial = self._live_with_modems(self.ring.received_ns)
        settled = self._settled([air.settle(self.words, self.ring.received_ns) for air in self.airs])
        return replace(settled, serial=serial) if serial else settled

    def finish(self) -> Settled:
        """Settle what still waits, with the newest positions, and balance the books.

        Raises:
            LedgerError: sent is not delivered plus lost: a defect of ours.
        """
        self._send()
        received_ns, period_ns = self.ring.received_ns, self.ring.tick_period_ns
        return self._settled([air.finish(self.words, received_ns, period_ns) for air in self.airs])

    def _send(self) -> None:
        taken = self._senders.taken()
        if not taken:
            return
        self.transmitted += taken
        if len(self.airs) == 1:
            self.airs[0].send(taken)
            return
        for air in self.airs:
            mine = [packet for packet in taken if packet.network == air.place]
            if mine:
                air.send(mine)

    def _live_with_modems(self, until_ns: int) -> Sequence[SerialOutput]:
        if self._modems is None:
            return ()
        outputs = self._modems.live(until_ns)
        for name, sent in self._modems.sent().items():
            if sent:
                self._by_name[name].entered(sent)
                self.transmitted += sent
        return outputs

    def _settled(self, parts: Sequence[Settled]) -> Settled:
        settled = parts[0] if len(parts) == 1 else joined(parts)
        return replace(settled, gaps=self._taken_gaps())

    def _taken_gaps(self) -> Sequence[Gap]:
        gaps, self._gaps = sorted(self._gaps, key=_place_of), []  # whoever was first
        return gaps

    def _book_gap(self, gap: Gap) -> None:
        self._gaps += self._by_name[gap.radio].lose(gap)


def _place_of(gap: Gap) -> tuple[int, int, int]:
    """Where a gap stands among those of a tick."""
    return gap.sim_time_ns, gap.tx, gap.first_seq
