"""A value as it was written: with the place of each part of it, through merging and changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any

Path_ = tuple[str | int, ...]
"""The keys and list indices that lead to a value."""


@dataclass(frozen=True, slots=True)
class WrittenPlace:
    """Where a value was written.

    Attributes:
        source: the file's name as it was given, or the option of the command line.
        line: in that file, from 1; None for an option.
        folder: what files that the value names are seen from.
    """

    source: str
    line: int | None
    folder: Path

    def __str__(self) -> str:
        return self.source if self.line is None else f"{self.source}:{self.line}"


@dataclass(frozen=True, slots=True)
class OfOne:
    """What is said of one node of a group.

    Attributes:
        node_id: its id.
        entry: what is laid over it; None: it is left out.
    """

    node_id: Written
    entry: Written | None


@dataclass(frozen=True, slots=True)
class Written:
    """A value with its place: a mapping, a list, or what YAML makes of a single word.

    Attributes:
        content: parts by key, a list of parts, or the value.
        place: of the key or list item that it stands at.
        end: where more keys could be added, if that is elsewhere.
        of_one: of a group of nodes: what files that extend its own say of single ones of it, in their order.
    """

    content: Any
    place: WrittenPlace
    end: WrittenPlace | None = None
    of_one: tuple[OfOne, ...] = ()

    @property
    def is_mapping(self) -> bool:
        """Whether it has keys."""
        return isinstance(self.content, dict)

    @property
    def is_list(self) -> bool:
        """Whether it has items."""
        return isinstance(self.content, list)

    def get(self, step: str | int) -> Written | None:
        """The part at a key or index, None if there is none."""
        if isinstance(self.content, dict):
            found = self.content.get(str(step))
            return found if isinstance(found, Written) else None
        if isinstance(self.content, list) and isinstance(step, int) and 0 <= step < len(self.content):
            item = self.content[step]
            return item if isinstance(item, Written) else None
        return None

    def at(self, path: Path_) -> Written:
        """The part that a path leads to, or the deepest on the way that there is."""
        here = self
        for step in path:
            found = here.get(step)
            if found is None:
                break
            here = found
        return here

    def dotted(self, path: Path_) -> str:
        """A path from the scenario itself as settings have it: nodes by id, other lists by index."""
        if path[:1] == ("nodes",) and len(path) > 1 and path[2:] != ("id",):
            own = self.at(path[:2]).get("id")
            if own is not None and isinstance(own.content, str | int):
                path = ("nodes", own.content, *path[2:])
        return ".".join(map(str, path)) or "the scenario"

    def items(self) -> list[Written]:
        """The items of a list; of anything else none."""
        return list(self.content) if isinstance(self.content, list) else []

    @property
    def keys(self) -> list[str]:
        """The keys of a mapping; of anything else none."""
        return list(self.content) if isinstance(self.content, dict) else []

    def having(self, step: str | int, part: Written) -> Written:
        """The same with another part at a key (which may be new) or index."""
        if isinstance(self.content, list):
            items = list(self.content)
            items[int(step)] = part
            return replace(self, content=items)
        return replace(self, content={**self.content, str(step): part})

    def without(self, *keys: str) -> Written:
        """The same mapping without some keys."""
        return replace(self, content={k: v for k, v in self.content.items() if k not in keys})

    def leaves(self, path: Path_ = ()) -> Iterator[tuple[Path_, Written]]:
        """Each single value with its path."""
        if isinstance(self.content, dict):
            for key, part in self.content.items():
                yield from part.leaves((*path, key))
        elif isinstance(self.content, list):
            for index, part in enumerate(self.content):
                yield from part.leaves((*path, index))
        else:
            yield path, self


def plain(written: Written) -> Any:
    """The value without its places: dicts, lists and what YAML has."""
    if isinstance(written.content, dict):
        return {key: plain(part) for key, part in written.content.items()}
    if isinstance(written.content, list):
        return [plain(part) for part in written.content]
    return written.content


def written_at(value: Any, place: WrittenPlace) -> Written:
    """A plain value, all of it written at one place; what numpy has is as Python has it, and a path is its text."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, PurePath):
        value = str(value)
    if isinstance(value, dict):
        return Written({str(key): written_at(part, place) for key, part in value.items()}, place)
    if isinstance(value, list | tuple | range):
        return Written([written_at(part, place) for part in value], place)
    return Written(value, place)
