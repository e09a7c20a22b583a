"""The per-packet path against the closed probability: every preset, ten distances, 99.9 % intervals."""

import numpy as np
import pytest

from channel import presets
from channel.intervals import binomial_interval
from channel.link.lengths import Lengths
from channel.link.radio import Radio
from channel.medium.medium import FATES, Fate, Medium

PACKETS = 800
STEP_NS = 10_000_000_000
"""Between packets: beyond any coherence or burst time, so that packets are independent."""


def ten_distances(radio):
    """Distances from near to where hardly anything arrives."""
    grid = np.geomspace(1.0, 60_000.0, 400)
    path = radio.path(ground_distance_m=grid)
    p = radio.expected_delivery(radio.mean_power_dbm(path), path, Lengths.same(radio.length_bytes(40)))
    p = np.where(grid <= radio.max_range_m, p, 0.0)
    out = grid[p > 0.01 * p[0]][-1]
    return np.linspace(0.25, 1.05, 10) * out


@pytest.mark.parametrize("name", presets.preset_names())
def test_monte_carlo(name):
    radio = Radio(presets.load_radio(name))
    distances = ten_distances(radio)
    receivers = [f"r{i}" for i in range(10)]
    medium = Medium(radio, seed=20, nodes=["tx", *receivers], max_truth_age_ns=10 * STEP_NS)
    offsets = np.random.Generator(np.random.PCG64(1)).uniform(-1e5, 1e5, (PACKETS, 2))
    delivered = np.zeros(10)
    for k, (north, east) in enumerate(offsets):
        medium.observe("tx", k * STEP_NS, (north, east, -40.0))
        for receiver, distance in zip(receivers, distances, strict=True):
            medium.observe(receiver, k * STEP_NS, (north, east + distance, -40.0))
        medium.send(medium.packets(tx="tx", seq=k, sim_time_ns=k * STEP_NS, length_bytes=40))
        delivered += medium.settle().fate == FATES.index(Fate.DELIVERED)
    east = np.stack((np.zeros(10), distances, np.full(10, -40.0)), axis=-1)
    delivery = radio.delivery(position_tx_ned_m=(0.0, 0.0, -40.0), position_rx_ned_m=east, length_bytes=40)
    assert np.all(delivery.error_bound < 1e-3)
    low, high = binomial_interval(PACKETS, np.clip(delivery.probability, 0.0, 1.0), 0.999)
    ratio = delivered / PACKETS
    assert np.all((low <= ratio) & (ratio <= high)), (distances, ratio, delivery.probability)
