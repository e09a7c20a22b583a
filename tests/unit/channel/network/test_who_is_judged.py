"""What the distance bins and the judge get to see of a medium hangs on no draw, and not on what is sent over it."""

from __future__ import annotations

import numpy as np
import pytest

from channel.access.packets import PLAIN
from channel.access.settings.base import Surroundings
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import Packets
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Network
from channel.presets import load_radio

TICK_NS, TICKS = 50_000_000, 80
MARGIN = {"transmit_power_dbm": -11.4, "fading": {"model": "none"}, "shadowing": {"model": "none"}}


def seen(length_bytes: int) -> list[tuple[int, int, int]]:
    """Instant, sender and fate of the frames that are judged, of a pair where a third is lost; 0 B: nobody sends."""
    radio = Radio(load_radio("elrs-2.4-333full", MARGIN))
    config = radio.config
    nodes = ("0", "1")
    medium = Medium(radio, seed=3, nodes=nodes, ahead_ns=2 * TICK_NS)
    medium.place("0", (0.0, 0.0, -40.0))
    medium.place("1", (1_055.0, 0.0, -40.0))
    network = Network(
        medium,
        lambda world: config.medium.open(
            Surroundings.of(world, medium.index, medium.draws.seed, config, radio.noise_floor_dbm)
        ),
        EntryInstants(nodes, EntrySettings(0.0), TICK_NS, medium.draws),
    )
    found = []
    for tick in range(TICKS):
        if length_bytes and not tick % 8:
            packets = Packets(*(np.array([each]) for each in (tick * TICK_NS, 0, tick, length_bytes, 1)))
            network.send(packets, [PLAIN])
        for frame in network.live((tick + 1) * TICK_NS).first:
            found += [(int(frame.packets.sim_time_ns[0]), int(frame.tx[0]), int(frame.fate[0]))]
    return found


@pytest.mark.slow
def test_a_pair_of_elrs_is_judged_by_the_frame_of_each_slot_whatever_is_sent_again() -> None:
    """Fragments are sent until they come: judged by these, the link would seem worse than it is."""
    idle, used = seen(0), seen(60)
    assert used == idle
    slots = TICKS * TICK_NS // 3_003_000
    assert slots - 2 <= len(idle) <= slots + 1
    assert 0.2 < np.mean([fate != 0 for _, _, fate in idle]) < 0.5
