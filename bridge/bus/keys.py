"""The Zenoh key space of one run: `lostlink/<run>/...`.

A node is anything with an id on the air; a UA is a node whose id is its index as text. All that a node writes and
reads of its own lies under `node/<id>/`, so that one rule of access is enough for it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

ROOT = "lostlink"
MAIN = "main"
"""The radio network that all nodes are on, and their radios there."""
ALL = "all"
"""Addressee of a packet that is for every other node."""
IP = "ip"
"""Channel of the IP packets of programs that are attached to nodes (`lostlink attach`)."""
CHUNK_MAX = 255
"""Characters between two slashes: Zenoh has room for 64 KiB in a whole key, and breaks down at more."""
_CHUNK = re.compile(rf"[A-Za-z0-9][A-Za-z0-9_.-]{{0,{CHUNK_MAX - 1}}}")


class KeyMistake(ValueError):
    """What cannot be a key, or part of one."""


def is_chunk(value: str) -> bool:
    """Whether ``value`` can stand between two slashes of a key."""
    return _CHUNK.fullmatch(value) is not None


def checked_chunk(value: str) -> str:
    """Return ``value`` if it can stand between two slashes of a key, else raise KeyMistake."""
    if not is_chunk(value):
        raise KeyMistake(
            f"{value!r:.300} cannot be part of a key: use up to {CHUNK_MAX} letters, digits, '_', '-' and '.'"
        )
    return value


class Address(NamedTuple):
    """Who gave a packet to which of its radios, and for whom."""

    node: str
    radio: str
    to: str
    channel: str


@dataclass(frozen=True, slots=True)
class Keys:
    """Builds the keys of the run called ``run``; ``"*"`` is allowed wherever an id is, for subscribing."""

    run: str

    @property
    def prefix(self) -> str:
        """The part that all keys of the run share."""
        return f"{ROOT}/{self.run}"

    @property
    def clock(self) -> str:
        """Fleet time, one message per tick; written by the fleet clock."""
        return f"{self.prefix}/clock"

    @property
    def clock_start(self) -> str:
        """The supervisor's word that everybody is there: from now on autopilots are answered."""
        return f"{self.prefix}/clock/start"

    @property
    def clock_exchange(self) -> str:
        """An instant between two ticks at which MAVLink is exchanged; written by the fleet clock."""
        return f"{self.prefix}/clock/exchange"

    @property
    def clock_pace(self) -> str:
        """How fast the clock goes by wall time, and whether it is held; written by the fleet clock when it changes."""
        return f"{self.prefix}/clock/pace"

    @property
    def ending(self) -> str:
        """How far the radio is with the last part of its record."""
        return f"{self.prefix}/ending"

    @property
    def clock_release(self) -> str:
        """The tick that everybody has answered; written by the radio router, read by the fleet clock."""
        return f"{self.prefix}/clock/release"

    @property
    def clock_end(self) -> str:
        """The tick with which the run ends: all its packets are settled; written by the radio router."""
        return f"{self.prefix}/clock/end"

    def clock_command(self, verb: str) -> str:
        """Queryable that moves a clock: pause, resume, step, speed, status; of a record that is played seek, too."""
        return f"{self.prefix}/clock/cmd/{verb}"

    def truth(self, node: str) -> str:
        """True state of a node; written by the flight dynamics."""
        return f"{self.prefix}/truth/{node}"

    def state(self, node: str) -> str:
        """Table I, as the node's autopilot reports it."""
        return f"{self.prefix}/node/{node}/state"

    def command(self, node: str, verb: str) -> str:
        """Queryable that carries out ``verb``: one of ``bridge.record.inputs.fields.VERBS``."""
        return f"{self.prefix}/node/{node}/cmd/{verb}"

    def mavlink(self, node: str, name: str) -> str:
        """Queryable that gives the last MAVLink message of a type from the node's autopilot, as JSON."""
        return f"{self.prefix}/node/{node}/mavlink/{name}"

    def agent(self, node: str) -> str:
        """What the node's agent says of itself."""
        return f"{self.prefix}/node/{node}/agent"

    def warning(self, node: str) -> str:
        """What somebody must see of a node while the run goes on."""
        return f"{self.prefix}/node/{node}/warning"

    def logged(self, node: str, name: str) -> str:
        """A value that the node's agent logs, as JSON."""
        return f"{self.prefix}/node/{node}/log/{name}"

    def answer(self, node: str) -> str:
        """A regulated node's word that it is done with a tick: its agent, and its aircraft."""
        return f"{self.prefix}/node/{node}/answer"

    def radio(self, node: str) -> str:
        """The node's word to the radio router that an operator switched its radio."""
        return f"{self.prefix}/node/{node}/radio"

    def tx(self, node: str, channel: str, *, to: str = ALL, radio: str = MAIN) -> str:
        """What a node gives to one of its radios, for one node, a group or all; only the radio router reads it."""
        return f"{self.prefix}/node/{node}/tx/{radio}/{to}/{channel}"

    def enter(self, node: str, channel: str, *, to: str = ALL, radio: str = MAIN) -> str:
        """A packet that enters a node from outside, for one of its radios; its host reads it, and records it."""
        return f"{self.prefix}/node/{node}/enter/{radio}/{to}/{channel}"

    def serial(self, node: str, radio: str) -> str:
        """Bytes that the host of a node's modem has sent when the fleet was held; only the radio router reads them."""
        return f"{self.prefix}/node/{node}/serial/{radio}"

    def next_packet(self, node: str) -> str:
        """Queryable that gives a free node's program the number and the least sim time of its next packet."""
        return f"{self.prefix}/node/{node}/next_packet"

    def rx(self, node: str, sender: str, channel: str) -> str:
        """What the radio delivered to a node; only the radio router writes it."""
        return f"{self.prefix}/node/{node}/rx/{sender}/{channel}"

    def comm_status(self, node: str) -> str:
        """Which other nodes' latest packets reached this one."""
        return f"{self.prefix}/node/{node}/comm_status"

    def radio_status(self, node: str) -> str:
        """What a node's own radios report: what waits in their queues, and what became of its unicasts."""
        return f"{self.prefix}/node/{node}/radio_status"

    def measurements(self, node: str) -> str:
        """What a node's RF sensor reports."""
        return f"{self.prefix}/node/{node}/measurements"

    def heard(self, host: str) -> str:
        """What the radio has for the nodes of one host; made at the end of each tick."""
        return f"{self.prefix}/host/{host}/heard"

    def exchanged(self, host: str) -> str:
        """With lookahead, a host's word that the autopilots of its nodes may fly on from an instant."""
        return f"{self.prefix}/host/{host}/exchanged"

    def tick(self, record: str) -> str:
        """What became of a tick, one batch of columns per tick: truths, fates, links or communication."""
        return f"{self.prefix}/tick/{record}"

    def alive(self, process: str) -> str:
        """Liveliness token of a process of the run, declared once it is ready."""
        return f"{self.prefix}/alive/{process}"

    def last_chunk(self, key: str) -> str:
        """The part of a key of this run after its last slash."""
        return key.rsplit("/", 1)[1]

    def node_of(self, key: str) -> str:
        """The node of a key below ``node/``."""
        return key[len(self.prefix) + 1 :].split("/", 2)[1]

    def address_of(self, tx_key: str) -> Address:
        """Split a ``tx`` or an ``enter`` key.

        Raises:
            KeyMistake: it is none, or has wildcards.
        """
        _, node, kind, *rest = tx_key[len(self.prefix) + 1 :].split("/")
        if len(rest) != 3:
            raise KeyMistake(f"{tx_key} is not node/<id>/{kind}/<radio>/<to>/<channel>")
        radio, to, channel = (checked_chunk(chunk) for chunk in rest)
        return Address(node, radio, to, channel)
