"""The identities of one run: who logs in to its router, in which role, for which nodes."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from bridge.bus.identity.table import OWN, AccessRole

PHYSICS = "physics"
SUPERVISOR = "supervisor"
OPERATOR = "operator"
OBSERVER = "observer"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True, slots=True)
class Identity:
    """A user of the router.

    Attributes:
        name: what it logs in as; for a process, the name of the process.
        role: one of them.
        nodes: ids of the nodes that it stands for.

    Raises:
        ValueError: the name cannot be part of a key, or a role that stands for nodes has none, or another has some.
    """

    name: str
    role: AccessRole
    nodes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for text in (self.name, *self.nodes):
            if not _NAME.fullmatch(text):
                raise ValueError(f"{text!r} cannot name an identity: use letters, digits, '_', '-' and '.'")
        if bool(self.nodes) != (self.role in OWN):
            raise ValueError(f"{self.name}: {self.role.name} with nodes {self.nodes}")


def node_identity(node: str) -> str:
    """The name that a program of somebody's own logs in with to act for ``node``."""
    return f"node-{node}"


def roster(
    nodes: Iterable[str], hosts: Mapping[str, Sequence[str]], free: Collection[str] = ()
) -> tuple[Identity, ...]:
    """All identities of a run.

    Args:
        nodes: ids of all nodes.
        hosts: which nodes each host process serves, by its name.
        free: nodes whose agent is a program beside the run; no other program transmits.

    Raises:
        ValueError: two identities would have one name.
    """
    identities = (
        Identity(PHYSICS, AccessRole.PHYSICS),
        *(Identity(name, AccessRole.HOST, tuple(served)) for name, served in hosts.items()),
        *(
            Identity(node_identity(node), AccessRole.FREE if node in free else AccessRole.NODE, (node,))
            for node in nodes
        ),
        Identity(SUPERVISOR, AccessRole.SUPERVISOR),
        Identity(OPERATOR, AccessRole.OPERATOR),
        Identity(OBSERVER, AccessRole.OBSERVER),
    )
    names = [identity.name for identity in identities]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"two identities are called {name!r}")
    return identities
