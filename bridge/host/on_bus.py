"""What comes from outside for a hosted node, on the bus: commands, packets, and who asks for a MAVLink message."""

from __future__ import annotations

import asyncio
import json
import logging
from functools import partial

from bridge.bus.inbox import Inbox
from bridge.bus.messages import CommandEvent, CommandGoal, DecodeError, decode
from bridge.bus.replies import reply_event
from bridge.bus.session import JSON, Query, Sample, Session, answer, end_of_answers, refuse
from bridge.host.hosted_aircraft import HostedAircraft
from bridge.host.hosted_node import HostedNode
from bridge.host.node import ASKED_MAX, ENTERING_MAX, OnReply
from bridge.record.inputs.fields import VERBS, PacketWay
from bridge.run.directory import RunDirectory

log = logging.getLogger("host")


class AskedOnBus:
    """Takes queries for a node; those that find no room are dropped and counted.

    Args:
        session: of the host.
        run: the run.
        hosted: the node.
    """

    def __init__(self, session: Session, run: RunDirectory, hosted: HostedNode) -> None:
        self._keys, self._hosted = run.keys, hosted
        loop = asyncio.get_running_loop()
        commands: Inbox[Query] = Inbox(loop, self._asked, limit=ASKED_MAX)
        session.serve(self._keys.command(hosted.id, "*"), commands.push)
        hosted.asks_dropped = lambda: commands.dropped
        packets: Inbox[Sample] = Inbox(loop, self._entered, limit=ENTERING_MAX)
        session.subscribe(self._keys.enter(hosted.id, "*", to="*", radio="*"), packets.push)
        hosted.packets_lost = lambda: packets.dropped + packets.failed
        if isinstance(hosted, HostedAircraft):
            looks: Inbox[Query] = Inbox(loop, partial(self._look, hosted), limit=ASKED_MAX)
            session.serve(self._keys.mavlink(hosted.id, "*"), looks.push)

    def _asked(self, query: Query) -> None:
        """A command; one whose key has a wildcard would be everybody's, and is nobody's."""
        if "*" in str(query.key_expr):
            _refuse(query, f"{query.key_expr}: a command is for one node, without a wildcard")
            return
        verb = self._keys.last_chunk(str(query.key_expr))
        if verb not in VERBS:
            _refuse(query, f"command {verb!r} is none of {', '.join(VERBS)}")
            return
        reply: OnReply = partial(reply_event, query, self._keys.command(self._hosted.id, verb))
        try:
            goal = decode(query.payload.to_bytes(), CommandGoal) if query.payload else CommandGoal()
        except DecodeError as error:
            reply(CommandEvent(CommandEvent.RESULT, False, str(error), outcome="refused"))
            return
        self._hosted.node.operator_asked(verb, goal, reply)

    def _entered(self, sample: Sample) -> None:
        """A packet for one of the node's radios."""
        address = self._keys.address_of(str(sample.key_expr))
        way = PacketWay(address.radio, address.to, address.channel)
        self._hosted.packet_came(way, sample.payload.to_bytes())

    def _look(self, hosted: HostedAircraft, query: Query) -> None:
        """The last MAVLink message of a type: nothing is asked of the autopilot, so nothing is recorded."""
        name = str(query.key_expr).rsplit("/", 1)[1]
        try:
            found = hosted.last_message(name)
        except ValueError as error:
            _refuse(query, str(error))
            return
        key = self._keys.mavlink(hosted.id, name)
        if found is not None and not answer(query, key, json.dumps(found).encode(), JSON):
            log.warning("mavlink/%s: whoever asked is gone", name)
        end_of_answers(query)


def _refuse(query: Query, text: str) -> None:
    if not refuse(query, text.encode(), "text/plain"):
        log.warning("%s: whoever asked is gone", query.key_expr)
    end_of_answers(query)
