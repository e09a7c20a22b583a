"""Fits of logs whose shadowing is correlated; the logs are drawn with numpy alone."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.channel.correlated_logs import Truth, drawn
from benchmarks.channel.fit_coverage import ParameterSet, main, synthetic_log
from channel.checks import ChannelInputError
from channel.cli.commands import main as channel
from channel.fit.calibration import fit_radio, fitted_radio
from channel.fit.flight_log import FlightLog
from channel.fit.goodness import readings_and_deliveries
from channel.fit.likelihood import Likelihood
from channel.fit.residuals import DEPENDENT
from channel.link.radio import Radio
from channel.presets import load_radio

TRUTH = Truth(20.0, 2.75, 0.5, 5.0, 0.06, -93.5)


def log_of(truth, seed, packets=1500, rssi=True):
    distance_m, delivered, rssi_dbm = drawn(truth, packets, seed)
    unheard = np.full(packets, np.nan)
    return FlightLog(distance_m, delivered, np.full(packets, 40.0), rssi_dbm if rssi else unheard)


@pytest.fixture(scope="module")
def fit():
    return fit_radio(log_of(TRUTH, (5, 0)), load_radio("corrected"))


def test_correlated_shadowing_is_seen_and_found(fit):
    assert fit.correlated
    assert fit.goodness.independent_at_first < DEPENDENT
    assert fit.goodness.independence > DEPENDENT
    by_name = {each.name: each for each in fit.estimates}
    for name, truth in TRUTH.by_name.items():
        assert by_name[name].low <= truth <= by_name[name].high, by_name[name]
    assert by_name["shadowing.decorrelation_m"].high < 300.0
    assert by_name["noise.floor_dbm"].high - by_name["noise.floor_dbm"].low < 1.5


def test_the_level_amid_the_log_is_known_better_than_the_one_at_a_metre(fit):
    by_name = {each.name: each for each in fit.estimates}
    assert fit.level.low_dbm <= TRUTH.mean_dbm(fit.level.distance_m) <= fit.level.high_dbm
    offset = by_name["offset_db"]
    assert fit.level.high_dbm - fit.level.low_dbm < 0.5 * (offset.high - offset.low)
    assert fit.correlations["offset_db"]["propagation.exponent"] > 0.95


def test_the_written_radio_has_the_correlation(fit):
    radio = fitted_radio(fit, load_radio("corrected"), "mine")
    assert radio.shadowing.model == "gudmundson"
    assert radio.shadowing.decorrelation_m == fit.overrides["shadowing"]["decorrelation_m"]


STEEP = ParameterSet(
    "corrected",
    {"propagation": {"exponent": 3.5}, "shadowing": {"sigma_db": 3.0}, "base_loss": 0.05},
    rssi=True,
)


UNREAD = replace(STEEP, rssi=False)


def test_independent_packets_are_fitted_as_before_from_a_correlated_radio_too():
    log = synthetic_log(STEEP, 1500, (9, 0))
    gudmundson = {"shadowing": {"model": "gudmundson", "sigma_db": 6.0, "decorrelation_m": 30.0}}
    one = fit_radio(log, load_radio("corrected"))
    other = fit_radio(log, load_radio("corrected", gudmundson))
    assert not one.correlated
    assert not other.correlated
    assert one.estimates == other.estimates
    assert min(one.goodness.independence, one.goodness.readings, one.goodness.deliveries) > 1e-3
    assert fitted_radio(other, load_radio("corrected", gudmundson), "mine").shadowing.model == "normal"
    level = one.level
    radio = Radio(load_radio("corrected", STEEP.values))
    assert level.low_dbm <= float(radio.link(level.distance_m).received_power_dbm) <= level.high_dbm
    assert level.high_dbm - level.low_dbm < 1.0


def test_a_law_that_does_not_hold_is_told_by_the_goodness():
    """At the true parameters: the law as drawn; shadowing of two humps; losses near by that are not in the law."""
    log = synthetic_log(STEEP, 2000, (9, 1))
    rng = np.random.Generator(np.random.PCG64(1))
    humps = replace(log, rssi_dbm=log.rssi_dbm + np.where(rng.uniform(size=2000) < 0.5, 3.0, -3.0))
    near = log.distance_m < np.quantile(log.distance_m, 0.2)
    lossy = replace(log, delivered=log.delivered & ~(near & (rng.uniform(size=2000) < 0.2)))
    chances = []
    for each in (log, humps, lossy):
        likelihood = Likelihood(each, STEEP.truth)
        chances.append(readings_and_deliveries(likelihood, likelihood.point(likelihood.base_values)))
    assert min(chances[0]) > 1e-2
    assert chances[1][0] < 1e-4
    assert chances[2][1] < 1e-4


@pytest.mark.parametrize(
    ("base", "rssi", "says"), [("corrected", False, "log RSSI"), ("moon2020", True, "one-sided")]
)
def test_what_cannot_be_said_of_dependent_packets_is_not_said(base, rssi, says):
    held = ["propagation.exponent"]
    radio = load_radio(
        base,
        {
            "propagation": {"exponent": TRUTH.exponent},
            "noise": {"model": "fixed", "floor_dbm": TRUTH.floor_dbm},
        },
    )
    fit = fit_radio(log_of(TRUTH, (5, 1), 800, rssi), radio, held)
    by_name = {each.name: each for each in fit.estimates}
    for name in ("offset_db", "shadowing.sigma_db", "base_loss"):
        assert by_name[name].value is None
        assert by_name[name].low == -np.inf
    assert says in by_name["base_loss"].note


GUDMUNDSON = ("shadowing.model=gudmundson", "shadowing.sigma_db=6", "shadowing.decorrelation_m=20")


def written_from(file, log, settings=()):
    """What the command prints of a log, as text and as JSON, and the radio that it writes."""
    rows = [
        f"{d!r},{int(ok)},{'' if np.isnan(r) else r}"
        for d, ok, r in zip(log.distance_m.tolist(), log.delivered, log.rssi_dbm.tolist(), strict=True)
    ]
    file.write_text("\n".join(["distance_m,delivered,rssi_dbm", *rows]))
    radio = file.with_suffix(".yaml")
    options = [word for setting in settings for word in ("--set", setting)]
    arguments = ["fit", str(file), "--radio", "corrected", "--out", str(radio), *options]
    text, report = (
        CliRunner().invoke(channel, [*arguments, *more], catch_exceptions=False).output
        for more in ([], ["--json"])
    )
    return text, json.loads(report), load_radio(radio)


@pytest.mark.parametrize("settings", [pytest.param((), marks=pytest.mark.slow), GUDMUNDSON])
@pytest.mark.parametrize("dependent", [pytest.param(True, marks=pytest.mark.slow), False])
def test_the_written_radio_is_the_printed_one_where_deliveries_determine_little(
    tmp_path, dependent, settings
):
    """Its power amid the log is the one of the first row, and of the log's packets as many arrive."""
    log = log_of(TRUTH, (5, 1), rssi=False) if dependent else synthetic_log(UNREAD, 1500, (9, 2))
    text, report, written = written_from(tmp_path / "flight.csv", log, settings)
    by_name = {each["name"]: each for each in report["estimates"]}
    assert by_name["propagation.exponent"]["value"] is None
    assert (report["goodness"]["independent_at_first"] < DEPENDENT) is dependent
    level = report["level"]
    printed = next(row for row in text.splitlines() if row.startswith("dBm at"))
    radio = Radio(written)
    power_dbm = float(radio.link(level["distance_m"]).received_power_dbm)
    assert power_dbm == pytest.approx(level["value_dbm"], abs=1e-6)
    assert float(printed.split()[4]) == pytest.approx(power_dbm, abs=0.005)
    assert printed.endswith("the fitted radio's")
    arrives = float(np.mean(radio.probability_of_delivery(log.distance_m)))
    assert arrives == pytest.approx(np.mean(log.delivered), abs=0.005)
    kept = dependent and bool(settings)
    assert written.shadowing.model == ("gudmundson" if kept else "normal")
    assert written.shadowing.decorrelation_m == (20.0 if kept else None)


def test_packets_that_depend_on_each_other_have_no_verdict_of_tests_for_independent_ones(tmp_path):
    text, report, _ = written_from(tmp_path / "flight.csv", log_of(TRUTH, (5, 1), rssi=False))
    chances = report["goodness"]
    assert chances.pop("independent_at_first") < DEPENDENT
    assert set(chances.values()) == {None}
    assert "packets depend on each other (chance of independence" in text
    assert "deliveries " not in text


@pytest.mark.slow
def test_shadowing_that_is_not_a_matter_of_distance_is_told():
    """Three legs over the same distances in three directions, each with shadowing of its own."""
    legs = [log_of(replace(TRUTH, decorrelation_m=30.0), (6, k), 400) for k in range(3)]
    columns = [
        np.concatenate([getattr(leg, name) for leg in legs])
        for name in ("distance_m", "delivered", "length_bytes", "rssi_dbm")
    ]
    mixed = fit_radio(FlightLog(*columns), load_radio("corrected"))
    assert all(each.value is None for each in mixed.estimates)
    assert "distances" in mixed.estimates[0].note
    apart = fit_radio(FlightLog(*columns, np.repeat(np.arange(3), 400)), load_radio("corrected"))
    by_name = {each.name: each for each in apart.estimates}
    truth = TRUTH.by_name | {"shadowing.decorrelation_m": 30.0}
    assert sum(by_name[name].low <= value <= by_name[name].high for name, value in truth.items()) >= 5


def test_what_is_known_is_held():
    base = load_radio(
        "corrected", {"propagation": {"exponent": TRUTH.exponent}, "base_loss": TRUTH.base_loss}
    )
    fit = fit_radio(log_of(TRUTH, (5, 2), 800), base, ["propagation.exponent", "base_loss"])
    by_name = {each.name: each for each in fit.estimates}
    assert by_name["propagation.exponent"].value is None
    assert fit.overrides["propagation"]["exponent"] == TRUTH.exponent
    assert fit.overrides["base_loss"] == pytest.approx(TRUTH.base_loss)
    width = by_name["offset_db"].high - by_name["offset_db"].low
    assert width == pytest.approx(fit.level.high_dbm - fit.level.low_dbm)


def test_a_decorrelation_distance_that_is_held_has_to_be_known():
    log, name = log_of(TRUTH, (5, 4), 600), "shadowing.decorrelation_m"
    with pytest.raises(ChannelInputError, match=r"shadowing\.model"):
        fit_radio(log, load_radio("corrected"), [name])
    known = {"shadowing": {"model": "gudmundson", "sigma_db": 6.0, "decorrelation_m": TRUTH.decorrelation_m}}
    fit = fit_radio(log, load_radio("corrected", known), [name])
    sigma = next(each for each in fit.estimates if each.name == "shadowing.sigma_db")
    assert fit.overrides["shadowing"]["decorrelation_m"] == pytest.approx(TRUTH.decorrelation_m)
    assert sigma.low <= TRUTH.sigma_db <= sigma.high < 8.0


def test_the_command_says_it(tmp_path):
    log = log_of(TRUTH, (5, 3), 600)
    rows = [
        f"{d:.3f},{int(ok)},{'' if np.isnan(r) else r}"
        for d, ok, r in zip(log.distance_m, log.delivered, log.rssi_dbm, strict=True)
    ]
    file = tmp_path / "flight.csv"
    file.write_text("\n".join(["distance_m,delivered,rssi_dbm", *rows]))
    arguments = ["fit", str(file), "--radio", "corrected"]
    text = CliRunner().invoke(channel, arguments, catch_exceptions=False).output
    assert "correlated along the track" in text
    assert "shadowing.decorrelation_m" in text
    report = json.loads(CliRunner().invoke(channel, [*arguments, "--json"], catch_exceptions=False).output)
    assert report["correlated"] is True
    assert report["level"]["distance_m"] > 10.0
    assert set(report["goodness"]) == {"independence", "readings", "deliveries", "independent_at_first"}


@pytest.mark.slow
def test_the_benchmark_runs(capsys):
    main(["--correlated", "--repeats", "2", "--packets", "500", "--only", "25 m, exact"])
    out = capsys.readouterr().out
    assert "taken for correlated 2" in out
    assert out.count("25 m, exact") == 8


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_intervals_of_correlated_logs_hold_the_truth():
    """Of truths that the documented table does not have."""
    truths = [replace(TRUTH, decorrelation_m=metres) for metres in (10.0, 25.0, 50.0)]
    held = total = 0
    for truth in truths:
        for repeat in range(20):
            fit = fit_radio(log_of(truth, (7, repeat)), load_radio("corrected"))
            by_name = {each.name: each for each in fit.estimates}
            held += sum(
                by_name[name].low <= value <= by_name[name].high for name, value in truth.by_name.items()
            )
            total += len(truth.by_name)
    assert held >= 0.93 * total


def test_a_short_leg_whose_readings_rise_has_an_exponent_that_a_law_may_have():
    """Shadowing of 6 dB over 60 m beside 3 dB that the law falls by over 200 m: the likeliest line rises."""
    rng = np.random.Generator(np.random.PCG64(4))
    metres, exponent = np.linspace(600.0, 800.0, 400), 2.2
    shadow_db, rho = [6.0 * rng.standard_normal()], np.exp(-0.5 / 60.0)
    for fresh in rng.standard_normal(399):
        shadow_db.append(rho * shadow_db[-1] + 6.0 * np.sqrt(1.0 - rho * rho) * fresh)
    rssi_dbm = np.round(-20.0 - 10.0 * exponent * np.log10(metres) + np.array(shadow_db))
    assert np.polyfit(np.log10(metres), rssi_dbm, 1)[0] > 30.0
    log = FlightLog(metres, np.ones(400), np.full(400, 40.0), rssi_dbm)
    base = load_radio("corrected")
    fit = fit_radio(log, base)
    assert fit.correlated
    found = next(each for each in fit.estimates if each.name == "propagation.exponent")
    assert found.low == 0.0
    assert found.low <= found.value < exponent < found.high
    assert fitted_radio(fit, base, "mine").propagation.exponent == pytest.approx(found.value)
