"""Same seed and same positions: the same fate, whatever the order of arrival or the number of UA."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import Medium
from tests.unit.channel.medium.one_by_one import rows, settled

RADIO = Radio(presets.load_radio("moon2020", {"base_loss": 0.05}))
TICK_NS = 50_000_000
NODES = ["0", "1", "2", "gcs"]


def place(node, tick):
    """Some flight near 400 m, the same in every example."""
    angle = 0.3 * tick + 2.1 * NODES.index(node)
    return (230.0 * np.cos(angle), 230.0 * np.sin(angle), -40.0 - tick)


def fates(nodes, seed, ticks, packets, order):
    """Fly, with truths in time order per node and everything else in the given order."""
    medium = Medium(RADIO, seed=seed, nodes=nodes)
    truths = {node: iter(range(ticks)) for node in nodes}
    events = [("truth", node) for node in nodes for _ in range(ticks)] + [("packet", p) for p in packets]
    got = []
    for kind, what in (events[i] for i in order if i < len(events)):
        if kind == "truth":
            tick = next(truths[what])
            medium.observe(what, tick * TICK_NS, place(what, tick))
            got += settled(medium)
        else:
            tx, seq, time_ns = what
            medium.send(medium.packets(tx=tx, seq=seq, sim_time_ns=time_ns, length_bytes=40))
            got += settled(medium) if seq % 2 else []
    got += rows(medium, medium.flush())
    return {(r.tx, r.rx, r.seq): r for r in got}


packet_lists = st.lists(
    st.tuples(st.sampled_from(["0", "1"]), st.integers(0, 600), st.integers(0, 7 * TICK_NS)),
    unique_by=lambda packet: packet[:2],
    min_size=1,
    max_size=12,
)


@settings(deadline=None, max_examples=25)
@given(packets=packet_lists, seed=st.integers(-(2**70), 2**70), data=st.data())
def test_fate_does_not_depend_on_order_of_arrival_or_number_of_ua(packets, seed, data):
    ticks = 8
    events = 2 * ticks + len(packets)
    plain = fates(["0", "1"], seed, ticks, packets, range(events))
    shuffled = fates(["0", "1"], seed, ticks, packets, data.draw(st.permutations(range(events))))
    assert shuffled == plain
    crowd_events = len(NODES) * ticks + len(packets)
    crowd = fates(NODES, seed, ticks, packets, data.draw(st.permutations(range(crowd_events))))
    assert {key: value for key, value in crowd.items() if key in plain} == plain
    assert len(crowd) == 3 * len(plain)


def test_another_seed_differs_in_every_draw_and_in_some_fate():
    packets = [("0", seq, 3 * TICK_NS) for seq in range(400)]
    events = range(2 * 8 + len(packets))
    runs = [fates(["0", "1"], seed, 8, packets, events) for seed in (1, 2, 3)]
    for one, other in pairwise(runs):
        assert all(one[key].received_power_dbm != other[key].received_power_dbm for key in one)
        assert any(one[key].fate is not other[key].fate for key in one)
