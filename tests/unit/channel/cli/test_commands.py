import json
import math

import pytest
from click.testing import CliRunner

from channel.cli.commands import main
from channel.link.radio import Radio
from channel.presets import load_radio


def run(*arguments):
    return CliRunner().invoke(main, arguments)


def test_link_as_json_has_the_budget_and_what_follows():
    report = json.loads(run("link", "--radio", "moon2020", "--ground-distance", "400", "--json").output)
    assert report["received_power_dbm"] == pytest.approx(-329.7425, abs=1e-3)
    assert sum(term["contribution"] for term in report["terms"]) == pytest.approx(
        report["received_power_dbm"]
    )
    assert report["path_loss_db"] == pytest.approx(352.3425, abs=1e-3)
    assert report["snr_db"] == pytest.approx(10.2575, abs=1e-3)
    assert report["probability_of_delivery"] == pytest.approx(0.642, abs=0.002)
    assert 0.0 < report["ber"] < report["per"] < 1.0


def test_link_for_people_names_every_term():
    text = run("link", "--ground-distance", "400").output
    for word in ("transmit_power_dbm", "path_loss_db", "-107.0062", "snr_db", "ber", "per", "0.376"):
        assert word in text


def test_link_tells_what_outages_take_besides():
    """Each end's line is up for 0.8 of the time."""
    link = ("link", "--radio", "lte-uav", "--ground-distance", "400")
    outages = ("--set", "medium.good_s=4", "--set", "medium.bad_s=1")
    assert json.loads(run(*link, *outages, "--json").output)["outage_share"] == pytest.approx(0.36)
    assert "outages of the medium take 36 % of packets besides" in run(*link, *outages).output
    assert "outages of the medium" not in run(*link, "--set", "medium.bad_s=0").output


def test_any_key_can_be_set():
    report = json.loads(
        run(
            "link",
            "--radio",
            "moon2020",
            "--ground-distance",
            "400",
            "--json",
            "--set",
            "propagation.exponent=9",
            "--set",
            "offset_db=-90",
        ).output
    )
    table3 = json.loads(
        run("link", "--radio", "moon2020-table3", "--ground-distance", "400", "--json").output
    )
    assert report["received_power_dbm"] == table3["received_power_dbm"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--ground-distance", "-4"), ("ground_distance_m", "-4", ">= 0")),
        (("--ground-distance", "nan"), ("distance_m", "nan")),
        (("--ground-distance", "4", "--radio", "moon"), ("moon", "moon2020")),
        (("--ground-distance", "4", "--set", "propagation.exponent=x"), ("propagation.exponent", "'x'")),
        (("--ground-distance", "4", "--frequency-hz", "-1"), ("frequency_hz", "-1")),
        (("--ground-distance", "4", "--height-tx", "-9"), ("height_tx_m", "-9")),
    ],
)
def test_mistakes_are_one_line_and_exit_code_two(arguments, words):
    result = run("link", *arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output
    assert all(word in result.output for word in words)


def test_sweep_is_a_csv_and_a_plot(tmp_path):
    plot = tmp_path / "sweep.png"
    output = run("link", "--sweep", "distance", "50:1000:10", "--plot", str(plot)).output
    lines = output.splitlines()
    assert lines[0].startswith("distance,path_loss_db,received_power_dbm")
    assert len(lines) == 1 + 96
    assert [line.split(",")[0] for line in (lines[1], lines[-1])] == ["50", "1000"]
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_sweep_of_a_key_of_the_radio():
    base = ("link", "--radio", "moon2020", "--ground-distance", "400", "--json")
    rows = json.loads(run(*base, "--sweep", "propagation.exponent", "9:12:1").output)
    assert [row["propagation.exponent"] for row in rows] == [9.0, 10.0, 11.0, 12.0]
    assert rows[-1]["path_loss_db"] == pytest.approx(352.3425, abs=1e-3)


@pytest.mark.parametrize("text", ["1:2", "1:2:0", "1:2:-1", "a:b:c", "1:inf:1", "0:1e9:1"])
def test_sweeps_that_are_none(text):
    result = run("link", "--sweep", "distance", text)
    assert result.exit_code == 2
    assert "sweep" in result.output


def test_distance_is_needed():
    assert run("link").exit_code == 2


def test_radios_are_listed_with_their_ranges():
    rows = {row["name"]: row for row in json.loads(run("radios", "--json").output)}
    assert set(rows) >= {"moon2020", "lte-like", "subt"}
    assert rows["moon2020"]["range_50_m"] == pytest.approx(411.5, abs=2.0)
    assert rows["moon2020"]["range_90_m"] == pytest.approx(366.0, abs=2.0)
    assert rows["disk"]["range_50_m"] == pytest.approx(400.0, abs=1.5)
    assert rows["perfect"]["range_50_m"] is None
    assert "moon2020" in run("radios").output


def test_reference_row_through_the_command_line():
    """One row of the reference data: the way is slant, the distance over the ground."""
    base = ("link", "--radio", "perfect", "--json", "--frequency-hz", "900e6", "--height-rx", "1.5")
    two_ray = run(
        *base, "--ground-distance", "30", "--height-tx", "50", "--set", "propagation.model=two-slope"
    )
    assert json.loads(two_ray.output)["path_loss_db"] == pytest.approx(66.654473, abs=1e-4)
    hata = ["propagation.model=okumura-hata", "propagation.environment=open", "propagation.coefficients=ns3"]
    options = [part for setting in hata for part in ("--set", setting)]
    row = run(*base, "--ground-distance", "2000", "--height-tx", "30", *options)
    assert json.loads(row.stdout)["path_loss_db"] == pytest.approx(109.200364, abs=1e-4)


def test_validity_is_an_error_of_one_line_or_a_warning_on_stderr():
    outside = ("link", "--ground-distance", "400", "--set", "propagation.model=okumura-hata")
    refused = run(*outside)
    assert refused.exit_code == 2
    assert "frequency_hz = 2412000000.0: allowed is 1.5e+08 to 1.5e+09" in refused.stderr
    result = run(*outside, "--set", "propagation.outside=warn")
    assert result.exit_code == 0
    assert "warning: frequency_hz = 2.412e+09: outside" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("link", "--sweep", "distance", "50:60:10", "--plot", "no/x.png"), "cannot write"),
        (("link", "--sweep", "distance", "50:60:10", "--plot", "x.foo"), "x.foo: Format 'foo'"),
        (("link", "--ground-distance", "50", "--plot", "x.png"), "needs --sweep"),
        (("figures", "--out", "file.csv/figures"), "cannot write file.csv"),
        (("fit", "file.csv", "--radio", "moon2020", "--plot", "x.foo"), "x.foo: Format 'foo'"),
    ],
)
def test_files_that_cannot_be_written_are_one_line(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    rows = [
        f"{1e9 * (10 + k)},{k % 3 // 2}" for k in range(40)
    ]  # so far off that bins by number fill the memory
    (tmp_path / "file.csv").write_text("\n".join(["distance_m,delivered", *rows]))
    result = run(*arguments)
    assert result.exit_code == 2
    assert words in result.output


def test_the_distance_says_which_and_its_old_name_goes_on_unsaid():
    with_heights = ("--height-tx", "300", "--json")
    said, old = (
        json.loads(run("link", name, "400", *with_heights).output)
        for name in ("--ground-distance", "--distance")
    )
    assert said == old
    assert said["slant_distance_m"] == pytest.approx(math.hypot(400.0, 260.0))
    assert "--distance" not in run("link", "--help").output.replace("--ground-distance", "")


def test_help_says_where_the_receiver_lies():
    assert "The receiver lies north of the transmitter" in " ".join(run("link", "--help").output.split())


@pytest.mark.parametrize("name", ["moon2020", "disk", "satellite"])
def test_longer_packets_come_as_far_with_the_radios_that_help_names(name):
    assert f"({name})" in run("radios", "--help").output
    radio, away_m = Radio(load_radio(name)), [10.0**power for power in range(1, 6)]
    short, long = (
        radio.delivery(ground_distance_m=away_m, length_bytes=length).probability for length in (40, 400)
    )
    assert short.tolist() == long.tolist()
