"""Ticks settled as arrays: the fates of the code that settled packet by packet, and what culling must not change."""

import math

import numpy as np
import pytest

from channel import presets
from channel.draws import Draws, LinkDraws
from channel.link.radio import Radio
from channel.link.tables.lengths import Lengths
from channel.link.tables.per_table import LINKS_BEFORE_TABLE
from channel.medium.medium import FATES, Fate, Medium, Packets
from channel.medium.settling import LINKS_AT_ONCE, Settling
from channel.medium.stations.tracks import Tracks, truth_rows
from tests.unit.channel.medium.one_by_one import settled

TICK_NS = 50_000_000
RAYLEIGH = {"model": "rayleigh", "coherence": "doppler"}
GUDMUNDSON = {"model": "gudmundson", "sigma_db": 6.0, "decorrelation_m": 25.0}
BURSTS = {"model": "gilbert-elliott", "mean_good_s": 0.2, "mean_bad_s": 0.1, "loss_bad": 0.9}
JAMMER = {"position_ned_m": [90, 9, 0], "power_dbm": 5, "duty": 0.5}
RADIOS = {
    "moon2020": ("moon2020", {}),
    "corrected": ("corrected", {}),
    "base loss": ("moon2020", {"base_loss": 0.2, "max_range_m": 360.0}),
    "lasting fading": ("corrected", {"fading": RAYLEIGH, "shadowing": GUDMUNDSON}),
    "bursts and a jammer": ("corrected", {"bursts": BURSTS, "interference": {"interferers": [JAMMER]}}),
}


def radio_of(name):
    preset, overrides = RADIOS[name]
    return Radio(presets.load_radio(preset, overrides))


def flight(radio, ticks=6, nodes=("0", "1", "2", "10")):
    """A few packets of each of some nodes, two of them not where the others are."""
    medium = Medium(radio, seed=7, nodes=nodes)
    got = []
    for tick in range(ticks):
        for i, node in enumerate(nodes):
            phase = (0.137 * i + 0.021 * tick * (1 + i)) % 1.0
            turn = 4.0 * abs(phase - 0.5) - 1.0
            scale_m = 130.0 + 170.0 * i
            where = (scale_m * turn, scale_m * (1.0 - turn * turn), -20.0 - 11.0 * i)
            medium.observe(node, tick * TICK_NS, where)
        when = [max(tick * TICK_NS - 7_000_001 * i, 0) for i in range(len(nodes))]
        lengths = [40 + 60 * ((tick + i) % 2) for i in range(len(nodes))]
        medium.send(medium.packets(tx=nodes, seq=tick, sim_time_ns=when, length_bytes=lengths))
        got += settled(medium)
    return got


FROZEN = {
    "moon2020": (
        "d ce ce d d ce ce d d ce ce d ce ce ce ce d ce d d ce d ce ce ce ce d ce d d d d ce d ce ce ce "
        "d d ce d d d ce d d ce ce ce d ce ce d ce d ce d d ce ce ce d ce ce d ce d d ce d ce ce",
        [14865.059, -14280.835, 679.165, 11.187046],
    ),
    "corrected": (
        "d d ce d ce d d d d ce ce ce ce d d d ce ce d d ce ce d d ce ce d d d d d d d d d d d d d d d "
        "ce d ce d d ce ce ce ce ce ce d ce d d ce d d ce d d ce ce d d d d d d ce ce",
        [26819.369, -5320.02, 757.734, 18.060235],
    ),
    "base loss": (
        "bl oor oor d d oor oor d oor oor oor oor oor oor oor oor d oor d d oor d oor oor oor oor d oor "
        "d bl d d oor d oor oor oor oor d oor oor bl d oor d d oor oor oor d oor oor oor oor d oor bl d "
        "oor oor oor oor oor oor d oor d d oor d oor oor",
        [7472.487, -8552.58, 627.42, 0.000393],
    ),
}
"""By radio: sums over all receptions of the last commit that settled packet by packet, and letters of its fates."""


def letters(got):
    return "".join("".join(word[0] for word in each.fate.value.split("_")) + " " for each in got).strip()


@pytest.mark.parametrize("name", FROZEN)
def test_fates_and_numbers_are_those_of_the_code_before(name):
    got = flight(radio_of(name))
    fates, sums = FROZEN[name]
    assert letters(got) == fates
    heard = [each for each in got if each.per < 1.0]
    columns = np.array([(e.distance_m, e.received_power_dbm, e.snr_db, e.per) for e in heard])
    assert [round(float(each), 6) for each in columns.sum(axis=0)] == sums


def placed(radio, places_m, *, cull, attitudes=None):
    """A settling of its own over nodes that stand, and its receptions of packets from each node."""
    count = len(places_m)
    tracks = Tracks(count, max_age_ns=TICK_NS)
    for node, row in enumerate(truth_rows(places_m, attitudes)):
        if node != 3:  # the one that is never seen
            tracks.place(node, row)
    settling = Settling(
        [radio] * count, LinkDraws(Draws(2), [str(i) for i in range(count)]), tracks, cull=cull
    )
    tx, seq = np.divmod(np.arange(40 * count), 40)
    length = 20 + 300 * (seq % 3)
    return settling.receptions(Packets(100_000_000 * seq, tx, seq, length, np.full_like(tx, -1)).in_order())


@pytest.mark.parametrize(
    ("name", "scale_m"),
    [
        ("moon2020", 900.0),
        ("base loss", 900.0),
        ("bursts and a jammer", 9e6),
        ("lasting fading", 1e9),
        ("wifi-2.4", 9e6),
        ("lte-like", 9e6),
        ("disk", 900.0),
    ],
)
def test_culling_changes_no_fate_and_no_number_of_what_may_arrive(name, scale_m):
    radio = radio_of(name) if name in RADIOS else Radio(presets.load_radio(name))
    rng = np.random.Generator(np.random.PCG64(8))
    places_m = rng.uniform(0.0, 1.0, (12, 3)) ** 2 * (scale_m, scale_m, -200.0)
    without, culled = (placed(radio, places_m, cull=cull) for cull in (False, True))
    assert np.array_equal(without.fate, culled.fate)
    assert np.array_equal(without.per, culled.per, equal_nan=True)
    assert np.array_equal(without.distance_m, culled.distance_m, equal_nan=True)
    assert np.array_equal(without.probability_of_delivery, culled.probability_of_delivery)
    drawn = ~np.isnan(culled.received_power_dbm)
    assert np.array_equal(without.received_power_dbm[drawn], culled.received_power_dbm[drawn])
    saved = ~drawn & ~np.isnan(without.received_power_dbm)
    assert 0.1 < saved.mean() < 0.95
    assert (culled.per[saved] == 1.0).all()
    assert set(culled.fate[saved]) <= {FATES.index(fate) for fate in Fate} - {FATES.index(Fate.DELIVERED)}


LARGEST = {
    "one-sided": {"shadowing": {"model": "one-sided-normal", "sigma_db": 6.0}},
    "normal": {"shadowing": {"model": "normal", "sigma_db": 6.0}},
    "rayleigh": {"fading": {"model": "rayleigh"}},
    "nakagami": {"fading": {"model": "nakagami", "m": 0.7}},
    "rician": {"fading": {"model": "rician", "k_db": -10.0, "k_overhead_db": 12.0}},
}


@pytest.mark.parametrize("name", LARGEST)
def test_no_draw_gives_more_than_the_largest_gain(name):
    """The laws at the ends of their draws, on a grid; the largest gain is reached within 0.01 dB."""
    config = presets.load_radio("corrected", {"shadowing": {"model": "none"}} | LARGEST[name])
    ends = np.array([2.0**-53, 1e-9, 0.1, 0.5, 0.9, 1.0 - 1e-9, 1.0 - 2.0**-53])
    if name in ("one-sided", "normal"):
        from scipy.stats import norm

        gain_db, law = -config.shadowing.loss_db(norm.ppf(ends)), config.shadowing
        gain_db = np.append(gain_db, config.shadowing.loss_db(norm.ppf(ends)) if name == "normal" else -0.0)
    else:
        law = config.fading
        elevation = np.linspace(0.0, 90.0, 500)[:, np.newaxis, np.newaxis]
        gain_db = law.gain_db(ends, ends[:, np.newaxis], elevation)
    assert law.max_gain_db - 0.01 <= np.max(gain_db) <= law.max_gain_db + 0.005


@pytest.mark.parametrize("name", ["moon2020", "corrected", "wifi-2.4", "disk", "gazebo-classic"])
def test_error_rates_from_the_table_are_those_of_the_model(name):
    radio = Radio(presets.load_radio(name, {"max_range_m": None}))
    snr_db = np.round(np.random.Generator(np.random.PCG64(4)).uniform(-40.0, 60.0, LINKS_BEFORE_TABLE), 3)
    lengths = Lengths.of(np.array([40, 1400, 40]), np.arange(snr_db.size) % 3)
    expected = np.round(radio.per(snr_db, lengths.bytes_each), 7)
    for _ in range(4):  # the first by the model, the last by tables
        assert np.array_equal(radio.per_in_steps(snr_db, lengths), expected)
    for beyond_db, rate in ((-500.0, 1.0), (500.0, 0.0)):
        if name not in ("gazebo-classic", "disk"):
            assert radio.per_in_steps(np.full(9, beyond_db), Lengths.same(1400)).tolist() == [rate] * 9


@pytest.mark.parametrize("name", ["moon2020", "wifi-2.4", "gz-rfcomms"])
def test_below_the_hopeless_snr_every_packet_is_lost(name):
    radio = Radio(presets.load_radio(name))
    lengths = Lengths((1, 40, 1400), np.arange(3))
    limit_db = radio.hopeless_below_db(lengths)
    assert np.isfinite(limit_db[1:]).all()
    for below_db in (0.0, 0.001, 3.0, 80.0, 2000.0):
        assert np.round(radio.per(limit_db - below_db, lengths.bytes_each), 7).tolist() == [1.0, 1.0, 1.0]
    assert (np.round(radio.per(limit_db + 15.0, lengths.bytes_each), 7) < 1.0).all()


def test_nothing_is_hopeless_where_the_rate_never_is_one():
    assert Radio(presets.load_radio("perfect")).hopeless_below_db(Lengths.same(40)) == -math.inf
    assert Radio(presets.load_radio("moon2020")).hopeless_below_db(Lengths.same(0)) == -math.inf


def test_a_large_tick_is_settled_in_pieces_as_its_packets_alone():
    """More links than one pass takes, of a fleet for which nothing is drawn ahead of need."""
    nodes = [str(i) for i in range(100)]
    radio = Radio(presets.load_radio("moon2020", {"base_loss": 0.1}))
    rng = np.random.Generator(np.random.PCG64(6))
    places_m = rng.uniform(0.0, 500.0, (100, 3)) * (1.0, 1.0, -0.1)
    media = [Medium(radio, seed=3, nodes=nodes) for _ in range(2)]
    for medium in media:
        for node, place in zip(nodes, places_m, strict=True):
            medium.place(node, place)
    packets = media[0].packets(
        tx=nodes, seq=rng.integers(0, 2**40, 100), length_bytes=rng.integers(0, 200, 100)
    )
    media[0].send(packets)
    together = settled(media[0])
    assert len(together) == 9900 > LINKS_AT_ONCE
    alone = []
    for row in range(100):
        media[1].send(packets.at(slice(row, row + 1)))
        alone += settled(media[1])
    assert alone == together
