"""From ``count: 20`` to twenty nodes: ids that count up, places in a pattern, values by index."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Set
from dataclasses import replace
from itertools import pairwise
from typing import Any, NoReturn

from pydantic import ValidationError

from bridge.scenario.document.merge import kind_of, merged, same_id
from bridge.scenario.document.settings import Setting
from bridge.scenario.document.written import OfOne, Path_, Written, plain
from bridge.scenario.expand.group_ids import COUNT, COUNT_MAX, PLACES, ids_of, is_count, is_whole
from bridge.scenario.expand.patterns import PATTERNS, Pattern, PlaceDraws, Spot
from bridge.scenario.expand.words import filled
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.mistakes.explain import explained
from sitl_configs.mistakes import shown
from sitl_configs.near import near_miss

EACH = "each"
AXES = ("north_m", "east_m", "height_m", "heading_deg")


def with_groups_expanded(root: Written) -> Written:
    """The scenario with each group as so many nodes.

    Raises:
        ScenarioError: a count, pattern or value by index is wrong, or a group has no node that something is said of.
    """
    nodes = root.get("nodes")
    if nodes is None:
        return root
    _refuse_patterns_of_one(root, nodes)
    if not any(node.get(COUNT) or node.of_one for node in nodes.items()):
        return root
    seed = root.get("seed")
    number = seed.content if seed is not None and isinstance(seed.content, int) else 1
    expanded: list[Written] = []
    for index, node in enumerate(nodes.items()):
        path = ("nodes", index)
        group = list(_Group(root, node, path, number).nodes()) if node.get(COUNT) else [node]
        for of_one in node.of_one:
            group = _changed(group, of_one, path)
        expanded += group
    return root.having("nodes", replace(nodes, content=expanded))


def _changed(group: list[Written], of_one: OfOne, path: Path_) -> list[Written]:
    """The nodes of a group with what is said of one of them."""
    node_id, entry = of_one.node_id, of_one.entry
    place = next((k for k, node in enumerate(group) if same_id(node, node_id.content)), None)
    if place is None:
        ids = ", ".join(str(node.content["id"].content) for node in group)
        raise ScenarioError(
            f"{node_id.place}: nodes.{node_id.content}: its group, whose count was changed, has no such node any more; "
            f"it has: {ids or 'none'}"
        )
    laid = [] if entry is None else [merged(group[place], entry, path)]
    return [*group[:place], *laid, *group[place + 1 :]]


def _refuse_patterns_of_one(root: Written, nodes: Written) -> None:
    for index, node in enumerate(nodes.items()):
        for key in PLACES.values():
            place = node.get(key)
            named = [name for name in PATTERNS if place is not None and place.get(name)]
            if named and place is not None and node.get(COUNT) is None:
                at, told = place.content[named[0]].place, root.dotted(("nodes", index, key, named[0]))
                raise ScenarioError(
                    f"{at}: {told}: a pattern needs {COUNT} beside {key}: how many nodes it places"
                )


def is_of_a_group(setting: Setting) -> bool:
    """Whether a setting is about a group, not one of its nodes: its count, or its pattern."""
    steps, value = setting.steps, setting.value
    if steps[0] != "nodes" or "agent" in steps:
        return False
    if steps[-1] in PLACES.values() and isinstance(value, Mapping):
        return any(value.get(pattern) is not None for pattern in PATTERNS)
    return steps[-1] == COUNT or any(
        key in PLACES.values() and below in PATTERNS for key, below in pairwise(steps)
    )


def ids_of_groups(root: Written) -> set[str]:
    """The ids that groups have, before they are expanded."""
    nodes = root.get("nodes")
    return {node_id for node in (nodes.items() if nodes else []) for node_id in ids_of(node)}


def refuse_same_ids(root: Written, of_groups: Set[str]) -> None:
    """See that no two nodes have one id.

    Raises:
        ScenarioError: they do; the place is that of the second.
    """
    apart = "; what one node of a group has of its own stands in a file that extends this one, or in --set"
    first: dict[str, Written] = {}
    for index, node in enumerate(nodes.items() if (nodes := root.get("nodes")) else []):
        node_id = node.get("id")
        if node_id is None:
            continue
        text = str(node_id.content)
        if text in first:
            raise ScenarioError(
                f"{node_id.place}: nodes.{index}.id: id {text} is used more than once, first at {first[text].place}: "
                f"each node needs its own{apart if text in of_groups else ''}"
            )
        first[text] = node_id


class _Group:
    """One group.

    Args:
        root: the scenario, for the places of mistakes.
        node: the group as written.
        path: where it is.
        seed: of the run.
    """

    def __init__(self, root: Written, node: Written, path: Path_, seed: int) -> None:
        self._root, self._node, self._path, self._seed = root, node, path, seed
        self._known: dict[str, list[Spot]] = {}

    def nodes(self) -> Iterator[Written]:
        """Its nodes."""
        count = self._count()
        self._refuse_wrong_id()
        place_key = PLACES.get(kind_of(self._node), "home")
        for index in range(count):
            names = {"i": index, "n": count}
            node = self._filled(self._node.without(COUNT), self._path, names)
            node = node.having("id", self._id(node, index))
            place = node.get(place_key)
            if place is not None and (spots := self._spots(place, place_key, count)) is not None:
                node = node.having(place_key, self._placed(place, spots[index]))
            yield node

    def _count(self) -> int:
        count = self._node.content[COUNT]
        value = count.content
        if not is_count(value):
            self._refuse(
                count,
                (COUNT,),
                f"has to be a number of nodes from 0 to {COUNT_MAX} (got {shown(plain(count))})",
            )
        return value

    def _refuse_wrong_id(self) -> None:
        node_id = self._node.get("id")
        if node_id is None:
            self._refuse(
                self._node, ("id",), "is required, and missing: that of the first node, the others count up"
            )
        elif not is_whole(node_id.content) and not (
            isinstance(node_id.content, str) and "{" in node_id.content
        ):
            text = (
                f"has to be a number, or a text with the index, as sensor-{{i}} (got {shown(plain(node_id))})"
            )
            self._refuse(node_id, ("id",), text)

    def _id(self, node: Written, index: int) -> Written:
        """That of a node of the group: a number counts up, a text has the index in it already."""
        first: Written = self._node.content["id"]
        return (
            replace(first, content=first.content + index) if is_whole(first.content) else node.content["id"]
        )

    def _filled(self, part: Written, path: Path_, names: Mapping[str, int]) -> Written:
        """A part of the group as it is in the node of an index."""
        if part.keys == [EACH]:
            part = self._one_of(part, path, names["i"])
        if part.is_mapping:
            parts = {key: self._filled(below, (*path, key), names) for key, below in part.content.items()}
            return replace(part, content=parts)
        if part.is_list:
            return replace(
                part, content=[self._filled(b, (*path, k), names) for k, b in enumerate(part.content)]
            )
        if not isinstance(part.content, str) or not {"{", "}"} & set(part.content):
            return part
        try:
            return replace(part, content=filled(part.content, names))
        except ValueError as error:
            raise ScenarioError(f"{part.place}: {self._root.dotted(path)}: {error}") from error

    def _one_of(self, part: Written, path: Path_, index: int) -> Written:
        written: Written = part.content[EACH]
        values = written.items()
        if not values:
            key = f"{self._root.dotted(path)}.{EACH}"
            raise ScenarioError(f"{written.place}: {key}: has to be a list of values, one for each node")
        return values[index % len(values)]

    def _spots(self, place: Written, place_key: str, count: int) -> list[Spot] | None:
        """The places of a pattern, if there is one; all of them, as each node has the pattern by its own index."""
        named = [key for key in PATTERNS if place.get(key)]
        if not named:
            self._refuse_near_misses(place, place_key)
            return None
        if len(named) > 1:
            self._refuse(place, (place_key,), f"{' and '.join(named)}: give one pattern")
        path = (*self._path, place_key, named[0])
        written = place.content[named[0]]
        key = named[0] + repr(plain(written))
        if key not in self._known:
            self._known[key] = self._spots_of(PATTERNS[named[0]], written, path, count)
        return self._known[key]

    def _spots_of(self, model: type[Pattern], written: Written, path: Path_, count: int) -> list[Spot]:
        try:
            pattern = model.model_validate(plain(written))
        except ValidationError as error:
            raise ScenarioError("\n".join(explained(self._root, error, model, path))) from None
        try:
            return pattern.spots(count, PlaceDraws(self._seed, str(self._node.content["id"].content)))
        except ValueError as error:
            raise ScenarioError(f"{written.place}: {self._root.dotted(path)}: {error}") from error

    def _refuse_near_misses(self, place: Written, place_key: str) -> None:
        for key in place.keys:
            if key not in AXES and (hint := near_miss(key, PATTERNS)):
                text = f"unknown key{hint} (patterns: {', '.join(PATTERNS)})"
                self._refuse(place.content[key], (place_key, key), text)

    def _placed(self, place: Written, spot: Spot) -> Written:
        """A place moved by that of the pattern; a heading of its own wins over the pattern's, and masts have none."""
        moved = {
            key: _number(place, key) + offset
            for key, offset in zip(("north_m", "east_m"), spot[:2], strict=True)
        }
        for key, value in moved.items():
            before = place.get(key)
            if before is None or _is_number(before.content):
                place = place.having(key, Written(value, place.place))
        if spot.heading_deg is not None and kind_of(self._node) == "ua" and place.get("heading_deg") is None:
            place = place.having("heading_deg", Written(spot.heading_deg, place.place))
        return place.without(*PATTERNS)

    def _refuse(self, at: Written, below: Path_, text: str) -> NoReturn:
        raise ScenarioError(f"{at.place}: {self._root.dotted((*self._path, *below))}: {text}")


def _number(place: Written, key: str) -> Any:
    value = place.get(key)
    return value.content if value is not None and _is_number(value.content) else 0.0


def _is_number(value: object) -> bool:
    """Whether a pattern can move it; a whole number beyond all floats is left for the model to refuse."""
    return isinstance(value, float) or (is_whole(value) and abs(value) <= sys.float_info.max)
