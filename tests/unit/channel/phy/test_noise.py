"""Man-made noise by ITU-R P.372: numbers by hand from its coefficients."""

import json
import math

import pytest
from click.testing import CliRunner

from channel.cli.commands import main
from channel.link.radio import Radio
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


def floor_at_terminals_dbm(external_db, figure_db, cable_db, bandwidth_hz):
    """ITU-R P.372, eq. 1: fa + (fc - 1) + lc (ft - 1) + lc lt (fr - 1); lc = fc = 1, a cable at T0 has ft = lt."""
    fa, fr, lt = (10.0 ** (db / 10.0) for db in (external_db, figure_db, cable_db))
    factor = fa + (lt - 1.0) + lt * (fr - 1.0)
    return 10.0 * math.log10(1.380649e-23 * 290.0 * bandwidth_hz * 1e3 * factor)


def test_a_cable_takes_of_signal_and_outside_noise_alike(tmp_path):
    """The SNR at the receiver is that at the antenna's terminals, whose system has the cable's loss in its noise."""
    snr_db = {}
    for cable_db in (0.0, 6.0):
        file = tmp_path / f"{cable_db:g}.yaml"
        file.write_text(
            "preset: sik-433\nnoise: {noise_figure_db: 3}\n"
            f"receive_cable_loss_db: {cable_db}\nearth_radius_factor:\npropagation: {{model: free-space}}\n"
        )
        config = load_radio(file)
        external_db = 44.3 - 12.3 * math.log10(config.frequency_hz / 1e6)
        floor_dbm = floor_at_terminals_dbm(external_db, 3.0, cable_db, config.bandwidth_hz) - cable_db
        assert config.noise_floor_dbm == pytest.approx(floor_dbm, abs=1e-9)
        output = CliRunner().invoke(
            main,
            ["link", "--ground-distance", "1000", "--radio", str(file), "--json"],
            catch_exceptions=False,
        )
        link = json.loads(output.output)
        assert link["noise_floor_dbm"] == pytest.approx(floor_dbm, abs=1e-3)
        assert Radio(config).towards(Radio(load_radio("sik-433"))).noise_floor_dbm == pytest.approx(
            load_radio("sik-433").noise_floor_dbm
        )
        snr_db[cable_db] = link["snr_db"]
    lost_db = floor_at_terminals_dbm(external_db, 3.0, 6.0, 1.0) - floor_at_terminals_dbm(
        external_db, 3.0, 0.0, 1.0
    )
    assert lost_db < 3.0
    assert snr_db[0.0] - snr_db[6.0] == pytest.approx(lost_db, abs=1e-3)


def test_a_quiet_sky_is_warmed_by_the_cable():
    """Below T0 outside, the cable adds more than it takes; kinds without an outside know no cable."""
    noise = ManMadeNoise(environment="quiet-rural", noise_figure_db=2.0)
    external_db = 53.6 - 28.6 * math.log10(200.0)
    by_hand = floor_at_terminals_dbm(external_db, 2.0, 3.0, 1e6) - 3.0
    assert noise.behind_cable_dbm(1e6, 200e6, 3.0) == pytest.approx(by_hand, abs=1e-9)
    assert by_hand > noise.noise_floor_dbm(1e6, 200e6)
    assert load_radio("corrected", {"cable_loss_db": 6.0}).noise_floor_dbm == pytest.approx(
        load_radio("corrected").noise_floor_dbm, abs=1e-12
    )
