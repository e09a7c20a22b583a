"""A link has the same bits alone and in a crowd, for every preset and every kind of model."""

import math
import warnings

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.validity import ValidityWarning
from tests.unit.channel.medium.one_by_one import rows

TICK_NS = 50_000_000
CROWD = [str(i) for i in range(30)]
FEW = 5
HILLS = [[0.0, 90.0, 0.0], [30.0, 0.0, 60.0], [0.0, 10.0, 0.0]]
VARIANTS = {
    "two-ray": {"propagation": {"model": "two-ray"}},
    "free-space": {"propagation": {"model": "free-space"}},
    "okumura-hata": {
        "propagation": {"model": "okumura-hata", "city": "large", "environment": "open", "outside": "warn"}
    },
    "cost231-hata": {"propagation": {"model": "cost231-hata", "outside": "warn"}},
    "al-hourani": {"propagation": {"model": "al-hourani", "outside": "warn"}},
    "uma-av": {"propagation": {"model": "uma-av", "outside": "clamp"}},
    "rma-av": {"propagation": {"model": "rma-av", "outside": "clamp"}},
    "terrain": {
        "propagation": {"model": "terrain", "outside": "border", "spacing_m": 150.0, "heights_m": HILLS}
    },
    "rayleigh": {"fading": {"model": "rayleigh"}},
    "nakagami": {"fading": {"model": "nakagami", "m": 2.5}},
    "rician": {"fading": {"model": "rician", "k_db": 3.0, "k_overhead_db": 15.0}},
    "qam": {"error": {"model": "uncoded-awgn", "modulation": "64qam"}},
    "ofdm-nist": {"error": {"model": "ofdm-nist", "rate_mbps": 12}},
    "ofdm-yans": {"error": {"model": "ofdm-yans", "rate_mbps": 54}},
    "interferer": {"interference": {"interferers": [{"position_ned_m": [0, 0, 0], "power_dbm": 10}]}},
    "losses": {"base_loss": 0.2, "max_range_m": 300.0},
}


def radio_of(name):
    if name in VARIANTS:
        return Radio(presets.load_radio("corrected", VARIANTS[name]))
    return Radio(presets.load_radio(name))


def place(node, tick, spread_m):
    angle = 0.7 * int(node) + 0.05 * tick
    return (
        spread_m * math.cos(angle) * (1.0 + 0.1 * int(node)),
        spread_m * math.sin(angle),
        -20.0 - 9.0 * int(node),
    )


def flight(radio, nodes, seed, spread_m, packets):
    medium = Medium(radio, seed=seed, nodes=nodes)
    for tick in range(3):
        for node in nodes:
            attitude = (math.cos(0.1 * tick), 0.0, math.sin(0.1 * tick), 0.0)
            medium.observe(node, tick * TICK_NS, place(node, tick, spread_m), attitude)
    seqs, times_ns = zip(*packets, strict=True)
    medium.send(medium.packets(tx="0", seq=seqs, sim_time_ns=times_ns, length_bytes=100))
    return {(r.tx, r.rx, r.seq): r for r in rows(medium, medium.settle())}


@pytest.mark.parametrize("name", [*presets.preset_names(), *VARIANTS])
def test_every_radio_has_the_same_bits_for_few_and_for_many_receivers(name):
    radio = radio_of(name)
    scale_m = {"gazebo-classic": 5.0, "gz-rfcomms": 20.0}.get(name, 220.0)
    packets = [(seq, 1_000_003 * seq) for seq in range(90)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ValidityWarning)
        crowd = flight(radio, CROWD, 3, scale_m, packets)
        for few in (2, FEW):
            alone = flight(radio, CROWD[:few], 3, scale_m, packets)
            assert len(alone) == 90 * (few - 1)
            assert alone == {key: crowd[key] for key in alone}


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**64),
    spread_m=st.floats(0.01, 2000.0),
    times=st.lists(st.integers(0, 2 * TICK_NS), min_size=1, max_size=20),
)
def test_bits_do_not_depend_on_geometry_seed_or_time(seed, spread_m, times):
    packets = [(1000 * k, time_ns) for k, time_ns in enumerate(times)]
    crowd = flight(PAPER, CROWD, seed, spread_m, packets)
    alone = flight(PAPER, CROWD[:2], seed, spread_m, packets)
    assert alone == {key: crowd[key] for key in alone}


PAPER = Radio(presets.load_radio("moon2020", {"base_loss": 0.1}))
