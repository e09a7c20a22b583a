"""What a program that is to transmit as a node asks first: with which number and time to go on."""

from __future__ import annotations

import json
from collections.abc import Callable

from bridge.bus.keys import Keys
from bridge.bus.messages import CommandEvent
from bridge.bus.replies import reply_event
from bridge.bus.session import Query, Session
from bridge.radio.virtual_radio import VirtualRadio
from bridge.scenario.model import Scenario

Answer = Callable[[str, Query], None]
"""Answers a query on a key."""


class NextPacket:
    """Answers ``node/<id>/next_packet``.

    Args:
        keys: of the run.
        core: which takes the packets.
    """

    def __init__(self, keys: Keys, core: VirtualRadio) -> None:
        self._keys, self._core = keys, core

    def serve(self, session: Session, scenario: Scenario, push: Callable[[Answer, Query], object]) -> None:
        """Have ``push`` called with each query, which is to be answered behind all packets that came before it."""
        for node in scenario.transceivers:
            answer = self._beside_an_agent if node.has_agent else self._as_free

            def on_query(query: Query, answer: Answer = answer) -> None:
                push(answer, query)

            session.serve(self._keys.next_packet(node.node), on_query)

    def _as_free(self, key: str, query: Query) -> None:
        """A free node's program asks how to go on; all that the one before it transmitted has been taken."""
        stamp = self._core.next_packet(self._keys.node_of(key))
        value = json.dumps({"seq": stamp.seq, "sim_time_ns": stamp.sim_time_ns})
        reply_event(query, key, CommandEvent(CommandEvent.RESULT, True, value=value))

    def _beside_an_agent(self, key: str, query: Query) -> None:
        node = self._keys.node_of(key)
        text = f"node {node} has an agent that is not free, which alone transmits and numbers its packets"
        reply_event(query, key, CommandEvent(CommandEvent.RESULT, False, text, outcome="refused"))
