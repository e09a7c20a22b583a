import math

import numpy as np
import pytest
from scipy.special import erfc

from channel import presets
from channel.access.media.sik.timing import sik_timing
from channel.phy import modulation
from channel.phy.error_model import (
    Band,
    ErfcBytes,
    NoncoherentFsk,
    SnrTable,
    Threshold,
    UncodedAwgn,
    packet_error,
)
from channel.phy.golay import word_error

BAND = Band(20e6, 20e6)
SNR_DB = np.array([6.0, 8.0, 10.0])


def test_ber_golden_values():
    assert ErfcBytes().ber(SNR_DB, BAND) == pytest.approx([4.7766e-3, 3.8182e-4, 7.7442e-6], rel=2e-5)


def test_per_golden_values_of_100_bytes():
    assert ErfcBytes().per(SNR_DB, 100.0, BAND) == pytest.approx([0.38048, 0.03747, 0.00077], abs=5e-6)


def snr_for_half(per_of):
    low, high = 0.0, 20.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if per_of(middle) > 0.5 else (low, middle)
    return low


@pytest.mark.parametrize(
    ("half", "bits", "expected_db"), [(1.0, 1, 5.62), (0.5, 1, 4.82), (1.0, 8, 7.44), (0.5, 8, 6.91)]
)
def test_snr_of_half_the_packets_lost(half, bits, expected_db):
    got = snr_for_half(lambda db: packet_error(half * erfc(math.sqrt(10 ** (db / 10))), 100 * bits))
    assert got == pytest.approx(expected_db, abs=0.005)


def test_models_of_the_two_ends_of_that_table():
    paper = snr_for_half(lambda db: ErfcBytes().per(np.asarray(db), 100.0, BAND))
    textbook = snr_for_half(lambda db: UncodedAwgn().per(np.asarray(db), 100.0, BAND))
    assert paper == pytest.approx(5.62, abs=0.005)
    assert textbook == pytest.approx(6.91, abs=0.005)
    halved = snr_for_half(lambda db: UncodedAwgn().per(np.asarray(db), 100.0, Band(20e6, 40e6)))
    assert halved - textbook == pytest.approx(3.0103, abs=1e-3)


def test_small_rates_are_not_rounded_to_zero():
    assert packet_error(1e-18, 800) == pytest.approx(8e-16, rel=1e-12)


def test_certain_errors_stay_finite():
    assert packet_error(1.0, np.array([0.0, 1e-90, 0.04, 1.0, 1e200])).tolist() == [
        0.0,
        1.0,
        1.0,
        1.0,
        1.0,
    ]
    assert np.all(ErfcBytes().per(np.array([-5000.0, -400.0, 5000.0]), 40.0, BAND) == [1.0, 1.0, 0.0])


@pytest.mark.parametrize(("order", "bits"), [(4, 2), (16, 4), (64, 6)])
def test_qam_equals_a_decision_by_decision_sum(order, bits):
    """Exact average over all Gray-coded amplitude levels and decision regions of one axis."""
    side = math.isqrt(order)
    ebn0 = 3.0
    levels = np.arange(-(side - 1), side, 2.0)
    half_distance = math.sqrt(3.0 * bits * ebn0 / (2.0 * (order - 1.0)))  # over sqrt(N0)
    borders = np.concatenate(([-np.inf], (levels[:-1] + levels[1:]) / 2, [np.inf]))
    gray = [i ^ (i >> 1) for i in range(side)]
    errors = 0.0
    for i, level in enumerate(levels):
        for j in range(side):
            low, high = (borders[j] - level) * half_distance, (borders[j + 1] - level) * half_distance
            chance = 0.5 * (erfc(low) - erfc(high))
            errors += chance * bin(gray[i] ^ gray[j]).count("1") / side
    errors /= bits / 2
    assert modulation.ber_square_qam(ebn0, order) == pytest.approx(errors, rel=1e-9)


def test_qam_of_order_four_is_qpsk():
    ebn0 = np.geomspace(0.01, 20, 30)
    assert modulation.ber_square_qam(ebn0, 4) == pytest.approx(modulation.ber_qpsk(ebn0), rel=1e-12)


def test_threshold_includes_its_own_value():
    assert Threshold(snr_min_db=5.0).per(np.array([4.99, 5.0]), 40.0, BAND).tolist() == [1.0, 0.0]


def test_where_a_table_loses_all_it_loses_all_lengths():
    """1 - (1 - per)^(N / N0), written out; beyond the table, at its end, and between rows."""
    table = SnrTable(table=((0.0, 1.0), (1.0, 0.9), (5.0, 0.0)), reference_length_bytes=1000)
    snr_db, lengths = (
        np.array([[-60.0], [0.0], [0.5], [3.0], [6.0]]),
        np.array([0.0, 0.01, 14.0, 40.0, 2000.0]),
    )
    expected = 1.0 - (1.0 - np.array([[1.0], [1.0], [0.95], [0.45], [0.0]])) ** (lengths / 1000.0)
    assert table.per(snr_db, lengths, BAND) == pytest.approx(expected, rel=1e-12, abs=1e-15)
    assert table.per(snr_db, lengths, BAND)[:2].tolist() == [[0.0, 1.0, 1.0, 1.0, 1.0]] * 2
    assert table.ber(np.array([-60.0, 3.0]), BAND) == pytest.approx([1.0, 1.0 - 0.55 ** (1 / 8000)])


def test_gz_example_world_means():
    config = presets.radio_from_mapping(
        {
            "preset": "perfect",
            "transmit_power_dbm": 20,
            "antenna": {"gain_db": 0},
            "propagation": {"model": "log-distance", "exponent": 2.6, "reference_loss_db": 40},
            "noise": {"model": "fixed", "floor_dbm": -90},
        }
    )
    from channel.link.radio import Radio

    link = Radio(config).link(52.0)
    assert float(link.received_power_dbm) == pytest.approx(-64.616, abs=5e-4)
    assert float(link.snr_db) == pytest.approx(25.384, abs=5e-4)


@pytest.mark.parametrize(
    ("ber", "word", "coded", "plain"),
    [(1e-3, 8.7e-9, 0.0, 0.376), (1e-2, 7.6e-5, 0.003, 0.991), (5e-2, 2.6e-2, None, None)],
)
def test_golay_keeps_a_sik_packet(ber, word, coded, plain):
    """50 B of a SiK radio: 59 B that errors can hit; coded 60 B, in 40 words."""
    snr_db = np.asarray([10.0 * math.log10(2.0 * math.log(0.5 / ber))])
    golay, none = (NoncoherentFsk(coding=coding) for coding in ("golay", "none"))
    assert none.ber(snr_db, BAND) == pytest.approx([ber])
    assert golay.per(snr_db, 1.5, BAND) == pytest.approx([word], rel=0.01)
    if coded is not None:
        assert golay.per(snr_db, sik_timing(ecc=True).fragile_bytes(50), BAND) == pytest.approx(
            [coded], abs=5e-4
        )
        assert none.per(snr_db, sik_timing().fragile_bytes(50), BAND) == pytest.approx([plain], abs=1e-3)


def test_golay_words_by_counting_errors():
    """Of 200000 words drawn at a bit error rate of 0.1, so many have more than three errors."""
    wrong = np.random.default_rng(1).random((200_000, 23)) < 0.1
    assert word_error(0.1) == pytest.approx(np.mean(wrong.sum(axis=1) > 3), rel=0.02)
