import json

import pytest
from click.testing import CliRunner

from channel.cli import main


def run(*arguments):
    return CliRunner().invoke(main, arguments)


def test_link_as_json_has_the_budget_and_what_follows():
    report = json.loads(run("link", "--radio", "moon2020", "--distance", "400", "--json").output)
    assert report["received_power_dbm"] == pytest.approx(-329.7425, abs=1e-3)
    assert sum(term["contribution"] for term in report["terms"]) == pytest.approx(
        report["received_power_dbm"]
    )
    assert report["path_loss_db"] == pytest.approx(352.3425, abs=1e-3)
    assert report["snr_db"] == pytest.approx(10.2575, abs=1e-3)
    assert report["probability_of_delivery"] == pytest.approx(0.642, abs=0.002)
    assert 0.0 < report["ber"] < report["per"] < 1.0


def test_link_for_people_names_every_term():
    text = run("link", "--distance", "400").output
    for word in ("transmit_power_dbm", "path_loss_db", "received_power_dbm", "snr_db", "ber", "per", "0.642"):
        assert word in text


def test_any_key_can_be_set():
    report = json.loads(
        run(
            "link", "--distance", "400", "--json", "--set", "propagation.exponent=9", "--set", "offset_db=-90"
        ).output
    )
    table3 = json.loads(run("link", "--radio", "moon2020-table3", "--distance", "400", "--json").output)
    assert report["received_power_dbm"] == table3["received_power_dbm"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--distance", "-4"), ("ground_distance_m", "-4", ">= 0")),
        (("--distance", "nan"), ("distance_m", "nan")),
        (("--distance", "4", "--radio", "moon"), ("moon", "moon2020")),
        (("--distance", "4", "--set", "propagation.exponent=x"), ("propagation.exponent", "'x'")),
        (("--distance", "4", "--frequency-hz", "-1"), ("frequency_hz", "-1")),
        (("--distance", "4", "--height-tx", "-9"), ("height_tx_m", "-9")),
    ],
)
def test_mistakes_are_one_line_and_exit_code_two(arguments, words):
    result = run("link", *arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output
    assert all(word in result.output for word in words)
