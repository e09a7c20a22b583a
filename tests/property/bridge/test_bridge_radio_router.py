"""The fate of a packet depends on seed, link, number and positions: not on order of arrival, nor on who else flies."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.radio.virtual_radio import Settled
from tests.unit.bridge.radio.core import TICK_NS, place, send, virtual_radio
from tests.unit.bridge.radio.core import fates as fates_of

TICKS = 10
Event = tuple[str, str, int]
"""What comes in: "truth" or "packet", of which node, at which tick."""


def events(nodes: list[str]) -> list[Event]:
    return [(kind, node, tick) for tick in range(TICKS) for kind in ("truth", "packet") for node in nodes]


def fates(
    seed: int, start_m: dict[str, float], order: list[Event]
) -> dict[tuple[str, str, int], tuple[str, float]]:
    """Fly nodes apart at 10 m per tick and number; all that comes in, in ``order``."""
    core = virtual_radio("moon2020", tuple(start_m), seed=seed)
    found: dict[tuple[str, str, int], tuple[str, float]] = {}

    def keep(settled: Settled) -> None:
        distances = settled.receptions.distance_m.round(6).tolist()
        for (tx, rx, seq, fate), distance_m in zip(fates_of(core, settled), distances, strict=True):
            found[tx, rx, seq] = (fate, distance_m)

    for kind, node, tick in order:
        if kind == "truth":
            place(core, tick * TICK_NS, **{f"n{node}": start_m[node] + tick * int(node)})
        else:
            send(core, node, tick, tick * TICK_NS, b"x" * 40)
            keep(core.settle())
    keep(core.finish())
    return found


@settings(max_examples=12)
@given(
    seed=st.integers(0, 2**63 - 1),
    north_m=st.lists(st.floats(300.0, 480.0), min_size=1, max_size=3),
    data=st.data(),
)
def test_fate_is_the_same_whatever_the_order_between_streams_or_the_number_of_nodes(
    seed: int, north_m: list[float], data: st.DataObject
) -> None:
    start_m = {"0": 0.0} | {str(i): value for i, value in enumerate(north_m, 1)}
    straight = events(list(start_m))
    streams = {
        (kind, node): [e for e in straight if e[:2] == (kind, node)]
        for kind in ("truth", "packet")
        for node in start_m
    }
    shuffled: list[Event] = []
    while any(streams.values()):
        stream = data.draw(st.sampled_from([key for key, rest in streams.items() if rest]))
        shuffled.append(streams[stream].pop(0))
    all_fates = fates(seed, start_m, straight)
    assert len(all_fates) == TICKS * len(start_m) * (len(start_m) - 1)
    assert fates(seed, start_m, shuffled) == all_fates
    pair = {node: start_m[node] for node in ("0", "1")}
    alone = fates(seed, pair, [event for event in shuffled if event[1] in pair])
    assert alone == {key: fate for key, fate in all_fates.items() if set(key[:2]) == {"0", "1"}}


def test_another_seed_draws_other_fates() -> None:
    start_m = {"0": 0.0, "1": 410.0}
    assert fates(1, start_m, events(["0", "1"])) != fates(2, start_m, events(["0", "1"]))
