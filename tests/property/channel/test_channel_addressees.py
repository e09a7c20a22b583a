"""Packets for nodes, groups and all together: each comes to whom its word says, and to nobody else."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from channel.medium.addressees import Addressees
from channel.medium.ledger import Ledger
from channel.medium.reception import EVERYBODY, Packets

NODES = tuple("abcde")
node_sets = st.frozensets(st.sampled_from(NODES))


@given(data=st.data(), groups=st.dictionaries(st.sampled_from(["one", "two", "three"]), node_sets))
def test_receivers_are_those_of_the_word(data, groups):
    words = st.sampled_from([*NODES, *groups, None])
    sent = data.draw(st.lists(st.tuples(st.sampled_from(NODES), words), max_size=12))
    sent = [(tx, to) for tx, to in sent if tx != to]
    wanted = [
        (row, rx)
        for row, (tx, to) in enumerate(sent)
        for rx in (NODES if to is None else sorted(groups[to]) if to in groups else (to,))
        if rx != tx
    ]
    addressees = Addressees(NODES, groups)
    codes = [EVERYBODY if to is None else addressees.codes[to] for _, to in sent]
    zero = np.zeros(len(sent), dtype=np.int64)
    tx = np.array([NODES.index(tx) for tx, _ in sent], dtype=np.intp)
    packets = Packets(zero, tx, np.arange(len(sent)), zero, np.array(codes, dtype=np.intp))
    row, rx = addressees.links(packets)
    assert [(n, NODES[r]) for n, r in zip(row.tolist(), rx.tolist(), strict=True)] == wanted
    ledger = Ledger(NODES, addressees=addressees)
    ledger.send(packets)
    booked = {link: account.sent for link, account in ledger.links.items()}
    links = [(sent[n][0], receiver) for n, receiver in wanted]
    assert booked == {link: links.count(link) for link in links}
