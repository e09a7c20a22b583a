"""Radios that are off: what they send and what would have reached them is lost, and nothing else changes."""

import math

import numpy as np
import pytest

from channel import presets
from channel.checks import ChannelInputError
from channel.link.emitters.emitter import Emitter
from channel.link.radio import Radio
from channel.medium.judge.judge import Judge
from channel.medium.ledger import Ledger
from channel.medium.medium import Fate, Medium
from channel.medium.stations.switches import Switches
from tests.unit.channel.medium.one_by_one import rows

MS = 1_000_000
NODES = ("0", "1", "2", "gcs")
PACKETS = 40
LASTING = {
    "shadowing": {"model": "gudmundson", "sigma_db": 6.0, "decorrelation_m": 30.0, "shared_ends": 0.3},
    "fading": {"model": "rician", "k_db": 3.0, "coherence": "doppler"},
    "bursts": {
        "model": "gilbert-elliott",
        "mean_good_s": 0.3,
        "mean_bad_s": 0.2,
        "loss_good": 0.1,
        "loss_bad": 0.9,
    },
    "base_loss": 0.1,
}
OFF = [("1", 400 * MS, False), ("1", 1000 * MS, True), ("gcs", 0, False), ("gcs", 200 * MS, True)]


def medium_of(overrides=LASTING, preset="corrected", **more):
    emitter = Emitter(name="jammer", frequency_hz=2.412e9, power_dbm=10.0)
    model = Radio(presets.load_radio(preset, overrides), [emitter])
    return Medium(model, seed=3, nodes=NODES, emitters=["jammer"], **more)


def flown(medium, switchings=(), ticks=PACKETS):
    """Nodes on their ways for two seconds, a packet of each at each tick."""
    ledger = Ledger(NODES)
    for node, at_ns, on in switchings:
        medium.switch_radio(node, at_ns, on=on)
    found = []
    for tick in range(ticks):
        now_ns = 50 * MS * tick
        places = np.array([[70.0 * i + 3.0 * tick, 4.0 * i * tick, -40.0] for i in range(len(NODES))])
        medium.observe(NODES, now_ns, places)
        medium.emitters.observe(["jammer"], now_ns, [[500.0, 0.0, 0.0]])
        packets = medium.packets(tx=NODES, seq=tick, sim_time_ns=now_ns, length_bytes=60)
        ledger.send(packets)
        medium.send(packets)
        receptions = medium.settle()
        ledger.settle(receptions)
        found += rows(medium, receptions)
    ledger.check(medium.in_flight)
    return found, ledger


def is_off(got):
    """The oracle: whether an end of a link is within one of the two outages."""
    ends = {got.tx, got.rx}
    return ("1" in ends and 400 * MS <= got.sim_time_ns < 1000 * MS) or (
        "gcs" in ends and got.sim_time_ns < 200 * MS
    )


def test_what_a_radio_that_is_off_sends_or_would_receive_is_lost_to_that_cause_alone():
    found, ledger = flown(medium_of(), OFF)
    lost = {(got.tx, got.rx, got.seq) for got in found if got.fate is Fate.RADIO_OFF}
    assert lost == {(got.tx, got.rx, got.seq) for got in found if is_off(got)}
    assert len(lost) == 12 * 6 + 4 * 6  # ticks of an outage, times links with that end
    for got in found:
        if got.fate is Fate.RADIO_OFF:
            assert all(math.isnan(value) for value in got[5:9])
            assert got.probability_of_delivery == 0.0
    links = ledger.links
    assert sum(account.lost["radio_off"] for account in links.values()) == len(lost)
    assert all(account.in_flight == 0 and account.sent == PACKETS for account in links.values())
    binned = sum(row.sent for row in ledger.bins())
    assert binned == len(found) - len(lost)


def test_what_other_links_get_and_what_comes_later_does_not_depend_on_it():
    with_outages, _ = flown(medium_of(), OFF)
    without, _ = flown(medium_of())
    rest = [(got, other) for got, other in zip(with_outages, without, strict=True) if not is_off(got)]
    assert len(rest) > 300
    assert len({got.fate for got, _ in rest}) > 2
    for got, other in rest:
        assert got == other


def test_pieces_of_many_links_come_out_as_all_in_one(monkeypatch):
    whole, _ = flown(medium_of(), OFF)
    monkeypatch.setattr("channel.medium.settling.LINKS_AT_ONCE", 3)
    assert flown(medium_of(), OFF)[0] == whole


def test_a_late_packet_and_a_late_word_are_settled_by_what_held_when_the_packet_was_sent():
    medium = medium_of({}, "perfect")
    flown(medium, ticks=40)
    medium.switch_radio("1", 300 * MS, on=False)
    medium.switch_radio("1", 100 * MS, on=False)
    medium.switch_radio("1", 200 * MS, on=True)
    medium.send(medium.packets(tx="0", to="1", seq=range(900, 904), sim_time_ns=150 * MS))
    medium.send(medium.packets(tx="0", to="1", seq=950, sim_time_ns=200 * MS))
    medium.send(medium.packets(tx="1", to="0", seq=970, sim_time_ns=300 * MS))
    medium.send(medium.packets(tx="1", to="0", seq=960, sim_time_ns=300 * MS - 1))
    fates = {got.seq: got.fate for got in rows(medium, medium.settle())}
    off = {seq for seq, fate in fates.items() if fate is Fate.RADIO_OFF}
    assert off == {900, 901, 902, 903, 970}
    assert {fates[950], fates[960]} == {Fate.DELIVERED}


def test_nothing_is_drawn_or_judged_for_it():
    judge = Judge(len(NODES))
    outages = [(node, 0, False) for node in NODES]
    found, _ = flown(medium_of(judge=judge), outages)
    assert {got.fate for got in found} == {Fate.RADIO_OFF}
    assert not judge.verdict().judged


def test_places_of_a_node_whose_radio_is_off_are_known_to_sensors():
    medium = medium_of()
    flown(medium, [("1", 0, False)], ticks=2)
    assert medium.radios_off(50 * MS).tolist() == [False, True, False, False]
    assert medium.at(50 * MS).position_ned_m[0, 1] == 73.0
    assert medium.emitters.snapshot(np.array([50 * MS])).position_ned_m[0, 0] == 500.0


def test_of_two_words_at_one_instant_the_later_stands():
    switches = Switches(2)
    assert not switches.are_used
    switches.switch(1, 5, on=False)
    switches.switch(1, 5, on=True)
    switches.switch(1, 9, on=False)
    assert [switches.off_at(t)[1] for t in (4, 5, 8, 9, 10**18)] == [False, False, False, True, True]
    assert not switches.off_at(9)[0]


@pytest.mark.parametrize(("node", "at_ns", "words"), [("9", 0, "node"), ("0", 0.5, "sim_time_ns")])
def test_a_switch_that_cannot_be_is_refused(node, at_ns, words):
    with pytest.raises(ChannelInputError, match=words):
        medium_of().switch_radio(node, at_ns, on=False)


def test_one_radio_is_off_when_it_is_among_all():
    rng = np.random.default_rng(5)
    medium = medium_of()
    for _ in range(60):
        node, at_ns, on = rng.choice(NODES[:3]), int(rng.integers(0, 30)), bool(rng.integers(0, 2))
        medium.switch_radio(node, at_ns, on=on)
    every = range(len(NODES))
    asked = [(at_ns, medium.radios_off(at_ns).tolist()) for at_ns in (*range(-1, 31), 10**18)]
    assert {off for _, row in asked for off in row} == {False, True}
    for at_ns, row in asked:
        assert [medium.radio_off(node, at_ns) for node in every] == row
