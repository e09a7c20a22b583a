"""The paper's channel against its printed and quoted numbers."""

import numpy as np
import pytest

from channel import presets
from channel.checks import ChannelInputError
from channel.link.radio import Radio

DISTANCES_M = [100, 200, 300, 320, 340, 360, 380, 400, 420, 450, 480, 500]
MOON2020 = [1.000, 1.000, 0.999, 0.995, 0.978, 0.929, 0.823, 0.642, 0.391, 0.054, 0.000, 0.000]


def radio(name):
    return Radio(presets.load_radio(name))


def test_closed_probability_of_moon2020():
    assert radio("moon2020").probability_of_delivery(DISTANCES_M) == pytest.approx(MOON2020, abs=0.002)


def test_closed_probability_of_table_three():
    got = radio("moon2020-table3").probability_of_delivery([200, 300, 320, 340, 360, 380])
    assert got == pytest.approx([0.999, 0.581, 0.316, 0.087, 0.007, 0.0], abs=0.002)


def test_noise_free_power_at_2412_mhz():
    link = radio("moon2020").link([60, 120, 240, 360, 400, 480, 600])
    printed = [-230.9, -267.0, -303.1, -324.3, -329.7, -339.2, -350.9]
    assert np.round(link.received_power_dbm, 1).tolist() == printed


def test_power_is_equation_four_with_the_sign_of_friis():
    wavelength = 299792458.0 / 2.412e9
    by_hand = 18 + 2.3 + 2.3 + 20 * np.log10(wavelength) - 20 * np.log10(4 * np.pi) - 120 * np.log10(400)
    assert float(radio("moon2020").link(400).received_power_dbm) == pytest.approx(by_hand, abs=1e-9)


def test_power_falls_with_frequency_by_the_friis_term():
    paper = radio("moon2020")
    low = paper.link(200, frequency_hz=2.412e9).received_power_dbm
    high = paper.link(200, frequency_hz=5.815e9).received_power_dbm
    assert low - high == pytest.approx(20 * np.log10(5.815 / 2.412), abs=1e-9)


def test_no_distance_is_clamped_to_one_metre():
    paper = radio("moon2020")
    assert paper.link(0.0).received_power_dbm == paper.link(1.0).received_power_dbm


def test_terms_add_up_to_the_received_power():
    link = radio("moon2020-table3").link([60.0, 600.0])
    total = sum(np.asarray(term.contribution) for term in link.terms)
    assert total == pytest.approx(link.received_power_dbm, abs=1e-9)
    assert link.terms[0].name == "transmit_power_dbm"


def test_paper_length_is_fixed_and_corrected_counts_the_payload():
    assert radio("moon2020").length_bytes(1000) == 40
    assert radio("corrected").length_bytes(1000) == 1000


def test_range_of_the_disk():
    disk = radio("disk")
    assert disk.probability_of_delivery([399.9, 400.0, 400.1]).tolist() == [1.0, 1.0, 0.0]
    assert disk.link(401.0).per == 1.0


def test_perfect_delivers_at_any_distance():
    assert radio("perfect").probability_of_delivery([1.0, 1e6]).tolist() == [1.0, 1.0]


def test_quadrature_bound_is_honest_and_small():
    delivery = radio("moon2020").delivery(DISTANCES_M)
    assert np.all(delivery.error_bound < 1e-6)


def test_expected_delivery_table_agrees_with_the_quadrature():
    for name in ("moon2020", "corrected", "moon2020-table3", "disk"):
        model = radio(name)
        distance = np.geomspace(50, 5000, 200)
        exact = model.probability_of_delivery(distance)
        assert model.expected_delivery(distance) == pytest.approx(exact, abs=1e-5)
        exact = model.probability_of_delivery(distance, length_bytes=400)
        assert model.expected_delivery(distance, length_bytes=400) == pytest.approx(exact, abs=1e-5)
        one = model.expected_delivery(400.0)
        assert (one.shape, float(one)) == (
            (),
            pytest.approx(float(model.probability_of_delivery(400.0)), abs=1e-5),
        )
    with pytest.raises(ChannelInputError, match="length_bytes"):
        model.expected_delivery(distance, length_bytes=-1)
