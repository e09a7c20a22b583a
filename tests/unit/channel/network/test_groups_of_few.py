"""Packets to groups with no other member on a network, one, or some: a fate at each of them, and no more."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from channel.access.packets import PLAIN
from channel.access.settings.base import Surroundings
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import Packets
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Network
from channel.presets import radio_from_mapping
from tests.unit.channel.network.test_band import MS, RADIO, S

NODES = tuple(f"n{number}" for number in range(8))
GROUPS = {"solo": ("n1",), "two": ("n1", "n5"), "some": ("n0", "n1", "n4", "n7")}
MEDIA: dict[str, dict[str, Any]] = {
    "airtime": {"model": "airtime"},
    "csma": {"model": "csma", "standard": "11a"},
    "tdma": {"model": "tdma", "slot_s": 0.02},
    "sik": {"model": "sik"},
    "elrs": {"model": "elrs"},
    "delay": {"model": "delay", "least_s": 0.01, "median_s": 0.05, "most_s": 0.2, "rate_bps": 1e6},
}


@pytest.mark.slow
@pytest.mark.parametrize("model", MEDIA)
@pytest.mark.parametrize("group", GROUPS)
def test_a_packet_to_a_group_has_a_fate_at_each_other_member(model: str, group: str) -> None:
    config = radio_from_mapping(RADIO | {"medium": MEDIA[model]})
    medium = Medium(Radio(config), seed=7, nodes=NODES, groups=GROUPS)
    for number, node in enumerate(NODES):
        medium.place(node, (50.0 * number, 0.0, -100.0))
    entry = EntryInstants(NODES, EntrySettings(phase_s=0.0), 50 * MS, medium.draws.common)
    floor_dbm = medium.radios[0].noise_floor_dbm
    network = Network(
        medium,
        lambda world: config.medium.open(
            Surroundings.of(world, medium.index, medium.draws.seed, config, floor_dbm)
        ),
        entry,
    )
    to, found, done = medium.addressees.codes[group], Counter[int](), []
    for number in range(3):
        at_ns = number * 200 * MS
        network.send(Packets(*(np.array([one]) for one in (at_ns, 1, number, 40, to))), [PLAIN])
        lived = network.live(at_ns + 200 * MS)
        found.update(lived.receptions.rx.tolist())
        done += lived.done
    lived = network.live(3 * S // 2)
    found.update(lived.receptions.rx.tolist())
    done += lived.done
    others = {medium.index[node] for node in GROUPS[group]} - {1}
    assert found == dict.fromkeys(others, 3)
    assert sorted(done) == [(1, 0), (1, 1), (1, 2)]
