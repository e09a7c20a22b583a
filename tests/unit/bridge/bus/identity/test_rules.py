"""The table of rights has every key, and its rules grow with nodes, not with pairs."""

from __future__ import annotations

import re

import pytest

from bridge.bus.identity.roster import Identity, roster
from bridge.bus.identity.rules import access_control
from bridge.bus.identity.table import NOBODY, TABLE, Role, Row
from bridge.bus.keys import Keys

KEYS = Keys("r")
ALL_KEYS = {
    "clock": KEYS.clock,
    "clock_start": KEYS.clock_start,
    "clock_exchange": KEYS.clock_exchange,
    "clock_release": KEYS.clock_release,
    "clock_end": KEYS.clock_end,
    "ending": KEYS.ending,
    "truth": KEYS.truth("0"),
    "state": KEYS.state("0"),
    "command": KEYS.command("0", "arm"),
    "agent": KEYS.agent("0"),
    "answer": KEYS.answer("0"),
    "tx": KEYS.tx("0", "team"),
    "rx": KEYS.rx("0", "1", "team"),
    "comm_status": KEYS.comm_status("0"),
    "link": KEYS.link("0", "1"),
    "alive": KEYS.alive("host-0"),
}
NO_KEYS = {"prefix", "last_chunk", "node_of", "address_of", "run"}


def matches(row: Row, key: str) -> bool:
    template = row.key.format(node="*", self="*")
    pattern = re.escape(template).replace(r"\*\*", ".+").replace(r"\*", "[^/]+")
    return re.fullmatch(f"lostlink/r/{pattern}", key) is not None


def test_every_key_of_a_run_has_one_row() -> None:
    assert {name for name in vars(Keys) if not name.startswith("_")} - NO_KEYS == set(ALL_KEYS)
    for name, key in ALL_KEYS.items():
        assert len([row for row in TABLE if matches(row, key)]) == 1, name


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
        ("node:1", Role.NODE, ("1",)),
        ("node-1", Role.NODE, ("*",)),
        ("node-1", Role.NODE, ()),
        ("operator", Role.OPERATOR, ("1",)),
    ],
)
def test_identities_that_cannot_be(name: str, role: Role, nodes: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=r"cannot name an identity|with nodes"):
        Identity(name, role, nodes)


def test_two_identities_of_one_name_are_an_error() -> None:
    with pytest.raises(ValueError, match="two identities are called 'node-1'"):
        roster(["1"], {"node-1": ["1"]})
