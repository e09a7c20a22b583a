"""What a receiver takes in of an emission: the oracle is a sum over a fine grid of frequencies."""

import numpy as np
import pytest

from channel.phy.spectrum import captured_db, masked, reaches

SHARES = [0.0, 0.5, 0.55, 1.0, 1.5, 2.5]
LEVELS_DB = [0.0, 0.0, -20.0, -28.0, -40.0, -40.0]


def level(at_hz, bandwidth_hz):
    """The mask of IEEE 802.11-2020, 17.3.9.3, in watt per hertz of what is flat."""
    return 10.0 ** (np.interp(np.abs(at_hz) / bandwidth_hz, SHARES, LEVELS_DB) / 10.0)


@pytest.mark.parametrize(
    ("offset_hz", "emitted_hz", "received_hz"),
    [(0.0, 20e6, 130e3), (3e6, 20e6, 130e3), (15e6, 20e6, 130e3), (20e6, 20e6, 20e6), (-7e6, 1e6, 20e6)],
)
def test_it_is_the_integral_of_spectrum_times_filter(offset_hz, emitted_hz, received_hz):
    step = min(emitted_hz, received_hz) / 1e3
    at_hz = np.arange(-2.5 * emitted_hz, 2.5 * emitted_hz, step) + 0.5 * step
    power = level(at_hz, emitted_hz)
    passed = power * level(np.minimum(np.abs(at_hz + offset_hz), 2.5 * received_hz), received_hz)
    by_sum_db = 10.0 * np.log10(passed.sum() / power.sum())
    assert captured_db(offset_hz, emitted_hz, masked(received_hz)) == pytest.approx(by_sum_db, abs=0.01)


def test_of_a_wide_emission_a_narrow_radio_takes_its_share_of_the_band():
    """130 kHz of 20 MHz are 21.9 dB, and what lies in the skirts of either is less than 0.2 dB."""
    assert captured_db(0.0, 20e6, masked(130e3)) == pytest.approx(10.0 * np.log10(0.13 / 20.0), abs=0.2)
    assert captured_db(0.0, 1e3, masked(130e3)) == 0.0


def test_neighbours_of_one_bandwidth_are_as_far_apart_as_802_11_asks():
    """Table 17-18: at 6 Mb/s 16 dB of the adjacent channel, 32 dB of the one beyond, in 20 MHz."""
    assert captured_db(20e6, 20e6, masked(20e6)) == pytest.approx(-16.0, abs=0.1)
    assert captured_db(40e6, 20e6, masked(20e6)) < -32.0


def test_far_off_nothing_is_heard():
    assert not reaches(5e6, 130e3, masked(130e3))
    assert reaches(5e6, 20e6, masked(130e3))
    assert captured_db(5e6, 130e3, ((0.0, 0.0), (1e6, -52.0), (8e6, -63.0))) == pytest.approx(-58.3, abs=0.1)
