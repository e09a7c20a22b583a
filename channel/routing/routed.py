"""A radio network whose nodes hand packets on: packets in, the fates of whole journeys out; each hop is on the air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from channel.access.agenda import ACTS
from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFate, AirFates, AirFrame, AirPacket, Loss, Outcome, Reply
from channel.routing.journey import Apart, Cargo, HopPacket, Journey, Leg, Nearness
from channel.routing.router import Hop, HopRouter, Notice, Onward
from channel.routing.watched import WatchedRouter
from sitl_configs.own_code import is_own


@dataclass(slots=True)
class RoutingCounts:
    """What routing cost a network.

    Attributes:
        sent: packets that their own senders transmitted, once each however often they were tried.
        handed_on: by other nodes.
        packet_air_ns: that these were on the air.
        duplicates: receptions of packets that a node had already.
        notices: frames that nodes told each other about routes with.
        notice_bytes: of these, before the medium's headers.
        notice_air_ns: on the air.
        notices_lost: that never were on the air.
    """

    sent: int = 0
    handed_on: int = 0
    packet_air_ns: int = 0
    duplicates: int = 0
    notices: int = 0
    notice_bytes: int = 0
    notice_air_ns: int = 0
    notices_lost: int = 0


def _everywhere(_frame: AirFrame, _node: int) -> float:
    return 0.0


def _together(_node: int, _other: int, _at_ns: int) -> float:
    return 0.0


class Routed:
    """A network on a medium that nothing was sent over yet.

    The medium has packets of this network alone: each hop is one, numbered by who transmits it. Outcomes are those of
    the packets that were offered: delivered with the first copy that comes, lost when no copy is under way any more, by
    the cause of the copy whose transmitter, or who would have handed it on, was nearest. What a sender learns of a
    unicast is what its first hop says (of a flood's nothing), or that it has no route.

    Args:
        medium: of the network.
        router: who sends what on.
        distance_m: of a frame's transmitter from a node.
        apart_m: of two nodes.

    Attributes:
        counts: so far.
    """

    def __init__(
        self,
        medium: AccessMedium,
        router: HopRouter,
        distance_m: Nearness = _everywhere,
        apart_m: Apart = _together,
    ) -> None:
        self._medium, self._distance_m, self._apart_m = medium, distance_m, apart_m
        self._agenda = medium.agenda
        self._nodes = tuple(sorted(medium.world.nodes))
        self._router = router = WatchedRouter(router, self._nodes) if is_own(type(router)) else router
        self._numbers = dict.fromkeys(self._nodes, 0)
        self._outcomes: list[Outcome | AirFates] = []
        self.counts = RoutingCounts()
        medium.tells(self._came)
        for node in self._nodes:
            first_ns = router.first_notice_ns(node)
            if first_ns is not None:
                self._agenda.at(first_ns, ACTS, node, self._tell, node)

    # As a medium: `channel.access.media.medium.AccessMedium`.

    def offer(self, packet: AirPacket) -> None:
        """Have a packet enter its sender's radio at its instant.

        Raises:
            ValueError: an instant that has passed.
        """
        self._agenda.at(packet.at_ns, ACTS, packet.node, self._begin, packet)

    def live(self, until_ns: int) -> list[Outcome | AirFates]:
        """Let the network live until an instant; what came of packets since the last call."""
        self._medium.live(until_ns)
        outcomes, self._outcomes = self._outcomes, []
        return outcomes

    def queued(self, node: int) -> tuple[int, int]:
        """How many packets wait in a node's radio, those of others too, and their length in bytes."""
        return self._medium.queued(node)

    def receivers_of(self, packet: AirPacket) -> tuple[int, ...]:
        """Who has a fate of it."""
        return tuple(node for node in self._nodes if packet.is_for(node))

    # Packets.

    def _begin(self, packet: AirPacket) -> None:
        journey = Journey(packet, self.receivers_of(packet), self._distance_m, self._apart_m)
        is_off = self._medium.is_off(packet.node, packet.at_ns)
        onward = Loss.RADIO_OFF if is_off else self._router.send(packet.node, packet)
        self._go_on(journey, packet.node, onward, None, None)
        self._end(journey)
        if isinstance(onward, Loss) and packet.to is not None:
            self._outcomes.append(Reply(packet, self._agenda.now_ns, acknowledged=False, attempts=0))

    def _go_on(
        self, journey: Journey, node: int, onward: Onward, last: AirFate | None, leg: Leg | None
    ) -> None:
        """Send a packet on from a node; `last` brought it there by `leg`, None: it is its sender."""
        now_ns = self._agenda.now_ns
        if isinstance(onward, Loss):
            journey.stopped(onward, now_ns, last, leg)
            return
        way = (*(() if leg is None else leg.way), node)
        attempts = 0 if last is None or leg is None else leg.attempts + last.attempts
        for copy, hop in enumerate(onward):
            journey.under_way += 1
            then = Leg(journey, way, attempts, copy)
            if hop.delay_ns:
                self._agenda.at(now_ns + hop.delay_ns, ACTS, node, self._transmit, node, hop, then)
            else:
                self._transmit(node, hop, then)

    def _transmit(self, node: int, hop: Hop, leg: Leg) -> None:
        packet, now_ns = leg.journey.packet, self._agenda.now_ns
        lifetime_ns = packet.lifetime_ns
        if lifetime_ns is not None:
            lifetime_ns += packet.at_ns - now_ns
        self._enter(
            HopPacket(
                node,
                self._numbers[node],
                hop.to,
                packet.length_bytes + self._router.header_bytes(hop),
                now_ns,
                packet.priority,
                lifetime_ns,
                f"{packet.node}:{leg.copy}:{packet.key}" if packet.key else "",
                cargo=Cargo(leg),
            )
        )

    def _enter(self, packet: HopPacket) -> None:
        self._numbers[packet.node] += 1
        packet.cargo.open = len(self._medium.receivers_of(packet))
        self._medium.offer(packet)

    def _came(self, outcome: Outcome) -> None:
        """The medium says what became of a hop."""
        packet = outcome.packet
        assert isinstance(packet, HopPacket), "the medium has packets of this network alone"
        cargo = packet.cargo
        if isinstance(outcome, Reply):
            self._replied(outcome, cargo)
            return
        cargo.open -= 1
        if cargo.leg is None:
            self._heard(packet, outcome)
            return
        if outcome.loss is None:
            self._arrived(outcome, cargo.leg)
        else:
            cargo.leg.journey.missed(outcome, cargo.leg)
        if not cargo.open:
            self._count(outcome, cargo, cargo.leg)
            cargo.leg.journey.under_way -= 1
            self._end(cargo.leg.journey)

    def _count(self, fate: AirFate, cargo: Cargo, leg: Leg) -> None:
        if fate.started_ns < 0:
            return
        if len(leg.way) == 1:
            self.counts.sent += 1
        else:
            self.counts.handed_on += 1
        cargo.attempts, cargo.frame_ns = fate.attempts, fate.ended_ns - fate.started_ns
        self.counts.packet_air_ns += cargo.attempts * cargo.frame_ns

    def _arrived(self, fate: AirFate, leg: Leg) -> None:
        """A copy has come to a node: it takes the first, and hands it on if the router says so."""
        node, journey = fate.receiver, leg.journey
        packet = journey.packet
        if node in journey.seen and (fate.packet.to is None or node == packet.to):
            self.counts.duplicates += 1
            return
        refused = self._router.refuses(node, packet)
        if refused is not None:
            journey.missed(replace(fate, loss=refused), leg)
            return
        journey.seen.add(node)
        found = journey.came(fate, leg)
        if found is not None:
            self._outcomes.append(found)
        if node != packet.to:
            self._go_on(journey, node, self._router.hand_on(node, packet, leg.way), fate, leg)

    def _end(self, journey: Journey) -> None:
        """Decide what is open of a packet if no copy of it is under way."""
        if not journey.under_way:
            self._outcomes += journey.ended(self._agenda.now_ns)

    def _replied(self, reply: Reply, cargo: Cargo) -> None:
        """A unicast is done with, perhaps tried again after it came: a sender learns of the first hop."""
        leg = cargo.leg
        self.counts.packet_air_ns += (reply.attempts - cargo.attempts) * cargo.frame_ns
        if leg is not None and len(leg.way) == 1 and leg.journey.packet.to is not None:
            self._outcomes.append(replace(reply, packet=leg.journey.packet))

    # Notices.

    def _tell(self, node: int) -> None:
        now_ns = self._agenda.now_ns
        notices, again_ns = self._router.notices(node, now_ns)
        self._send_notices(node, notices)
        self._agenda.at(again_ns, ACTS, node, self._tell, node)

    def _send_notices(self, node: int, notices: Sequence[Notice]) -> None:
        for notice in notices:
            at_ns = self._agenda.now_ns + notice.delay_ns
            self._agenda.at(at_ns, ACTS, node, self._notify, node, notice)

    def _notify(self, node: int, notice: Notice) -> None:
        cargo = Cargo(content=notice.content)
        number, now_ns = self._numbers[node], self._agenda.now_ns
        priority = self._router.notice_priority
        self._enter(HopPacket(node, number, None, notice.length_bytes, now_ns, priority, cargo=cargo))

    def _heard(self, packet: HopPacket, fate: AirFate) -> None:
        """What became of a notice at a node."""
        if not packet.cargo.open:
            if fate.started_ns < 0:
                self.counts.notices_lost += 1
            else:
                self.counts.notices += 1
                self.counts.notice_bytes += packet.length_bytes
                self.counts.notice_air_ns += fate.ended_ns - fate.started_ns
        if fate.loss is None:
            content, now_ns = packet.cargo.content, self._agenda.now_ns
            self._send_notices(fate.receiver, self._router.take(fate.receiver, packet.node, content, now_ns))
