"""One scenario laid over another: mappings key by key, nodes by id, anything else in place of what was there.

What is said of a single node of a group waits until the group is expanded, as what `--set` says does. Null takes a key
away that is below; where nothing is, it is a value like others.
"""

from __future__ import annotations

from dataclasses import replace

from bridge.scenario.document.written import OfOne, Path_, Written
from bridge.scenario.expand.group_ids import ids_of, is_of_all

NULL_IS_A_VALUE = frozenset({"earth_radius_factor"})
"""Keys of a radio that mean something by null (a flat Earth); at any other it is the same as no key at all."""
KINDS = {"type": None, "kind": "ua", "preset": None, "model": None}
"""Keys that say what a mapping is, and what it is without: one that says another takes nothing from what is below."""


def merged(base: Written, over: Written, path: Path_ = ()) -> Written:
    """``over`` laid over ``base``.

    Args:
        base: what is below.
        over: what wins.
        path: where in the scenario both are.
    """
    if path == ("nodes",) and base.is_list and over.is_list:
        return _nodes(base, over)
    if names_a_preset(path) and isinstance(base.content, str) and over.is_mapping:
        base = as_preset(base)
    if not (base.is_mapping and over.is_mapping):
        return over
    parts = {} if _is_another(base, over, path) else dict(base.content)
    for key, part in over.content.items():
        if removes(base, key, part):
            parts.pop(key, None)
        else:
            parts[key] = merged(parts[key], part, (*path, key)) if key in parts else part
    return replace(over, content=parts, of_one=base.of_one)


def removes(base: Written, key: str, part: Written) -> bool:
    """Whether a part laid over a mapping at a key takes away what is there: null does."""
    return part.content is None and base.get(key) is not None and key not in NULL_IS_A_VALUE


def names_a_preset(path: Path_) -> bool:
    """Whether a name may stand there for a mapping with that ``preset``."""
    if path in {("radio",), ("wind",)}:
        return True
    if len(path) == 2 and path[0] == "networks":
        return True
    return path[:1] == ("nodes",) and path[2:] in {("radio",), ("sensor", "radio")}


def as_preset(name: Written) -> Written:
    """The mapping that a radio's or wind's name stands for."""
    return Written({"preset": name}, name.place)


def same_id(node: Written, node_id: object) -> bool:
    """Whether a node has this id; 1 and "1" are one."""
    own = node.get("id")
    return own is not None and str(own.content) == str(node_id)


def kind_of(node: Written) -> str:
    """The kind of a node as written; one without is a UA."""
    kind = node.get("kind")
    return "ua" if kind is None else str(kind.content)


def _is_another(base: Written, over: Written, path: Path_) -> bool:
    if "options" in path:
        return False  # an agent's own keys mean what the agent takes them for
    keys = KINDS if base.get("type") else {**KINDS, "class": None}
    for key, default in keys.items():
        new, old = over.get(key), base.get(key)
        if (
            new is not None
            and new.content is not None
            and new.content != (default if old is None else old.content)
        ):
            return True
    return False


def _nodes(base: Written, over: Written) -> Written:
    """Nodes with the id of one below are laid over it, the others come after."""
    nodes = base.items()
    for node in over.items():
        node_id = node.get("id")
        place = None if node_id is None else _place(nodes, node, node_id)
        if node_id is None or place is None:
            nodes.append(node)
        elif is_of_one(nodes[place], node_id) and not is_of_all(node):
            of_one = (*nodes[place].of_one, OfOne(node_id, node))
            nodes[place] = replace(nodes[place], of_one=of_one)
        else:
            nodes[place] = merged(nodes[place], node, ("nodes", place))
    return replace(over, content=nodes)


def _place(nodes: list[Written], node: Written, node_id: Written) -> int | None:
    """Which of the nodes below is meant, or the group of it."""
    for place, below in enumerate(nodes):
        if is_of_one(below, node_id) and not is_of_all(node):
            if not is_left_out(below, node_id):
                return place
        elif same_id(below, node_id.content):
            return place
    return None


def is_of_one(group: Written, node_id: Written) -> bool:
    """Whether an id is that of a single node of a group."""
    return str(node_id.content) in ids_of(group)


def is_left_out(group: Written, node_id: Written) -> bool:
    """Whether a node of a group is left out of it."""
    return any(
        each.entry is None and str(each.node_id.content) == str(node_id.content) for each in group.of_one
    )
