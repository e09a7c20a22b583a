import math

import pytest

from channel import presets
from channel.checks import ChannelInputError
from channel.draws import Draws, Purpose
from channel.fading.shadowing import standard_normal_from_uniform
from channel.link.radio import Radio
from channel.medium.ledger import Ledger, LedgerError
from channel.medium.medium import Fate, Medium

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
    (got,) = pair(paper, 400.0, seed=9).transmit("0", 17, 5 * MS, 200)
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
    assert medium.transmit("0", 0, 25 * MS, 40) == []
    assert medium.in_flight == 1
    assert medium.observe("0", 50 * MS, (0, 0, -40)) == []
    (got,) = medium.observe("1", 50 * MS, (110, 0, -40))
    assert got.distance_m == pytest.approx(105.0)
    assert medium.in_flight == 0


def test_silent_node_is_used_where_it_was_last_seen():
    medium = Medium(radio(), seed=1, nodes=["0", "1"], max_truth_age_ns=100 * MS)
    medium.observe("0", 0, (0, 0, -40))
    medium.observe("1", 0, (100, 0, -40))
    assert medium.transmit("0", 0, 50 * MS, 40) == []
    assert medium.observe("0", 100 * MS, (0, 0, -40)) == []
    (got,) = medium.observe("0", 150 * MS, (0, 0, -40))
    assert got.distance_m == 100.0


def test_node_that_was_never_seen_has_no_position():
    medium = Medium(radio(), seed=1, nodes=["0", "1", "2"])
    medium.observe("0", 0, (0, 0, -40))
    medium.observe("1", 0, (50, 0, -40))
    medium.transmit("0", 0, 50 * MS, 40)
    by_rx = {reception.rx: reception for reception in medium.flush()}
    assert by_rx["1"].fate is Fate.DELIVERED
    assert by_rx["2"].fate is Fate.NO_POSITION
    assert math.isnan(by_rx["2"].distance_m)
    assert by_rx["2"].probability_of_delivery == 0.0


def test_late_packet_uses_the_truth_of_its_own_time():
    medium = Medium(radio(), seed=1, nodes=["0", "1"])
    for k in range(40):
        medium.observe("0", k * 50 * MS, (0, 0, -40))
        medium.observe("1", k * 50 * MS, (10.0 * k, 0, -40))
    (got,) = medium.transmit("1", 0, 275 * MS, 40)
    assert got.distance_m == pytest.approx(55.0)


def test_out_of_range_and_base_loss_have_their_own_cause():
    assert pair(radio("disk"), 401.0).transmit("0", 0, 0, 40)[0].fate is Fate.OUT_OF_RANGE
    medium = pair(radio("perfect", base_loss=0.25), 10.0)
    fates = [medium.transmit("0", seq, 0, 40)[0].fate for seq in range(2000)]
    assert set(fates) == {Fate.DELIVERED, Fate.BASE_LOSS}
    assert abs(fates.count(Fate.BASE_LOSS) / 2000 - 0.25) < 3.3 * math.sqrt(0.25 * 0.75 / 2000)


@pytest.mark.parametrize("distance_m", [320.0, 360.0, 400.0, 430.0])
def test_monte_carlo_agrees_with_the_closed_probability(distance_m):
    paper = radio()
    medium = pair(paper, distance_m, seed=2)
    n = 2000
    delivered = sum(medium.transmit("0", seq, 0, 40)[0].fate is Fate.DELIVERED for seq in range(n))
    p = float(paper.probability_of_delivery(distance_m))
    assert abs(delivered / n - p) < 3.29 * math.sqrt(p * (1 - p) / n) + 1 / n


def test_ledger_balances_and_bins_predict():
    medium = pair(radio(base_loss=0.1), 395.0, seed=3)
    ledger = Ledger()
    for seq in range(1000):
        ledger.sent("0", ["1"])
        ledger.settle(medium.transmit("0", seq, 0, 40))
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
    ledger = Ledger()
    ledger.settle(medium.transmit("0", 0, 0, 40))
    with pytest.raises(LedgerError, match="0 -> 1"):
        ledger.check()
    ledger.sent("0", ["1"])
    ledger.sent("0", ["1"])
    ledger.check(1)
    with pytest.raises(LedgerError):
        ledger.check(0)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda m: m.transmit("9", 0, 0, 40), "tx"),
        (lambda m: m.transmit("0", -1, 0, 40), "seq"),
        (lambda m: m.transmit("0", 0, 0, -1), "length_bytes"),
        (lambda m: m.observe("0", 0, (math.nan, 0, 0)), "position_ned_m"),
        (lambda m: m.observe("0", 0, (0, 0)), "position_ned_m"),
        (lambda m: m.observe("0", 0, (0, 0, 0), attitude_wxyz=(0, 0, 0, 0)), "attitude_wxyz"),
        (lambda m: Medium(m.radio, seed=1.5, nodes="ab"), "seed"),
        (lambda m: Medium(m.radio, seed=1, nodes="aa"), "nodes"),
    ],
)
def test_mistakes_of_the_caller_are_named(call, name):
    with pytest.raises(ChannelInputError) as caught:
        call(Medium(radio(), seed=1, nodes=["0", "1"]))
    assert caught.value.name == name


@pytest.mark.parametrize("bad", [float("nan"), 1.5, "1"])
def test_numbers_that_are_not_whole_are_refused(bad):
    medium = Medium(Radio(presets.load_radio("moon2020")), seed=1, nodes=["a", "b"])
    with pytest.raises(ChannelInputError, match=r"sim_time_ns = .*allowed is an integer"):
        medium.observe("a", bad, (0.0, 0.0, -40.0))
    for name in ("seq", "sim_time_ns", "length_bytes"):
        packet = {"seq": 0, "sim_time_ns": 0, "length_bytes": 40}
        with pytest.raises(ChannelInputError, match=f"{name} = .*allowed is an integer"):
            medium.transmit("a", **(packet | {name: bad}))
    assert medium.in_flight == 0
