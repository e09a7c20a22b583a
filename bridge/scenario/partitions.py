"""Partitions of a scenario: groups of nodes that do not hear each other for a while."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

from pydantic import Field

from bridge.scenario.nodes import Span, Word
from sitl_configs.settings import refused

Group = Annotated[tuple[Word, ...], Field(min_length=1)]
Members = Mapping[str, Sequence[str]]
"""Ids of nodes, by what a partition may name: a node's id, or a group of addressees."""


class PartitionSetting(Span):
    """From an instant on, until another one, nodes of different groups do not hear each other; those of none hear all.

    Attributes:
        groups: of each the ids of its nodes, or names of groups of addressees.
    """

    groups: Annotated[tuple[Group, ...], Field(min_length=2)]

    def nodes(self, members: Members) -> tuple[tuple[str, ...], ...]:
        """Ids of the nodes of each group, each once.

        Raises:
            KeyError: it names what is not there.
        """
        return tuple(
            tuple(dict.fromkeys(node for name in group for node in members[name])) for group in self.groups
        )

    def check(self, members: Members, index: int) -> None:
        """See that its groups are of nodes that exchange packets, each in one group.

        Raises:
            ValueError: they are not; ``index`` is the partition's.
        """
        found: dict[str, int] = {}
        for place, group in enumerate(self.groups):
            for k, name in enumerate(group):
                if name not in members:
                    text = f"no node {name} that exchanges packets, and no group; there are: {', '.join(members)}"
                    raise refused(text, "partitions", index, "groups", place, k)
                for node in members[name]:
                    if found.setdefault(node, place) != place:
                        text = f"node {node} is in group {found[node]}, too: it cannot be on two sides"
                        raise refused(text, "partitions", index, "groups", place, k)
