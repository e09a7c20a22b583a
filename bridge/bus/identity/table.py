"""The table of rights: which role may do what with which key. Everything else is refused.

It has a row per kind of key, as the key space of the design has (docs/reference/identities.md). A key is given below
`lostlink/<run>/`. For a role that stands for nodes, ``{node}`` is each of its own nodes; for the others it is every
node. ``{self}`` is the identity's own name, ``{host}`` that of a host; for a role that has many to deal with (the
radio, observers, physics with its hosts) it is any.

The radio is in the table although nobody logs in as it: the router's own session is the radio, and Zenoh filters only
what comes from and goes to others.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Flag, auto


class AccessRole(Flag):
    """What an identity is for. Several together are a set."""

    PHYSICS = auto()
    RADIO = auto()
    HOST = auto()
    """A host process: aircraft bridges and agents of its nodes."""
    NODE = auto()
    """A program of somebody's own beside a node that has an agent: a script."""
    FREE = auto()
    """A program of somebody's own that is a node's agent: it runs free of the clock."""
    SUPERVISOR = auto()
    OPERATOR = auto()
    OBSERVER = auto()


NOBODY = AccessRole(0)
PHYSICS, RADIO, HOST, NODE, FREE = (
    AccessRole.PHYSICS,
    AccessRole.RADIO,
    AccessRole.HOST,
    AccessRole.NODE,
    AccessRole.FREE,
)
SUPERVISOR, OPERATOR, OBSERVER = AccessRole.SUPERVISOR, AccessRole.OPERATOR, AccessRole.OBSERVER
OWN = HOST | NODE | FREE
"""Who stands for nodes, and has to do with these only."""
LOOKERS = OBSERVER | OPERATOR | SUPERVISOR
"""Who may look at everything that may be looked at at all."""


@dataclass(frozen=True, slots=True)
class AccessRow:
    """Rights on one kind of key.

    Attributes:
        key: below `lostlink/<run>/`.
        writes: may put samples.
        reads: get the samples.
        serves: may answer queries (commands).
        asks: may send queries.
        holds: may hold a liveliness token.
        watches: see the tokens come and go.
    """

    key: str
    writes: AccessRole = NOBODY
    reads: AccessRole = NOBODY
    serves: AccessRole = NOBODY
    asks: AccessRole = NOBODY
    holds: AccessRole = NOBODY
    watches: AccessRole = NOBODY


TABLE = (
    AccessRow("node/{node}/state", writes=HOST, reads=OWN | LOOKERS),
    AccessRow("node/{node}/cmd/*", serves=HOST, asks=OWN | OPERATOR),
    AccessRow("node/{node}/mavlink/*", serves=HOST, asks=OWN | LOOKERS),
    AccessRow("node/{node}/tx/*/*/*", writes=HOST | FREE, reads=RADIO),
    AccessRow("node/{node}/enter/*/*/*", writes=NODE, reads=HOST),
    AccessRow("node/{node}/serial/*", writes=HOST, reads=RADIO),
    AccessRow("node/{node}/next_packet", serves=RADIO, asks=NODE | FREE),
    AccessRow("node/{node}/rx/**", writes=RADIO, reads=OWN | LOOKERS),
    AccessRow("node/{node}/comm_status", writes=RADIO, reads=OWN | LOOKERS),
    AccessRow("node/{node}/radio_status", writes=RADIO, reads=OWN | LOOKERS),
    AccessRow("node/{node}/measurements", writes=RADIO, reads=OWN | LOOKERS),
    AccessRow("node/{node}/agent", writes=HOST | FREE, reads=OWN | RADIO | LOOKERS),
    AccessRow("node/{node}/warning", writes=PHYSICS | HOST, reads=OWN | LOOKERS),
    AccessRow("node/{node}/log/*", writes=HOST | FREE, reads=OWN | LOOKERS),
    AccessRow("node/{node}/radio", writes=HOST, reads=RADIO | LOOKERS),
    AccessRow("node/{node}/answer", writes=HOST, reads=OWN | RADIO | LOOKERS),
    AccessRow("truth/*", writes=PHYSICS, reads=RADIO | LOOKERS),
    AccessRow("clock", writes=PHYSICS, reads=OWN | PHYSICS | RADIO | LOOKERS),
    AccessRow("clock/exchange", writes=PHYSICS, reads=OWN | RADIO | LOOKERS),
    AccessRow("clock/release", writes=RADIO, reads=OWN | PHYSICS | LOOKERS),
    AccessRow("clock/end", writes=RADIO, reads=OWN | PHYSICS | LOOKERS),
    AccessRow("clock/start", writes=SUPERVISOR, reads=OWN | PHYSICS | RADIO | LOOKERS),
    AccessRow("clock/pace", writes=PHYSICS, reads=NODE | LOOKERS),
    AccessRow("clock/cmd/*", serves=PHYSICS, asks=OPERATOR),
    AccessRow("tick/**", writes=RADIO | PHYSICS, reads=RADIO | LOOKERS),
    AccessRow("host/{host}/heard", writes=RADIO, reads=HOST),
    AccessRow("host/{host}/exchanged", writes=HOST, reads=PHYSICS),
    AccessRow("ending", writes=RADIO, reads=LOOKERS),
    AccessRow("alive/router", holds=RADIO, watches=NODE | FREE | LOOKERS),
    AccessRow("alive/{self}", holds=PHYSICS | HOST, watches=LOOKERS),
)
"""All rights. A row that is not here is a key that nobody but the radio may use."""

SCOPES = {
    PHYSICS: ("clock/**", "host/*/exchanged"),
    HOST: ("node/{node}/**", "clock/**", "host/{host}/**"),
    NODE: ("node/{node}/**", "clock/**"),
    FREE: ("node/{node}/**", "clock/**"),
}
"""What may be named in a subscription; what comes is what the role reads. Lookers may name anything."""
