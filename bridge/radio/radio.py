"""The radio of a run, all networks: virtual radio, RF sensors, and the record of both. No bus: it is called."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.bus.handling import PLAIN, Handling
from bridge.bus.keys import Address
from bridge.bus.messages import AgentStatus, DataPackage, DecodeError, Links, Truth, decode, encoding_of
from bridge.bus.session import Stamp
from bridge.radio.ledger_file import LEDGER, Books, write_ledger
from bridge.radio.measurements import SensorsOfRun, Told
from bridge.radio.network_air import NetworkAir, Settled
from bridge.radio.picture import Picture, Row
from bridge.radio.repeated import RepeatedPackets
from bridge.radio.ring import Closed, Ring
from bridge.radio.senders import Refused
from bridge.radio.settling_watch import SettlingWatch
from bridge.radio.virtual_radio import VirtualRadio
from bridge.record import names
from bridge.record.events import AGENT_WARNING, RADIO_BLOCKED, Report, transmits_freely
from bridge.record.inputs.radio_switches import switches_of
from bridge.record.on_disk import RADIO, note_on_disk
from bridge.record.packets import encode_packet
from bridge.record.streams import StreamWriter
from bridge.record.tables.deliveries import DeliveryWriter, Gap
from bridge.record.tables.routes import RouteWriter
from bridge.run.directory import RunDirectory
from bridge.scenario.resolve.channel import channels_of
from bridge.scenario.resolve.sensing import emitters_of, sensors_of

if TYPE_CHECKING:
    from bridge.radio.modems import ModemsOfRun

NO_PACKAGE = "no_data_package_on_the_data_channel"
"""Counter, with the sender's id behind it: of packets that agents would keep as data packages, and cannot read."""
PACKAGE_ENCODING = encoding_of(DataPackage)
REFUSALS_LOGGED_MAX = 20
log = logging.getLogger("router")


@dataclass(frozen=True, slots=True)
class SettledTick:
    """What became of a tick at the radio.

    Attributes:
        sim_time_ns: the tick.
        settled: its packets.
        rows: whom each node heard, of those for which that changed.
        told: what RF sensors report.
    """

    sim_time_ns: int
    settled: Settled
    rows: Sequence[Row]
    told: Sequence[Told]


class RecordedRadio:
    """The radio of a run.

    Args:
        run: the run; it may name another one whose inputs are to be repeated.
        report: of the process.

    Attributes:
        repeated: free nodes, of a run that repeats another: their packets are those of its record.

    Raises:
        TableError, StreamError, OSError: the record that is to be repeated cannot be read.
    """

    def __init__(self, run: RunDirectory, report: Report) -> None:
        scenario = run.scenario
        nodes = scenario.transceiver_ids
        self._run, self._report = run, report
        self._watch = SettlingWatch(self._is_blocked)
        ring = Ring(
            scenario.regulated,
            tasks=scenario.nodes_with_a_task,
            end_ns=round(scenario.duration_s * 1e9),
            tick_period_ns=scenario.tick_period_ns,
        )
        switches = {name: switches_of(scenario, network=name) for name in scenario.network_names}
        self._modems: ModemsOfRun | None = None
        if any(node.modems for node in scenario.transceivers):
            from bridge.radio.modems import ModemsOfRun, watches_of  # pymavlink takes its time

            meters = watches_of(scenario, scenario.network_names)
            self._channels = channels_of(scenario, switches, meters)
            self._modems = ModemsOfRun.of(scenario, self._channels, meters)
        else:
            self._channels = channels_of(scenario, switches)
        airs = [
            NetworkAir(each.medium, each.network, name=each.name, nodes=nodes, place=place)
            for place, each in enumerate(self._channels)
        ]
        free = {node.node for node in scenario.transceivers if not node.has_agent}
        replay = run.info.replay
        self.repeated = frozenset(free if replay else ())
        self._record = RepeatedPackets(Path(replay), nodes, free) if self.repeated else None
        self.core = VirtualRadio(airs, ring, self._modems, free - self.repeated)
        self.picture = Picture(nodes, scenario.network_names)
        self._silent = free - self.repeated
        """Free nodes as which no program has transmitted yet."""
        self._several: set[str] = set()
        """Free nodes as which several programs transmit."""
        self._has_lost_fates = False
        """A channel that raises leaves packets without a fate: books that cannot be closed."""
        self._data_channel = scenario.transmit.channel
        self._packets = {node: StreamWriter(names.packets(node).path(run.path)) for node in nodes}
        self._written_ns = [0] * len(nodes)
        """Of each node's packets, the latest tick that was written."""
        self._settled_ns = 0
        """The latest tick, or in the end the one after it, at which packets were given to the medium."""
        self._written_before_ns = 0
        """Nothing of earlier instants is to be written any more, but for packets without a fate yet."""
        self._free = free
        names_of_routed = [each.name for each in self._channels if each.routing is not None]
        self._writer = DeliveryWriter(
            run.path,
            nodes,
            self.core.words,
            routed=bool(names_of_routed),
            parted=bool(scenario.partitions),
        )
        self._routes = RouteWriter(run.path, nodes, names_of_routed) if names_of_routed else None
        self._sensors = SensorsOfRun.of(
            run, sensors_of(scenario), emitters_of(scenario), self._channels[0].medium
        )

    # What comes in.

    def truths(self, truths: Sequence[Truth]) -> None:
        """Take the true states of nodes."""
        self.core.on_truths(truths)

    def tick(self, sim_time_ns: int) -> None:
        """Take a tick of the fleet clock."""
        self.core.on_tick(sim_time_ns)

    def packet(
        self,
        address: Address,
        payload: bytes,
        encoding: str,
        stamp: Stamp | None,
        handling: Handling = PLAIN,
    ) -> None:
        """Take what a node transmits."""
        if not self.core.on_packet(address, payload, encoding, stamp, handling):
            self.tell_refusal(f"a packet of node {address.node} to {address.to} on {address.channel}")
            self._tell_if_several(address.node, stamp)
            return
        self._tell_if_free(address.node)
        if address.channel == self._data_channel and not _is_package(payload, encoding):
            self._report.count(f"{NO_PACKAGE}.{address.node}")

    def agent(self, node: str, status: AgentStatus) -> None:
        """Take what a node's agent says of itself."""
        self.core.on_sent_total(node, status.sent)
        self._tell_if_free(node)
        if status.failed:
            self.core.ring.end()
        if status.done:
            self.core.ring.done(node)

    def serial(self, node: str, radio: str, data: bytes, sim_time_ns: int) -> None:
        """Take what the host of a node's modem said by an instant at which the fleet was held."""
        if not self.core.on_serial(node, radio, data, sim_time_ns):
            self.tell_refusal(f"{len(data)} serial bytes of node {node} for radio {radio}")

    def switch(self, node: str, sim_time_ns: int, *, on: bool) -> None:
        """Take a node's word that an operator switched its radio."""
        self.core.on_switch(node, sim_time_ns, on=on)
        log.info("an operator switched the radio of node %s %s", node, "on" if on else "off")

    def answer(self, node: str, sim_time_ns: int) -> Closed | None:
        """Take a node's word that it is done with an instant; `settle` a tick that this closes."""
        return self.core.on_answer(node, sim_time_ns)

    def _tell_if_free(self, node: str) -> None:
        """What a node that the clock does not wait for does, it does by wall time."""
        if node in self._silent:
            self._silent.discard(node)
            self._report.may_not_repeat(transmits_freely(node))

    def _tell_if_several(self, node: str, refused: Stamp | None) -> None:
        """Of programs that the clock does not wait for one at a time is to transmit as a node; numbers of two meet."""
        if refused is None or node in self._several or node not in self.core.free:
            return
        if refused.seq < self.core.next_packet(node).seq:
            self._several.add(node)
            text = (
                "a packet with a number that was used is refused: two programs transmit as it at once, or one repeats "
                "itself"
            )
            self._report.event(self.core.ring.received_ns, node, AGENT_WARNING, text)

    def tell_refusal(self, text: str) -> None:
        """Log what was refused, the first times."""
        if self.core.refused.total() <= REFUSALS_LOGGED_MAX:
            so_far = ", ".join(f"{count} {reason}" for reason, count in self.core.refused.items())
            log.warning("refused %s; refused so far: %s", text, so_far)

    def tell_what_is_waited_for(self) -> None:
        """Log why no tick is closed."""
        nodes = self.core.ring.waiting_for
        if nodes:
            log.warning("nodes %s have not answered the latest tick", ", ".join(nodes))
        else:
            log.warning("all nodes have answered the latest tick: the flight dynamics wait for an autopilot")

    # What becomes of it.

    def settle(self, sim_time_ns: int) -> SettledTick:
        """Settle the packets of a closed tick, and have the sensors measure; `write` is to follow."""
        self._settled_ns = sim_time_ns
        self._repeat(self.core.ring.received_ns)
        try:
            with self._watch.at(sim_time_ns):
                settled = self.core.settle()
        except BaseException:
            self._has_lost_fates = True
            raise
        told = self._sensors.measure(sim_time_ns) if self._sensors is not None else ()
        self.picture.take(settled.columns)
        return SettledTick(sim_time_ns, settled, self.picture.changed(), told)

    def _is_blocked(self, sim_time_ns: int, text: str) -> None:
        """On disk at once: no other tick may come, and whoever gives the run up reads it."""
        self._report.event(sim_time_ns, "", RADIO_BLOCKED, text)
        self._report.flush()

    def _repeat(self, before_ns: int) -> None:
        """Take what programs transmitted as free nodes in the run that is repeated."""
        for item in () if self._record is None else self._record.before(before_ns):
            if isinstance(item.what, Gap):
                self.core.on_gap(item.what)
                continue
            packet = item.what
            address = Address(item.node, *packet.address.split("/", 2))
            stamp = Stamp(packet.seq, packet.sim_time_ns)
            self.packet(address, packet.payload, packet.encoding, stamp, packet.handling)

    def links(self, sim_time_ns: int) -> Links:
        """All links that carried a packet, as they are after a tick."""
        settled = [air.settled for air in self.core.airs]
        return self.picture.links(sim_time_ns, settled, self.core.radios_off(sim_time_ns))

    # The record.

    def write(self, settled: Settled) -> None:
        """Record what became of packets, and what was transmitted."""
        self._writer.write(settled.columns, settled.gaps, settled.received_ns)
        if self._routes is not None:
            self._routes.write(settled.routes)
        transmitted, self.core.transmitted = self.core.transmitted, []
        for packet in transmitted:
            is_ahead = packet.sim_time_ns >= settled.received_ns  # as a free program's may be stamped
            tick_ns = self._settled_ns if is_ahead else packet.sim_time_ns
            self._written_ns[packet.tx] = at_ns = max(self._written_ns[packet.tx], tick_ns)
            self._packets[self.core.nodes[packet.tx]].write(at_ns, encode_packet(packet))
        for node in self._free:
            self._packets[node].flush()  # inputs: of a run that is killed they are as whole as those of hosts
        self._written_before_ns = self._settled_ns + 1

    def flush(self) -> None:
        """Hand the record to the operating system."""
        self._writer.flush()
        if self._routes is not None:
            self._routes.flush()
        if self._sensors is not None:
            self._sensors.flush()
        for writer in self._packets.values():
            writer.flush()
        self._report.flush()
        note_on_disk(self._run.path, RADIO, self._written_before_ns)

    def finish(self, tell_progress: Callable[[float], object], dropped: int = 0) -> None:
        """Write what is left of the record, however long that takes; after a tick without fates no books.

        Args:
            tell_progress: called now and then with the share that is done.
            dropped: packets that came faster than they were taken.

        Raises:
            LedgerError: sent is not delivered plus lost: a defect of ours.
        """
        if self._has_lost_fates:
            self.close()
            return
        try:
            self._settled_ns = self.core.ring.received_ns
            self._repeat(self._settled_ns + 1)
            self.write(self.core.finish())
        finally:
            self.close()
        self._tell_overload(dropped)
        if self._modems is not None:
            self._report.set_counters(self._modems.counters())
        self._report.close()
        books = [
            Books.of(channel, air.ledger) for air, channel in zip(self.core.airs, self._channels, strict=True)
        ]
        write_ledger(self._run.path / LEDGER, books, self.core.refused, tell_progress)

    def close(self) -> None:
        """Close the files of the record as they are."""
        self._watch.close()
        self._writer.close()
        if self._routes is not None:
            self._routes.close()
        if self._sensors is not None:
            self._sensors.close()
        for writer in self._packets.values():
            writer.close()

    def _tell_overload(self, dropped: int) -> None:
        if dropped:
            self.core.refused[Refused.OVERLOAD] += dropped
            self._report.may_not_repeat(f"{dropped} packets came faster than the radio took them")
        elif self.core.refused[Refused.OVERLOAD]:
            self._report.may_not_repeat("a node transmitted more packets in a tick than the radio takes")


def _is_package(payload: bytes, encoding: str) -> bool:
    """Whether a packet is a data package: by what it is said to be, or else by its bytes."""
    if encoding == PACKAGE_ENCODING:
        return True
    try:
        decode(payload, DataPackage)
    except DecodeError:
        return False
    return True
