"""Who packets are for."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from channel.checks import ChannelInputError
from channel.link.radio import Radio
from channel.medium.addressees import Addressees
from channel.medium.ledger import Ledger
from channel.medium.medium import Medium
from channel.medium.reception import EVERYBODY, Packets
from channel.presets import load_radio

NODES = ("a", "b", "c", "d")
GROUPS = {"odd": ("b", "d"), "nobody": (), "self": ("a",)}
EXPECTED = [
    ("a", EVERYBODY, "bcd"),
    ("a", 2, "c"),
    ("a", -2, "bd"),
    ("b", -2, "d"),  # not to itself
    ("c", -3, ""),
    ("a", -4, ""),
    ("d", EVERYBODY, "abc"),
    ("d", -4, "a"),
]
"""Sender, code, receivers."""


def packets(rows: list[tuple[str, int, str]]) -> Packets:
    tx = np.array([NODES.index(sender) for sender, _, _ in rows], dtype=np.intp)
    seq, zero = np.arange(len(rows)), np.zeros(len(rows), dtype=np.int64)
    return Packets(zero, tx, seq, zero + 10, np.array([to for _, to, _ in rows], dtype=np.intp))


@pytest.mark.parametrize("rows", [EXPECTED, EXPECTED[:1], EXPECTED[1:2], EXPECTED[4:5], []])
def test_codes_are_resolved_to_receivers(rows: list[tuple[str, int, str]]) -> None:
    addressees = Addressees(NODES, GROUPS)
    assert addressees.codes == {"a": 0, "b": 1, "c": 2, "d": 3, "odd": -2, "nobody": -3, "self": -4}
    sent = packets(rows)
    row, rx = addressees.links(sent)
    found = [(number, NODES[receiver]) for number, receiver in zip(row.tolist(), rx.tolist(), strict=True)]
    assert found == [(number, each) for number, (_, _, receivers) in enumerate(rows) for each in receivers]
    assert addressees.count(sent).tolist() == [len(receivers) for _, _, receivers in rows]
    for sender, to, receivers in rows:
        assert {NODES[n] for n in addressees.receivers(NODES.index(sender), to)} == set(receivers)


def test_members_are_those_of_groups_alone() -> None:
    addressees = Addressees(NODES, GROUPS)
    assert [addressees.members(to) for to in (0, EVERYBODY, -2, -3)] == [None, None, {1, 3}, frozenset()]
    assert addressees.code_of(0, {1, 3}) == -2
    assert addressees.code_of(1, {3}) == -2
    assert addressees.code_of(0, {1, 2, 3}) == EVERYBODY


def test_a_group_is_not_called_as_a_node_and_has_nodes_for_members() -> None:
    with pytest.raises(ChannelInputError, match="a name that no node has"):
        Addressees(NODES, {"b": ("a",)})
    with pytest.raises(ChannelInputError, match="one of a, b, c, d"):
        Addressees(NODES, {"odd": ("z",)})


def test_the_books_have_members_alone_and_what_they_get_is_what_they_get_of_a_packet_to_all() -> None:
    def came(to: str | None) -> tuple[dict[tuple[str, int], int], Ledger, int]:
        medium = Medium(Radio(load_radio("corrected")), seed=4, nodes=NODES, groups=GROUPS)
        for place, node in enumerate(NODES):
            medium.observe(node, 0, (350.0 * place, 0.0, -40.0))
        ledger = Ledger(NODES, addressees=medium.addressees)
        sent = medium.packets(tx="a", seq=range(200), length_bytes=40, to=to)
        ledger.send(sent)
        medium.send(sent)
        waiting = medium.in_flight
        r = medium.settle()
        ledger.settle(r)
        ledger.check(0)
        rows = zip(r.rx.tolist(), r.packets.seq[r.packet].tolist(), r.fate.tolist(), strict=True)
        return {(NODES[rx], seq): fate for rx, seq, fate in rows}, ledger, waiting

    to_all, _, all_waiting = came(None)
    to_group, ledger, waiting = came("odd")
    assert (all_waiting, waiting) == (600, 400)
    assert to_group == {key: fate for key, fate in to_all.items() if key[0] in "bd"}
    assert len(set(Counter(to_group.values()))) > 1
    assert {link: account.sent for link, account in ledger.links.items()} == {
        ("a", "b"): 200,
        ("a", "d"): 200,
    }
    assert came("nobody")[0] == {}


def test_an_unknown_addressee_is_told_with_those_there_are() -> None:
    medium = Medium(Radio(load_radio("perfect")), seed=1, nodes=NODES, groups=GROUPS)
    with pytest.raises(ChannelInputError, match="one of a, b, c, d, odd, nobody, self"):
        medium.packets(tx="a", seq=0, to="even")
    bad = packets([("a", -5, "")])
    with pytest.raises(ChannelInputError, match="from -4 to 3"):
        medium.send(bad)
