"""Man-made noise by ITU-R P.372: numbers by hand from its coefficients."""

import math

import pytest

from channel.phy.noise import ManMadeNoise
from channel.presets import load_radio
from channel.validity import OutsideValidityError


@pytest.mark.parametrize(
    ("environment", "frequency_hz", "external_db"),
    [("city", 10e6, 76.8 - 27.7), ("quiet-rural", 100e6, 53.6 - 57.2), ("business", 433e6, 11.87)],
)
def test_it_adds_to_the_receivers_own(environment, frequency_hz, external_db):
    noise = ManMadeNoise(environment=environment, noise_figure_db=6.0)
    factor = 10 ** (external_db / 10) + 10**0.6 - 1.0
    by_hand = 10 * math.log10(1.380649e-23 * 290.0 * 200e3 * 1e3 * factor)
    assert noise.noise_floor_dbm(200e3, frequency_hz) == pytest.approx(by_hand, abs=0.01)


def test_a_frequency_without_a_formula_is_refused():
    with pytest.raises(
        OutsideValidityError, match=r"915000000.0: allowed is 300000 to .*, the validity range of man-made"
    ):
        ManMadeNoise(environment="rural").noise_floor_dbm(1e6, 915e6)


def test_the_floor_of_the_telemetry_preset():
    """915 MHz counts as 900: 44.3 - 12.3 log 900 = 7.96 dB outside and 9 dB inside, in 130 kHz: 11.4 dB over k T B."""
    config = load_radio("telemetry-915")
    floor_dbm = config.noise.noise_floor_dbm(config.bandwidth_hz, config.frequency_hz)
    assert floor_dbm == pytest.approx(-173.98 + 51.14 + 11.17, abs=0.05)
