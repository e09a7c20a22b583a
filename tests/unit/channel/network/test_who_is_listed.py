"""What a medium draws for a node, and who comes first at one instant, hang on ids.

Not on the order of the nodes, nor on who else is listed out of range.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from channel.access.packets import PLAIN
from channel.access.settings.base import Surroundings
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import FATES, Packets
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Network
from channel.presets import load_radio

TICK_NS, TICKS = 50_000_000, 12
NODES = ("a", "b", "c", "d")
PLACES = {
    "a": (0.0, 0.0, -40.0),
    "b": (200.0, 0.0, -40.0),
    "c": (0.0, 200.0, -40.0),
    "d": (200.0, 200.0, -40.0),
    "far": (3e7, 0.0, -40.0),
    "away": (3.1e7, 0.0, -40.0),
}
"""A square, so that what two send at one instant comes to the others at one instant, too; and two far away."""
LISTS = {
    "far ones last": (*NODES, "far", "away"),
    "far ones first": ("away", "far", *NODES),
    "far ones between": ("a", "far", "b", "c", "away", "d"),
    "turned": NODES[::-1],
}
PAIRS = [["a", "b"], ["c", "d"]]
SHARED = {"slots": [{"nodes": ["d", "a"], "duration_s": 0.02}, {"nodes": ["b", "c"], "duration_s": 0.02}]}
REACH = {"max_range_m": 60_000.0}
MEDIA = {
    "airtime": ("xbee-900hp", {}),
    "csma": ("wifi-2.4", {"fading": {"model": "rician", "k_db": 12.0}}),
    "delay": ("lte-uav", {"medium": {"bad_s": 0.1, "good_s": 0.2}}),
    "elrs": ("elrs-2.4-333full", {"medium": {"pairs": PAIRS}}),
    "sik": ("telemetry-915", {"medium": {"pairs": PAIRS}}),
    "sik, several of a NETID": ("telemetry-915", {"medium": {"units": {25: list(NODES)}, "lbt": True}}),
    "tdma": ("xbee-900hp", {"medium": {"model": "tdma", "slot_s": 0.01, "slots": list(NODES)}}),
    "tdma, shared": ("xbee-900hp", {"medium": {"model": "tdma", "schedule": SHARED}}),
}
Came = Mapping[tuple[str, int, str], tuple[str, int, int, float]]
"""Fate, instants of start and end, power, by sender, number and receiver."""


def came(nodes: Sequence[str], preset: str, changes: Mapping[str, object], senders: str) -> Came:
    """What came of three packets of each sender at each tick, to all: two send at one instant, more in phases."""
    radio = Radio(load_radio(preset, REACH | dict(changes)))
    config = radio.config
    medium = Medium(radio, seed=3, nodes=nodes, ahead_ns=2 * TICK_NS)
    for node in nodes:
        medium.place(node, PLACES[node])
    phases = EntrySettings(None, 0.001, 0.001) if len(senders) > 2 else EntrySettings(0.0, 0.0, 0.0)
    entry = EntryInstants(nodes, phases, TICK_NS, medium.draws)
    network = Network(
        medium,
        lambda world: config.medium.open(
            Surroundings.of(world, medium.index, medium.draws.seed, config, radio.noise_floor_dbm)
        ),
        entry,
    )
    found: dict[tuple[str, int, str], tuple[str, int, int, float]] = {}
    for tick in range(TICKS):
        tx = np.repeat(sorted(medium.index[node] for node in senders), 3)
        seq = np.tile(np.arange(3 * tick, 3 * tick + 3), len(senders))
        size = tx.size
        network.send(
            Packets(np.full(size, tick * TICK_NS), tx, seq, np.full(size, 80), np.full(size, -1)),
            [PLAIN] * size,
        )
        lived = network.live((tick + 1) * TICK_NS)
        r, instants = lived.receptions, lived.instants
        for row in range(r.size):
            key = nodes[r.tx[row]], int(r.packets.seq[r.packet[row]]), nodes[r.rx[row]]
            began_ns, ended_ns = int(instants.started_ns[row]), int(instants.ended_ns[row])
            power_dbm = float(np.nan_to_num(r.received_power_dbm[row]))
            found[key] = FATES[r.fate[row]].value, began_ns, ended_ns, power_dbm
    return found


@pytest.mark.parametrize("senders", [pytest.param("abcd", marks=pytest.mark.slow), "ad"])
@pytest.mark.parametrize(
    "medium",
    [
        pytest.param(each, marks=[pytest.mark.slow] if each in ("elrs", "tdma, shared", "airtime") else [])
        for each in MEDIA
    ],
)
def test_the_order_of_nodes_and_far_ones_change_nothing(medium: str, senders: str) -> None:
    preset, changes = MEDIA[medium]
    alone = came(NODES, preset, changes, senders)
    assert len(alone) >= TICKS * len(senders)
    for name, nodes in LISTS.items():
        other = came(nodes, preset, changes, senders)
        near = {key: value for key, value in other.items() if key[2] in NODES}
        differ = [key for key in alone.keys() | near.keys() if alone.get(key) != near.get(key)]
        assert not differ, f"{name}: {len(differ)} of {len(alone)}, {differ[:3]}"
