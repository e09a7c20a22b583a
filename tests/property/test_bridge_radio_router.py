"""The fate of a packet depends on seed, link, number and positions: not on order of arrival, nor on who else flies."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.keys import Keys
from bridge.radio_router import RadioRouter
from bridge.session import Stamp
from channel.medium import Medium
from channel.presets import load_radio
from channel.radio import Radio

RADIO = Radio(load_radio("moon2020"))
TICK_NS = 50_000_000
LEVEL = (1.0, 0.0, 0.0, 0.0)
PACKETS = 12


def fates(
    seed: int, positions: dict[str, float], order: list[tuple[str, int]]
) -> dict[tuple[str, str, int], str]:
    nodes = tuple(positions)
    core = RadioRouter(Keys("r"), Medium(RADIO, seed=seed, nodes=nodes), nodes)
    for tick in (0, PACKETS * TICK_NS):
        for node, north_m in positions.items():
            core.on_truth(node, tick, (north_m, 0.0, -40.0), LEVEL)
    for tx, seq in order:
        core.on_packet(tx, "team", b"x" * 40, None, Stamp(seq, seq * TICK_NS))
    core.finish()
    return {(row.tx, row.rx, row.seq): row.fate for row in core.settled}


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**63 - 1),
    north_m=st.lists(st.floats(300.0, 480.0), min_size=2, max_size=4),
    data=st.data(),
)
def test_fate_is_the_same_whatever_the_order_between_nodes_or_their_number(
    seed: int, north_m: list[float], data: st.DataObject
) -> None:
    positions = {"0": 0.0} | {str(i): value for i, value in enumerate(north_m, 1)}
    streams = {node: list(range(PACKETS)) for node in positions}
    straight = [(node, seq) for seq in range(PACKETS) for node in positions]
    shuffled: list[tuple[str, int]] = []
    while any(streams.values()):
        node = data.draw(st.sampled_from([n for n, rest in streams.items() if rest]))
        shuffled.append((node, streams[node].pop(0)))
    alone = {node: positions[node] for node in ("0", "1")}
    all_fates = fates(seed, positions, straight)
    assert fates(seed, positions, shuffled) == all_fates
    pair = fates(seed, alone, [(node, seq) for node, seq in shuffled if node in alone])
    assert pair == {key: fate for key, fate in all_fates.items() if set(key[:2]) == {"0", "1"}}


def test_another_seed_draws_other_fates() -> None:
    order = [(node, seq) for seq in range(PACKETS) for node in ("0", "1")]
    assert fates(1, {"0": 0.0, "1": 410.0}, order) != fates(2, {"0": 0.0, "1": 410.0}, order)
