"""The table of rights has every key, and its rules grow with nodes, not with pairs."""

from __future__ import annotations

import inspect
import re

import pytest

from bridge.bus.identity.roster import Identity, roster
from bridge.bus.identity.rules import access_control
from bridge.bus.identity.table import NOBODY, TABLE, AccessRole, AccessRow
from bridge.bus.keys import Keys

KEYS = Keys("r")
NO_KEYS = {"prefix", "last_chunk", "node_of", "address_of", "run"}


def matches(row: AccessRow, key: str) -> bool:
    template = row.key.format(node="*", self="*", host="*")
    pattern = re.escape(template).replace(r"\*\*", ".+").replace(r"\*", "[^/]+")
    return re.fullmatch(f"lostlink/r/{pattern}", key) is not None


def example(name: str) -> str:
    """A key of this kind, with 0 for each id."""
    made = getattr(KEYS, name)
    if isinstance(made, str):
        return made
    needed = [p for p in inspect.signature(made).parameters.values() if p.default is p.empty]
    return str(made(*("0" for _ in needed)))


@pytest.mark.parametrize("name", [n for n in vars(Keys) if not n.startswith("_") and n not in NO_KEYS])
def test_every_kind_of_key_has_one_row(name: str) -> None:
    assert len([row for row in TABLE if matches(row, example(name))]) == 1


def test_every_row_says_who_fills_the_key_and_who_gets_it() -> None:
    for row in TABLE:
        filled, got = row.writes | row.serves | row.holds, row.reads | row.asks | row.watches
        assert filled != NOBODY != got, row.key


def fleet(nodes: int) -> tuple[Identity, ...]:
    ids = [str(i) for i in range(nodes)]
    return roster(ids, {"host-0": ids[::2], "host-1": ids[1::2]})


def test_rules_and_their_keys_grow_with_the_nodes_and_not_with_pairs() -> None:
    sizes = {}
    for nodes in (10, 20, 30):
        config = access_control("r", fleet(nodes))
        rules = config["rules"]
        assert len({rule["id"] for rule in rules}) == len(rules)
        sizes[nodes] = (len(rules), sum(len(rule["key_exprs"]) for rule in rules))
    for of_10, of_20, of_30 in zip(*sizes.values(), strict=True):
        assert of_30 - of_20 == of_20 - of_10 > 0


def test_rights_are_granted_one_by_one_and_everything_else_is_denied() -> None:
    config = access_control("r", fleet(2))
    assert config["enabled"] is True
    assert config["default_permission"] == "deny"
    assert {rule["permission"] for rule in config["rules"]} == {"allow"}
    assert all("delete" not in rule["messages"] for rule in config["rules"])
    for rule in config["rules"]:
        wide = [key for key in rule["key_exprs"] if not key.startswith("lostlink/")]
        assert not wide or rule["messages"] == ["declare_subscriber"], rule


@pytest.mark.parametrize(
    ("name", "role", "nodes"),
    [
        ("node:1", AccessRole.NODE, ("1",)),
        ("node-1", AccessRole.NODE, ("*",)),
        ("node-1", AccessRole.NODE, ()),
        ("operator", AccessRole.OPERATOR, ("1",)),
    ],
)
def test_identities_that_cannot_be(name: str, role: AccessRole, nodes: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=r"cannot name an identity|with nodes"):
        Identity(name, role, nodes)


def test_two_identities_of_one_name_are_an_error() -> None:
    with pytest.raises(ValueError, match="two identities are called 'node-1'"):
        roster(["1"], {"node-1": ["1"]})
