import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.channel.fit_coverage import ParameterSet, synthetic_log
from channel import presets
from channel.checks import ChannelInputError
from channel.cli.commands import main
from channel.fit.calibration import NotEnoughInformationError, fit_radio, fitted_radio
from channel.fit.flight_log import FlightLog, FlightLogError, read_flight_log
from channel.fit.likelihood import power_at_reference_dbm
from channel.link.radio import Radio


def synthetic(config, packets, low_m, high_m, seed, rssi=False):
    """A log drawn with numpy's own generator, not with the draws of the medium."""
    rng = np.random.Generator(np.random.PCG64(seed))
    radio = Radio(config)
    distance = rng.uniform(low_m, high_m, packets)
    power = radio.mean_power_dbm(radio.path(distance)) - config.shadowing.loss_db(
        rng.standard_normal(packets)
    )
    per = radio.per(power - radio.noise_floor_dbm, 40.0)
    delivered = (rng.uniform(size=packets) > per) & (rng.uniform(size=packets) > config.base_loss)
    measured = np.where(delivered & rssi, power, np.nan)
    return FlightLog(distance, delivered, np.full(packets, 40.0), measured)


def truth_of(config):
    return {
        "propagation.exponent": config.propagation.exponent,
        "offset_db": config.offset_db,
        "shadowing.sigma_db": config.shadowing.sigma_db,
        "base_loss": config.base_loss,
        "noise.floor_dbm": Radio(config).noise_floor_dbm,
    }


@pytest.mark.parametrize("seed", [1])
def test_with_rssi_everything_is_found(seed):
    config = presets.load_radio("corrected", {"base_loss": 0.05, "propagation": {"exponent": 2.7}})
    base = presets.load_radio("corrected")
    fit = fit_radio(synthetic(config, 1000, 50, 1500, seed, rssi=True), base)
    truth = truth_of(config)
    for estimate in fit.estimates:
        assert estimate.value is not None
        assert estimate.low <= truth[estimate.name] <= estimate.high
    by_name = {estimate.name: estimate for estimate in fit.estimates}
    assert by_name["propagation.exponent"].high - by_name["propagation.exponent"].low < 0.8
    assert by_name["noise.floor_dbm"].high - by_name["noise.floor_dbm"].low < 4.0


@pytest.mark.parametrize("seed", [6, 17])
def test_long_ridge_is_followed_to_its_end(seed):
    """Without RSSI, where a steep law with much shadowing is as likely as the flat one that is true."""
    floor = {"noise": {"model": "fixed", "floor_dbm": -95.0}}
    config = presets.load_radio(
        "corrected", {"propagation": {"exponent": 3.0}, "offset_db": 2.0, "base_loss": 0.05, **floor}
    )
    fit = fit_radio(synthetic(config, 2000, 20, 900, seed), presets.load_radio("corrected", floor))
    truth = truth_of(config)
    for estimate in fit.estimates:
        assert estimate.low <= truth[estimate.name] <= estimate.high


def test_what_is_known_stays_known_along_the_ridge():
    """Without RSSI, with sigma known, the rest is determined."""
    config = presets.load_radio("corrected", {"propagation": {"exponent": 2.6}, "base_loss": 0.07})
    fit = fit_radio(
        synthetic(config, 2000, 20, 900, 1), presets.load_radio("corrected"), ["shadowing.sigma_db"]
    )
    truth = truth_of(config)
    for estimate in fit.estimates:
        if estimate.name in {"propagation.exponent", "offset_db", "base_loss"}:
            assert estimate.value is not None
            assert estimate.low <= truth[estimate.name] <= estimate.high


def fresh_set(base, exponent, sigma_db, base_loss, floor_dbm, **more):
    values = {
        "propagation": {"exponent": exponent},
        "offset_db": 0.7,
        "shadowing": {"sigma_db": sigma_db},
        "base_loss": base_loss,
        "noise": {"model": "fixed", "floor_dbm": floor_dbm},
    }
    return ParameterSet(base, values, rssi=True, **more)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("chosen", "widest"),
    [
        (fresh_set("corrected", 2.35, 5.3, 0.03, -94.2), 0.4),
        (fresh_set("moon2020", 8.1, 4.4, 0.15, -262.0, rssi_step_db=0.0), 0.2),
        pytest.param(
            fresh_set("moon2020", 3.0, 7.5, 0.0, -98.0, out_and_back=True), 0.3, marks=pytest.mark.long
        ),
    ],
)
def test_intervals_hold_the_truth_and_are_no_wider_than_the_data_ask(chosen, widest):
    """Radios that no fit was tuned on: every interval closed, and few of them beside the truth."""
    truth = truth_of(chosen.truth)
    base = presets.load_radio(chosen.base)
    held = total = 0
    for repeat in range(12):
        fit = fit_radio(synthetic_log(chosen, 2000, (7, repeat)), base)
        for estimate in fit.estimates:
            total += 1
            held += estimate.low <= truth[estimate.name] <= estimate.high
            assert np.isfinite([estimate.low, estimate.high]).all()
        assert fit.estimates[0].high - fit.estimates[0].low < widest
    assert held >= 0.88 * total


def test_a_receivers_own_error_is_told_from_shadowing():
    config = presets.load_radio("corrected", {"shadowing": {"sigma_db": 2.0}, "base_loss": 0.05})
    rng = np.random.Generator(np.random.PCG64(2))
    clean = synthetic(config, 2000, 50, 1200, 6, rssi=True)
    blurred = FlightLog(
        clean.distance_m, clean.delivered, clean.length_bytes, clean.rssi_dbm + rng.normal(0.0, 1.5, 2000)
    )
    fit = fit_radio(blurred, presets.load_radio("corrected"))
    sigma = next(each for each in fit.estimates if each.name == "shadowing.sigma_db")
    assert sigma.low <= 2.0 <= sigma.high < 2.4  # the scatter of the readings themselves is 2.5
    assert 1.0 < fit.rssi_error_db < 2.0


def test_a_receivers_own_error_is_told_from_one_sided_shadowing():
    chosen = fresh_set("moon2020", 7.0, 2.5, 0.05, -250.0, rssi_step_db=0.0)
    truth, base = truth_of(chosen.truth), presets.load_radio("moon2020")
    held = total = 0
    for repeat in range(8):
        clean = synthetic_log(chosen, 2000, (8, repeat))
        error_db = np.random.Generator(np.random.PCG64(repeat)).normal(0.0, 1.2, 2000)
        log = FlightLog(clean.distance_m, clean.delivered, clean.length_bytes, clean.rssi_dbm + error_db)
        for estimate in fit_radio(log, base).estimates:
            total += 1
            held += estimate.low <= truth[estimate.name] <= estimate.high
    assert held >= 0.88 * total


@pytest.mark.parametrize(("sigma_db", "step_db"), [(0.0, 1.0), (0.5, 1.0)])
def test_readings_in_steps_as_wide_as_the_shadowing_are_not_off_the_law(sigma_db, step_db):
    config = presets.load_radio("corrected", {"shadowing": {"sigma_db": sigma_db}})
    log = synthetic(config, 2000, 50, 1500, 2, rssi=True)
    log = replace(log, rssi_dbm=np.round(log.rssi_dbm / step_db) * step_db)
    assert fit_radio(log, config).goodness.readings > 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("span_m", "rise_db"), [(5.0, 0.0), (5.0, 3.0), (5.0, -6.0), (1000.0, 20.0), (1000.0, 60.0)]
)
def test_readings_over_a_few_metres_or_that_rise_with_distance_do_not_stop_a_fit(span_m, rise_db):
    """A hover, whose line through the readings may have any slope; and a column of losses taken for powers."""
    share = np.linspace(0.0, 1.0, 300)
    noise_db = np.random.Generator(np.random.PCG64(0)).normal(0.0, 2.0, 300)
    log = FlightLog(
        1000.0 + span_m * share, np.ones(300), np.full(300, 40.0), -80.0 + rise_db * share + noise_db
    )
    base = presets.load_radio("corrected")
    fit = fit_radio(log, base)
    exponent = next(each for each in fit.estimates if each.name == "propagation.exponent")
    assert exponent.value is None
    assert exponent.note
    assert fitted_radio(fit, base, "mine").propagation.exponent >= 0.0


def test_readings_off_the_law_do_not_decide_a_fit():
    config = presets.load_radio("moon2020", {"base_loss": 0.05})
    log = synthetic(config, 1500, 50, 550, 8, rssi=True)
    wild = np.flatnonzero(log.delivered)[:3]
    log.rssi_dbm[wild] += 60.0
    fit = fit_radio(log, presets.load_radio("moon2020"))
    for estimate in fit.estimates:
        assert estimate.low <= truth_of(config)[estimate.name] <= estimate.high


def test_all_delivered_with_rssi_fits_the_powers_and_leaves_the_floor():
    config = presets.load_radio("moon2020", {"propagation": {"exponent": 9.5}})
    log = synthetic(config, 500, 30, 200, 9, rssi=True)
    assert log.delivered.all()
    by_name = {each.name: each for each in fit_radio(log, presets.load_radio("moon2020")).estimates}
    assert by_name["propagation.exponent"].low <= 9.5 <= by_name["propagation.exponent"].high
    assert by_name["noise.floor_dbm"].value is None
    assert by_name["base_loss"].low == 0.0
    assert by_name["base_loss"].high == pytest.approx(1.92 / 500, rel=0.1)


@pytest.mark.parametrize("weaker_db", [0.0, 20.0, 35.0])
def test_a_base_whose_floor_the_readings_rule_out_does_not_move_what_they_determine(weaker_db):
    """All arrived: a floor has no lower end, but an upper one, below the base's -95 dBm in the last two."""
    base = presets.load_radio("corrected")
    quiet = {"offset_db": -weaker_db, "noise": {"model": "fixed", "floor_dbm": -95.0 - weaker_db}}
    log = synthetic(
        presets.load_radio("corrected", quiet | {"shadowing": {"sigma_db": 2.0}}), 600, 50, 300, 1, True
    )
    assert log.delivered.all()
    fit = fit_radio(log, base)
    by_name = {each.name: each for each in fit.estimates}
    assert by_name["noise.floor_dbm"].value is None
    written = Radio(fitted_radio(fit, base, "mine"))
    assert written.noise_floor_dbm <= by_name["noise.floor_dbm"].high
    power_dbm = float(written.link(fit.level.distance_m).received_power_dbm)
    assert power_dbm == pytest.approx(fit.level.value_dbm, abs=1e-6)
    assert fit.level.low_dbm <= power_dbm <= fit.level.high_dbm
    assert by_name["offset_db"].low <= written.config.offset_db <= by_name["offset_db"].high
    assert np.mean(written.probability_of_delivery(log.distance_m)) > 0.995


def test_without_rssi_the_floor_is_fitted_if_the_offset_is_known():
    config = presets.load_radio("moon2020", {"noise": {"model": "fixed", "floor_dbm": -334.0}})
    log = synthetic(config, 2000, 50, 600, 10)
    hold = ["offset_db", "propagation.exponent"]
    by_name = {each.name: each for each in fit_radio(log, presets.load_radio("moon2020"), hold).estimates}
    assert by_name["noise.floor_dbm"].low <= -334.0 <= by_name["noise.floor_dbm"].high
    assert by_name["offset_db"].value is None


def test_packets_beyond_the_range_say_nothing():
    base = presets.load_radio("subt")
    config = presets.load_radio("subt", {"noise": {"model": "fixed", "floor_dbm": -72.0}, "base_loss": 0.1})
    log = synthetic(config, 1500, 20, 490, 11, rssi=True)
    far = FlightLog(
        np.append(log.distance_m, np.full(500, 800.0)),
        np.append(log.delivered, np.zeros(500, dtype=bool)),
        np.full(2000, 40.0),
        np.append(log.rssi_dbm, np.full(500, np.nan)),
    )
    assert fit_radio(far, base) == fit_radio(log, base)
    with pytest.raises(ChannelInputError, match="max_range_m"):
        fit_radio(FlightLog(far.distance_m, ~far.delivered, far.length_bytes, far.rssi_dbm), base)


def test_the_papers_gap_is_found_as_base_loss():
    config = presets.load_radio("moon2020", {"base_loss": 0.1})
    base = presets.load_radio("moon2020")
    fit = fit_radio(synthetic(config, 2000, 50, 600, 3), base, hold=["shadowing.sigma_db"])
    by_name = {estimate.name: estimate for estimate in fit.estimates}
    assert by_name["base_loss"].low <= 0.1 <= by_name["base_loss"].high
    assert by_name["propagation.exponent"].low <= 12.0 <= by_name["propagation.exponent"].high
    fitted = Radio(fitted_radio(fit, base, "mine"))
    curve = np.array([100.0, 300.0, 400.0])
    expected = Radio(config).probability_of_delivery(curve)
    assert fitted.probability_of_delivery(curve) == pytest.approx(expected, abs=0.04)


def test_what_deliveries_alone_do_not_determine_is_said():
    base = presets.load_radio("moon2020")
    fit = fit_radio(synthetic(base, 400, 50, 600, 4), base)
    by_name = {estimate.name: estimate for estimate in fit.estimates}
    assert by_name["noise.floor_dbm"].value is None
    assert "RSSI" in by_name["noise.floor_dbm"].note
    assert by_name["propagation.exponent"].value is None
    assert by_name["propagation.exponent"].low <= 12.0 <= by_name["propagation.exponent"].high


@pytest.mark.parametrize(
    ("distances", "delivered", "word"),
    [
        (np.linspace(10, 20, 10), np.arange(10) % 2, "at least 20"),
        (np.linspace(10, 100, 50), np.ones(50), "fly farther"),
        (np.linspace(10, 100, 50), np.zeros(50), "fly nearer"),
        (np.full(50, 100.0), np.arange(50) % 2, "one distance"),
    ],
)
def test_too_little_information_is_said(distances, delivered, word):
    log = FlightLog(
        distances, delivered.astype(bool), np.full(distances.size, 40.0), np.full(distances.size, np.nan)
    )
    with pytest.raises(NotEnoughInformationError, match=word):
        fit_radio(log, presets.load_radio("moon2020"))


def test_few_packets_do_not_pin_the_base_loss():
    """20 packets of which 4 were lost, one of them nearer than one that arrived: a tenth of base loss is as likely."""
    distance = [
        101,
        104,
        109,
        115,
        271,
        318,
        406,
        414,
        428,
        452,
        504,
        525,
        648,
        670,
        786,
        788,
        821,
        869,
        938,
        961.0,
    ]
    lost = (13, 15, 18, 19)
    delivered = np.isin(np.arange(20), lost, invert=True)
    log = FlightLog(np.array(distance), delivered, np.full(20, 40.0), np.full(20, np.nan))
    by_name = {each.name: each for each in fit_radio(log, presets.load_radio("corrected")).estimates}
    assert by_name["base_loss"].low == 0.0
    assert by_name["base_loss"].high > 0.15


def test_known_values_beyond_what_a_fit_takes_are_refused():
    log = synthetic(presets.load_radio("moon2020"), 100, 50, 600, 1)
    base = presets.load_radio("moon2020", {"shadowing": {"sigma_db": 40.0}})
    with pytest.raises(ChannelInputError, match=r"shadowing\.sigma_db = 40\.0: allowed is 0 to 30"):
        fit_radio(log, base, hold=["shadowing.sigma_db"])


def test_bases_and_names_that_cannot_be_fitted():
    log = synthetic(presets.load_radio("moon2020"), 100, 50, 600, 1)
    with pytest.raises(ChannelInputError, match=r"propagation\.model"):
        fit_radio(log, presets.load_radio("telemetry-915"))
    with pytest.raises(ChannelInputError, match=r"fading\.model"):
        fit_radio(log, presets.load_radio("corrected", {"fading": {"model": "rayleigh"}}))
    with pytest.raises(ChannelInputError, match="hold"):
        fit_radio(log, presets.load_radio("moon2020"), hold=["sigma"])


def test_command_reads_a_log_and_writes_a_radio(tmp_path):
    config = presets.load_radio("moon2020", {"base_loss": 0.1})
    data = synthetic(config, 400, 50, 600, 5)
    log, radio, plot = tmp_path / "flight.csv", tmp_path / "mine.yaml", tmp_path / "fit.png"
    rows = [f"{d:.3f},{int(ok)}" for d, ok in zip(data.distance_m, data.delivered, strict=True)]
    log.write_text("\n".join(["distance_m,delivered", *rows]))
    hold = ["--hold", "shadowing.sigma_db", "--hold", "propagation.exponent"]
    options = [*hold, "--radio", "moon2020", "--out", str(radio), "--plot", str(plot), "--json"]
    report = json.loads(CliRunner().invoke(main, ["fit", str(log), *options], catch_exceptions=False).output)
    by_name = {each["name"]: each for each in report["estimates"]}
    assert by_name["base_loss"]["low"] <= 0.1 <= by_name["base_loss"]["high"]
    assert presets.load_radio(radio).base_loss == pytest.approx(by_name["base_loss"]["value"])
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_log_with_positions_and_fates(tmp_path):
    log = tmp_path / "log.csv"
    heading = "tx_lat_deg,tx_lon_deg,tx_alt_m,rx_lat_deg,rx_lon_deg,rx_alt_m,fate,rssi_dbm,length_bytes"
    log.write_text(
        f"{heading}\n0,179.9995,40,0,-179.9995,40,delivered,-71.5,80\n0,0,40,0.001,0,40,channel_erasure,,\n"
    )
    read = read_flight_log(log, 40)
    assert read.distance_m == pytest.approx([111.195, 111.195], abs=0.01)
    assert read.delivered.tolist() == [True, False]
    assert read.length_bytes.tolist() == [80.0, 40.0]
    assert read.rssi_dbm[0] == -71.5
    assert np.isnan(read.rssi_dbm[1])


def test_columns_as_programs_write_them(tmp_path):
    log = tmp_path / "log.csv"
    log.write_bytes(
        b"\xef\xbb\xbfdistance_m,delivered,rssi_dbm\r\n0,1.0,nan\r\n2.5e+01,0.000e+00,\r\n30,True,-80\r\n"
    )
    read = read_flight_log(log, 40)
    assert read.distance_m.tolist() == [0.0, 25.0, 30.0]
    assert read.delivered.tolist() == [True, False, True]
    assert np.isnan(read.rssi_dbm[:2]).all()
    assert read.rssi_dbm[2] == -80.0


def test_a_file_of_bytes_is_no_log(tmp_path):
    log = tmp_path / "log.csv"
    log.write_bytes(bytes(range(256)) * 10)
    with pytest.raises(FlightLogError, match=r"log\.csv"):
        read_flight_log(log, 40)


PLACES = "tx_lat_deg,tx_lon_deg,tx_alt_m,rx_lat_deg,rx_lon_deg,rx_alt_m,delivered"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("delivered,distance_m\n1,10\n1,12,5\n", r"log\.csv: .* line 3 has 3 fields under 2 headings"),
        ("distance_m,delivered,distance_m\n1,1,100\n", r"log\.csv: .* it has 2 columns distance_m"),
        (
            f"{PLACES}\n401330000,-1052400000,5,401340000,-1052400000,5,1\n",
            r"log\.csv:2: tx_lat_deg = 4.0133e\+08",
        ),
        (
            f"{PLACES}\n40,-105,5,90.001,-105,5,1\n",
            r"log\.csv:2: rx_lat_deg = 90\.001: has to be from -90 to 90",
        ),
        (f"{PLACES}\n40,-105,5,40,-361,5,1\n", r"log\.csv:2: rx_lon_deg = -361: has to be from -360 to 360"),
    ],
)
def test_what_would_be_read_as_something_else_is_refused(tmp_path, text, words):
    log = tmp_path / "log.csv"
    log.write_text(text)
    with pytest.raises(FlightLogError, match=words):
        read_flight_log(log, 40)


def test_blanks_about_fields_and_empty_fields_behind_them_change_nothing(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("distance_m , fate,,\n 10 , delivered ,,\n20,no_position \n30,delivered,,,\t\n")
    read = read_flight_log(log, 40)
    assert read.distance_m.tolist() == [10.0, 30.0]
    assert read.delivered.tolist() == [True, True]


def test_packets_of_a_run_that_were_lost_nowhere_are_left_out(tmp_path):
    log = tmp_path / "deliveries.csv"
    log.write_text("distance_m, fate\n80.000,delivered\nnan,no_position\n90.000, out_of_range\n")
    read = read_flight_log(log, 40)
    assert read.distance_m.tolist() == [80.0, 90.0]
    assert read.delivered.tolist() == [True, False]
    log.write_text("distance_m,fate\nnan,delivered\n")
    with pytest.raises(FlightLogError, match="distance_m = 'nan'"):
        read_flight_log(log, 40)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("distance_m", np.nan, "distance_m = nan"),
        ("distance_m", -3.0, r"distance_m = -3\.0: allowed is a finite number >= 0"),
        ("delivered", 0.5, "delivered = .*allowed is 0 or 1"),
        ("length_bytes", -40.0, r"length_bytes = -40\.0"),
        ("rssi_dbm", np.inf, "rssi_dbm = inf"),
        ("rssi_dbm", None, r"rssi_dbm = .*shape \(2,\).*one number per packet"),
    ],
)
def test_a_log_with_a_value_that_cannot_be_is_refused(column, value, words):
    columns = {name: np.ones(3) for name in ("distance_m", "delivered", "length_bytes", "rssi_dbm")}
    columns[column] = np.ones(2) if value is None else np.array([1.0, value, 1.0])
    with pytest.raises(ChannelInputError, match=words):
        FlightLog(**columns)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("distance_m,delivered,length_bytes\n5,1,-40\n", "length_bytes = -40"),
        ("distance_m,delivered\n1,maybe\n", "delivered = 'maybe'"),
        ("distance_m,delivered\nx,1\n", "distance_m = 'x'"),
        ("distance_m,delivered\n-3,1\n", "0 or above"),
        ("distance_m,delivered\n3,0.5\n", "delivered = '0.5'"),
        ("distance_m,delivered,rssi_dbm\n3,1,loud\n", "rssi_dbm = 'loud'"),
        ("time,delivered\n1,1\n", "needs distance_m"),
        ("distance_m,delivered\n", "no rows"),
    ],
)
def test_logs_that_cannot_be_read_name_the_line(tmp_path, text, words):
    log = tmp_path / "log.csv"
    log.write_text(text)
    with pytest.raises(FlightLogError, match=words):
        read_flight_log(log, 40)


def test_the_level_that_a_fit_starts_from_is_the_budgets():
    """Antennas and cables of both ends, whichever they are."""
    ends = {
        "antenna": {"model": "dipole"},
        "receive_antenna": {"model": "isotropic", "gain_db": 5.0},
        "polarisation": {"cross_polar_db": 15.0},
    }
    for cables in ({"cable_loss_db": 1.5}, {"cable_loss_db": 1.5, "receive_cable_loss_db": 6.0}):
        base = presets.load_radio("corrected", cables | ends)
        level = float(Radio(base).link(1.0).received_power_dbm)
        assert power_at_reference_dbm(base, 1.0) == pytest.approx(level, abs=1e-9)


def test_a_fit_knows_the_receivers_cable(tmp_path):
    """A log of the radio that is its base, whose receiver has 6 dB of cable, and its transmitter none."""
    own = tmp_path / "own.yaml"
    own.write_text("preset: corrected\nreceive_cable_loss_db: 6\n")
    log, fitted = tmp_path / "log.csv", tmp_path / "fitted.yaml"
    one = synthetic(presets.load_radio(own), 3000, 50, 1500, 1, rssi=True)
    rows = zip(one.distance_m, one.delivered.astype(int), np.round(one.rssi_dbm), strict=True)
    readings = (f"{at:.3f},{came},{f'{dbm:g}' if came else ''},40" for at, came, dbm in rows)
    log.write_text("\n".join(("distance_m,delivered,rssi_dbm,length_bytes", *readings)) + "\n")
    known = [
        each for name in ("propagation.exponent", "noise.floor_dbm", "base_loss") for each in ("--hold", name)
    ]
    options = ["--radio", str(own), "--out", str(fitted), "--json", *known]
    report = json.loads(CliRunner().invoke(main, ["fit", str(log), *options], catch_exceptions=False).output)
    [offset] = [each for each in report["estimates"] if each["name"] == "offset_db"]
    assert offset["low"] <= 0.0 <= offset["high"]
    assert offset["high"] - offset["low"] < 1.5
    meant, found = (Radio(presets.load_radio(file)).probability_of_delivery(500.0) for file in (own, fitted))
    assert found == pytest.approx(float(meant), abs=0.03)
