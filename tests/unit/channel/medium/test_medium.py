import math

import numpy as np
import pytest

from channel import presets
from channel.checks import ChannelInputError
from channel.draws import Draws, Purpose
from channel.fading.shadowing import standard_normal_from_uniform
from channel.link.radio import Radio
from channel.medium.ledger import Ledger, LedgerError
from channel.medium.medium import EVERYBODY, Fate, Medium, Packets
from tests.unit.channel.medium.one_by_one import rows, settled, transmitted

MS = 1_000_000


def radio(name="moon2020", **overrides):
    return Radio(presets.load_radio(name, overrides))


def pair(model, distance_m, seed=1):
    medium = Medium(model, seed=seed, nodes=["0", "1"])
    medium.place("0", (0, 0, -40))
    medium.place("1", (distance_m, 0, -40))
    return medium


def test_power_snr_per_and_fate_follow_algorithm_one():
    paper = radio()
    (got,) = transmitted(pair(paper, 400.0, seed=9), "0", 17, 5 * MS, 200)
    draws = Draws(9)
    shadow_db = 6.0 * abs(float(standard_normal_from_uniform(draws.uniform(Purpose.SHADOWING, "0", "1", 17))))
    power_dbm = float(paper.link(400.0).received_power_dbm) - shadow_db
    snr_db = round(power_dbm + 340.0, 3)
    assert (got.received_power_dbm, got.snr_db) == (round(power_dbm, 3), snr_db)
    assert got.per == round(float(paper.per(snr_db, 40.0)), 7)
    assert (got.fate is Fate.DELIVERED) == (draws.uniform(Purpose.ERASURE, "0", "1", 17) > got.per)
    assert got[:5] == (5 * MS, "0", "1", 17, 40)
    assert got.distance_m == 400.0
    assert got.probability_of_delivery == pytest.approx(0.642, abs=0.002)


def test_packet_waits_for_truth_at_or_after_it_at_both_ends_and_interpolates():
    medium = Medium(radio(), seed=1, nodes=["0", "1"])
    medium.observe("0", 0, (0, 0, -40))
    medium.observe("1", 0, (100, 0, -40))
    assert transmitted(medium, "0", 0, 25 * MS, 40) == []
    assert medium.in_flight == 1
    medium.observe("0", 50 * MS, (0, 0, -40))
    assert settled(medium) == []
    medium.observe("1", 50 * MS, (110, 0, -40))
    (got,) = settled(medium)
    assert got.distance_m == pytest.approx(105.0)
    assert medium.in_flight == 0


def test_silent_node_is_used_where_it_was_last_seen():
    medium = Medium(radio(), seed=1, nodes=["0", "1"], max_truth_age_ns=100 * MS)
    medium.observe("0", 0, (0, 0, -40))
    medium.observe("1", 0, (100, 0, -40))
    assert transmitted(medium, "0", 0, 50 * MS, 40) == []
    medium.observe("0", 100 * MS, (0, 0, -40))
    assert settled(medium) == []
    medium.observe("0", 150 * MS, (0, 0, -40))
    (got,) = settled(medium)
    assert got.distance_m == 100.0


def test_node_that_was_never_seen_has_no_position():
    medium = Medium(radio(), seed=1, nodes=["0", "1", "2"])
    medium.observe("0", 0, (0, 0, -40))
    medium.observe("1", 0, (50, 0, -40))
    transmitted(medium, "0", 0, 50 * MS, 40)
    by_rx = {reception.rx: reception for reception in rows(medium, medium.flush())}
    assert by_rx["1"].fate is Fate.DELIVERED
    assert by_rx["2"].fate is Fate.NO_POSITION
    assert math.isnan(by_rx["2"].distance_m)
    assert by_rx["2"].probability_of_delivery == 0.0


def test_late_packet_uses_the_truth_of_its_own_time():
    medium = Medium(radio(), seed=1, nodes=["0", "1"])
    for k in range(40):
        medium.observe("0", k * 50 * MS, (0, 0, -40))
        medium.observe("1", k * 50 * MS, (10.0 * k, 0, -40))
    (got,) = transmitted(medium, "1", 0, 275 * MS, 40)
    assert got.distance_m == pytest.approx(55.0)


def test_out_of_range_and_base_loss_have_their_own_cause():
    assert transmitted(pair(radio("disk"), 401.0), "0", 0, 0, 40)[0].fate is Fate.OUT_OF_RANGE
    medium = pair(radio("perfect", base_loss=0.25), 10.0)
    fates = [each.fate for each in transmitted(medium, "0", range(2000), 0, 40)]
    assert len(fates) == 2000
    assert set(fates) == {Fate.DELIVERED, Fate.BASE_LOSS}
    assert abs(fates.count(Fate.BASE_LOSS) / 2000 - 0.25) < 3.3 * math.sqrt(0.25 * 0.75 / 2000)


@pytest.mark.parametrize("distance_m", [320.0, 360.0, 400.0, 430.0])
def test_monte_carlo_agrees_with_the_closed_probability(distance_m):
    paper = radio()
    medium = pair(paper, distance_m, seed=2)
    n = 2000
    delivered = sum(each.fate is Fate.DELIVERED for each in transmitted(medium, "0", range(n), 0, 40))
    p = float(paper.probability_of_delivery(distance_m))
    assert abs(delivered / n - p) < 3.29 * math.sqrt(p * (1 - p) / n) + 1 / n


def test_ledger_balances_and_bins_predict():
    medium = pair(radio(base_loss=0.1), 395.0, seed=3)
    ledger = Ledger(medium.nodes)
    for first in range(0, 1000, 250):
        packets = medium.packets(tx="0", seq=range(first, first + 250), length_bytes=40)
        ledger.send(packets)
        medium.send(packets)
        ledger.settle(medium.settle())
    ledger.check(medium.in_flight)
    account = ledger.links["0", "1"]
    assert (
        account.sent
        == account.delivered + account.lost["channel_erasure"] + account.lost["base_loss"]
        == 1000
    )
    (row,) = ledger.bins()
    assert (row.distance_min_m, row.distance_max_m, row.sent) == (380.0, 400.0, 1000)
    expected = 0.9 * float(radio().probability_of_delivery(395.0))
    assert row.predicted == pytest.approx(expected, abs=1e-4)
    assert row.within


def test_ledger_finds_what_does_not_balance():
    medium = pair(radio(), 100.0)
    ledger = Ledger(medium.nodes)
    packets = medium.packets(tx="0", seq=0, length_bytes=40)
    medium.send(packets)
    ledger.settle(medium.settle())
    with pytest.raises(LedgerError, match="0 -> 1"):
        ledger.check()
    ledger.send(packets)
    ledger.send(packets)
    ledger.check(1)
    with pytest.raises(LedgerError):
        ledger.check(0)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda m: m.packets(tx="9", seq=0), "tx"),
        (lambda m: m.packets(tx="0", seq=0, to="9"), "to"),
        (lambda m: m.observe(["0", "1"], 0, (0, 0, 0)), "position_ned_m"),
        (lambda m: transmitted(m, "0", -1, 0, 40), "seq"),
        (lambda m: transmitted(m, "0", 0, 0, -1), "length_bytes"),
        (lambda m: m.observe("0", 0, (math.nan, 0, 0)), "position_ned_m"),
        (lambda m: m.observe("0", 0, (0, 0)), "position_ned_m"),
        (lambda m: m.observe("0", 0, (0, 0, 0), attitude_wxyz=(0, 0, 0, 0)), "attitude_wxyz"),
        (lambda m: Medium(radio(), seed=1.5, nodes="ab"), "seed"),
        (lambda m: Medium(radio(), seed=1, nodes="aa"), "nodes"),
    ],
)
def test_mistakes_of_the_caller_are_named(call, name):
    with pytest.raises(ChannelInputError) as caught:
        call(Medium(radio(), seed=1, nodes=["0", "1"]))
    assert caught.value.name == name


@pytest.mark.parametrize("bad", [float("nan"), 1.5, "1", 2**70])
def test_numbers_that_are_not_whole_are_refused(bad):
    medium = Medium(Radio(presets.load_radio("moon2020")), seed=1, nodes=["a", "b"])
    with pytest.raises(ChannelInputError, match=r"sim_time_ns = .*allowed is an integer"):
        medium.observe("a", bad, (0.0, 0.0, -40.0))
    for name in ("seq", "sim_time_ns", "length_bytes"):
        packet = {"seq": 0, "sim_time_ns": 0, "length_bytes": 40}
        with pytest.raises(ChannelInputError, match=f"{name} = .*allowed is an integer"):
            medium.packets(tx="a", **(packet | {name: bad}))


def columns(**changes):
    """One packet from node 0 to everybody, as columns that a caller made."""
    good = {"sim_time_ns": 0, "tx": 0, "seq": 0, "length_bytes": 40, "to": EVERYBODY}
    return Packets(*(np.atleast_1d(each) for each in (good | changes).values()))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tx": 2}, "tx = 2"),
        ({"tx": -1}, "tx = -1"),
        ({"to": 2}, "to = 2"),
        ({"to": -2}, "to = -2"),
        ({"to": 0}, "to = '0'.*other than the transmitter"),
        ({"seq": -1}, "seq = -1"),
        ({"length_bytes": 1 << 25}, "length_bytes = "),
        ({"seq": 1.0}, "seq = .*integers"),
    ],
)
def test_columns_that_cannot_be_are_refused(changes, words):
    medium = Medium(radio(), seed=1, nodes=["0", "1"])
    with pytest.raises(ChannelInputError, match=words):
        medium.send(columns(**changes))
    assert medium.in_flight == 0


def test_a_packet_with_an_addressee_is_offered_to_it_alone_and_draws_what_it_would_draw_in_a_crowd():
    medium = Medium(radio(base_loss=0.2), seed=6, nodes=["0", "1", "2", "3"])
    for i, node in enumerate(medium.nodes):
        medium.place(node, (130.0 * i, 0.0, -40.0))
    medium.send(medium.packets(tx="3", seq=range(300), length_bytes=40))
    to_all = {(each.rx, each.seq): each for each in settled(medium)}
    assert len(to_all) == 900
    medium.send(medium.packets(tx="3", seq=range(300), length_bytes=40, to="1"))
    medium.send(medium.packets(tx="0", seq=7, length_bytes=40))
    assert medium.in_flight == 303
    got = settled(medium)
    assert [(each.tx, each.rx) for each in got[:3]] == [("0", "1"), ("0", "2"), ("0", "3")]
    assert [each.rx for each in got[3:]] == ["1"] * 300
    assert got[3:] == [to_all["1", seq] for seq in range(300)]


def test_many_nodes_at_once_are_observed_as_one_by_one():
    attitudes = np.array([[1.0, 0.0, 0.0, 0.0], [0.6, 0.8, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    places = np.array([[0.0, 0.0, -40.0], [310.0, 20.0, -45.0], [250.0, 9.0, -50.0]])
    got = []
    for at_once in (False, True):
        medium = Medium(Radio(presets.load_radio("wifi-2.4")), seed=1, nodes="abc")
        for tick in range(3):
            moved = places + tick * np.array([1.0, -2.0, 0.5])
            if at_once:
                which = "abc" if tick else np.arange(3)
                medium.observe(tuple(which) if tick else which, tick * 50 * MS, moved, attitudes)
                continue
            for node, place, attitude in zip("abc", moved, attitudes, strict=True):
                medium.observe(node, tick * 50 * MS, place, attitude)
        medium.send(
            medium.packets(tx=("a", "b", "c"), seq=4, sim_time_ns=(9 * MS, 60 * MS, 99 * MS), length_bytes=99)
        )
        got.append(settled(medium))
    assert got[0] == got[1]
    assert len(got[0]) == 6


def test_receptions_stand_by_packet_in_canonical_order_then_by_receiver():
    medium = Medium(radio(), seed=1, nodes=["b", "a", "c"])
    for i, node in enumerate(medium.nodes):
        medium.place(node, (10.0 * i, 0.0, -40.0))
    medium.send(medium.packets(tx=("c", "a", "b"), seq=(5, 2, 9), sim_time_ns=(2, 2, 3), length_bytes=1))
    medium.send(medium.packets(tx="c", seq=4, sim_time_ns=2, length_bytes=1))
    receptions = medium.settle()
    assert receptions.packets.tx.tolist() == [1, 2, 2, 0]
    assert receptions.packets.seq.tolist() == [2, 4, 5, 9]
    assert receptions.packet.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert receptions.rx.tolist() == [0, 2, 0, 1, 0, 1, 1, 2]
    assert receptions.tx.tolist() == [1, 1, 2, 2, 2, 2, 0, 0]
    assert medium.settle().size == 0
