"""What comes on Zenoh for the radio: packets, what agents say of themselves, and whoever asks how to go on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from functools import partial

from bridge.bus.handling import HandlingError, handling_in
from bridge.bus.keys import KeyMistake, Keys
from bridge.bus.messages import AgentStatus, CommandEvent, DecodeError, decode
from bridge.bus.replies import reply_event
from bridge.bus.session import Query, Sample, Session, Stamp, encoding_said
from bridge.radio.radio import RecordedRadio
from bridge.radio.router.intake import Intake, Waiting
from bridge.radio.senders import Refused
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario

REPEATS = "this run repeats a record"
Answer = Callable[[str, Query], None]
"""Answers a query on a key."""


class NextPacket:
    """Answers ``node/<id>/next_packet``.

    Args:
        keys: of the run.
        radio: which takes the packets.
    """

    def __init__(self, keys: Keys, radio: RecordedRadio) -> None:
        self._keys, self._radio = keys, radio

    def serve(self, session: Session, scenario: Scenario, push: Callable[[Answer, Query], object]) -> None:
        """Have ``push`` called with each query, which is to be answered behind all packets that came before it."""
        for node in scenario.transceivers:
            answer = self._beside_an_agent if node.has_agent else self._as_free

            def on_query(query: Query, answer: Answer = answer) -> None:
                push(answer, query)

            session.serve(self._keys.next_packet(node.node), on_query)

    def _as_free(self, key: str, query: Query) -> None:
        """A free node's program asks how to go on; all that the one before it transmitted has been taken."""
        node = self._keys.node_of(key)
        if node in self._radio.repeated:
            _refuse(key, query, f"{REPEATS}: what is transmitted as node {node} is taken from there")
            return
        stamp = self._radio.core.next_packet(node)
        value = json.dumps({"seq": stamp.seq, "sim_time_ns": stamp.sim_time_ns})
        reply_event(query, key, CommandEvent(CommandEvent.RESULT, True, value=value))

    def _beside_an_agent(self, key: str, query: Query) -> None:
        node = self._keys.node_of(key)
        text = f"node {node} has an agent that is not free, which alone transmits and numbers its packets"
        _refuse(key, query, text)


def _refuse(key: str, query: Query, text: str) -> None:
    reply_event(query, key, CommandEvent(CommandEvent.RESULT, False, text, outcome="refused"))


class RadioOnBus:
    """Keeps what comes; whoever has it takes it from ``intake``, one at a time, and has it handled.

    Args:
        session: where it comes from.
        run: the run.
        radio: given packets.
        nodes: whose packets and words are listened to; ``*`` is everybody.
        on_agent: called with what an agent says of itself.
        wake: called, in any thread, when something has come.
    """

    def __init__(
        self,
        session: Session,
        run: RunDirectory,
        radio: RecordedRadio,
        nodes: Iterable[str],
        on_agent: Callable[[str, AgentStatus], object],
        wake: Callable[[], object] = lambda: None,
    ) -> None:
        self._keys, self._radio, self._on_agent = run.keys, radio, on_agent
        self.intake = Intake(wake)
        for node in nodes:
            packets, words = self._keys.tx(node, "*", to="*", radio="*"), self._keys.agent(node)
            session.subscribe(packets, partial(self.intake.push, self._packet_came, may_drop=True))
            session.subscribe(words, partial(self.intake.push, self._agent_came, may_drop=True))
        push = partial(self.intake.push, may_drop=False)
        NextPacket(self._keys, radio).serve(session, run.scenario, push)

    def handle(self, item: Waiting) -> None:
        """Have it handled; what is malformed is somebody else's, and refused. What else is raised is ours."""
        for key, seq in item.lost.items():
            self._radio.core.on_dropped(self._keys.node_of(key), seq)
        key = str(item.came.key_expr)
        try:
            item.handler(key, item.came)
        except (DecodeError, KeyMistake, HandlingError) as error:
            self._radio.core.refused[Refused.MALFORMED] += 1
            self._radio.tell_refusal(f"{key}: {error}")

    def _packet_came(self, key: str, sample: Sample) -> None:
        address, payload = self._keys.address_of(key), sample.payload.to_bytes()
        if address.node in self._radio.repeated:
            self._radio.core.refused[Refused.REPEATS] += 1
            self._radio.tell_refusal(f"{key}: {REPEATS}")
            return
        stamp, handling = Stamp.from_sample(sample), handling_in(sample)
        self._radio.packet(address, payload, encoding_said(sample), stamp, handling)

    def _agent_came(self, key: str, sample: Sample) -> None:
        node = self._keys.node_of(key)
        if node not in self._radio.repeated:
            self._on_agent(node, decode(sample.payload.to_bytes(), AgentStatus))
