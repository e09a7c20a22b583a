"""The per-packet path against the closed probability: every preset and lasting law, ten geometries, still and moving.

Packets of one link are far from independent: shadowing and the line of sight last over tens of metres, fading over a
coherence time. Links are independent of each other, so that an interval counts a geometry's packets as so many as the
spread between its links says, and at least as one for each link; 99.9 %.
"""

import numpy as np
import pytest

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import FATES, Fate, Medium
from channel.numbers.intervals import binomial_interval

SEEDS = range(12)
LINKS = 12
"""Of each geometry and seed, in all directions from one transmitter."""
PACKETS = 12
STEP_NS = 500_000_000
SPEED_MPS = 20.0
HEIGHT_M = 40.0
PLACED = {"model": "gudmundson", "sigma_db": 4.0, "decorrelation_m": 37.0}
LASTING = {
    "line of sight": {"propagation": {"model": "uma-av", "outside": "clamp"}},
    "line of sight, sigma by height": {
        "propagation": {"model": "uma-av", "outside": "clamp"},
        "shadowing": {"model": "gudmundson", "sigma_db": None, "decorrelation_m": 37.0},
    },
    "line of sight by elevation": {
        "propagation": {"model": "al-hourani", "environment": "urban", "outside": "clamp"},
        "shadowing": {**PLACED, "sigma_without_sight_db": 8.0},
        "fading": {"model": "rician", "k_db": 3.0, "k_overhead_db": 12.0, "coherence": "doppler"},
    },
    "rayleigh": {"fading": {"model": "rayleigh", "coherence": "doppler"}},
    "rayleigh from the sphere": {
        "fading": {"model": "rayleigh", "coherence": "doppler", "scattering": "sphere"}
    },
    "nakagami": {"fading": {"model": "nakagami", "m": 0.6, "coherence": "doppler"}},
    "blocks": {"fading": {"model": "rician", "k_db": 0.0, "coherence": "block"}},
}


def radio_of(name):
    return Radio(
        presets.load_radio("corrected", LASTING[name]) if name in LASTING else presets.load_radio(name)
    )


def ten_distances(radio):
    """Distances from near to where hardly anything arrives."""
    grid = np.geomspace(1.0, 60_000.0, 400)
    p = radio.probability_of_delivery(
        ground_distance_m=grid, height_tx_m=HEIGHT_M, height_rx_m=HEIGHT_M, length_bytes=40
    )
    out = grid[p > 0.01 * p[0]][-1]
    return np.linspace(0.25, 1.05, 10) * out


def receivers_ned_m(distances):
    """Places about the transmitter, shape (geometries, links, 3)."""
    angle = 2.0 * np.pi * (np.arange(LINKS) + 0.37 * np.arange(10)[:, np.newaxis]) / LINKS
    places = np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=-1)
    return places * distances[:, np.newaxis, np.newaxis] - (0.0, 0.0, HEIGHT_M)


def delivered(radio, distances, speed_mps):
    """Share of each link's packets that arrived, shape (geometries, links of all seeds)."""
    places = receivers_ned_m(distances)
    shares = []
    for seed in SEEDS:
        names = [f"r{i}" for i in range(places[..., 0].size)]
        medium = Medium(radio, seed=seed, nodes=["tx", *names], max_truth_age_ns=10 * STEP_NS)
        nodes = np.concatenate(([[0.0, 0.0, -HEIGHT_M]], places.reshape(-1, 3)))
        steps = np.arange(PACKETS) * STEP_NS
        for time_ns in steps.tolist():
            move = np.array([speed_mps * time_ns * 1e-9, 0.0, 0.0])
            medium.observe(np.arange(len(nodes)), time_ns, nodes + move)
        medium.send(medium.packets(tx="tx", seq=np.arange(PACKETS), sim_time_ns=steps, length_bytes=40))
        fates = medium.settle().fate.reshape(PACKETS, len(names))
        arrived = (fates == FATES.index(Fate.DELIVERED)).sum(axis=0)
        shares.append(arrived.reshape(len(distances), LINKS) / PACKETS)
    return np.concatenate(shares, axis=1)


def packets_that_count(shares, p):
    """How many independent packets tell as much as these do about a probability."""
    links = shares.shape[1]
    variance = np.maximum(np.mean((shares - p[:, np.newaxis]) ** 2, axis=1), 1e-12)
    counted = np.clip(p * (1.0 - p) / variance, 1.0, PACKETS) * links
    seldom = links * np.minimum(p, 1.0 - p) < 10.0
    return np.floor(np.where(seldom, links, counted))


@pytest.mark.slow
@pytest.mark.parametrize("speed_mps", [0.0, SPEED_MPS], ids=["still", "moving"])
@pytest.mark.parametrize("name", [*presets.preset_names(), *LASTING])
def test_monte_carlo(name, speed_mps):
    radio = radio_of(name)
    distances = ten_distances(radio)
    shares = delivered(radio, distances, speed_mps)
    p = np.empty(10)
    for i, place in enumerate(receivers_ned_m(distances)[:, 0]):
        delivery = radio.delivery(
            position_tx_ned_m=(0.0, 0.0, -HEIGHT_M), position_rx_ned_m=place, length_bytes=40
        )
        assert delivery.error_bound < 1e-3
        p[i] = np.clip(delivery.probability, 0.0, 1.0)
    counted = packets_that_count(shares, p)
    low, high = binomial_interval(counted, p, 0.999)
    ratio = np.rint(shares.mean(axis=1) * counted) / counted
    step = 0.5 / counted
    assert np.all((low <= ratio + step) & (ratio - step <= high)), (distances, ratio, p, counted)


def test_an_interval_counts_dependent_packets_once():
    """Links that deliver all or nothing tell as much as one packet each, independent ones as much as all."""
    rng = np.random.Generator(np.random.PCG64(5))
    all_or_nothing = (rng.random((1, 400)) < 0.3).astype(float)
    independent = rng.binomial(PACKETS, 0.3, (1, 400)) / PACKETS
    p = np.array([0.3])
    assert packets_that_count(all_or_nothing, p) == pytest.approx(400, rel=0.1)
    assert packets_that_count(independent, p) == pytest.approx(400 * PACKETS, rel=0.15)
