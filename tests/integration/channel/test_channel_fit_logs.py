"""From the logs of two ends of a flight to a radio that a scenario flies with."""

import json
import struct

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bridge.scenario.file import SCENARIOS, ScenarioError, parse_scenario
from bridge.scenario.resolve.radio import radio_of
from channel import presets
from channel.link.radio import Radio
from lostlink.cli.main import lostlink

TRUTH = {
    "propagation": {"exponent": 2.9},
    "shadowing": {"sigma_db": 5.0},
    "base_loss": 0.08,
    "noise": {"model": "fixed", "floor_dbm": -97.0},
}
METRES_PER_DEGREE = np.pi / 180.0 * 6_371_008.8
RATE_HZ = 25.0
PACKETS = 3000


@pytest.fixture
def logs(tmp_path):
    """Logs of a flight out and back to 900 m, its fates drawn from a radio: the receiver's and the sender's."""
    rng = np.random.Generator(np.random.PCG64(11))
    radio = Radio(presets.load_radio("corrected", TRUTH))
    time_s = 50.0 + np.arange(PACKETS) / RATE_HZ
    distance_m = 40.0 + 860.0 * (1.0 - np.abs(np.linspace(-1.0, 1.0, PACKETS)))
    autopilot = mavlink.MAVLink(None, srcSystem=4, srcComponent=1)
    modem = mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
    frames = []
    for t, metres in zip(time_s, distance_m, strict=True):
        place = round((47.0 + metres / METRES_PER_DEGREE) * 1e7), round(8.0 * 1e7), 500_000
        message = mavlink.MAVLink_global_position_int_message(round(t * 1e3), *place, 0, 1, 2, 3, 4)
        frames.append(bytes(message.pack(autopilot)))
        autopilot.seq = (autopilot.seq + 1) % 256
    power = radio.mean_power_dbm(radio.path(distance_m)) + 5.0 * rng.standard_normal(PACKETS)
    length = float(len(frames[0]))
    arrived = rng.uniform(size=PACKETS) > radio.per(power - radio.noise_floor_dbm, length)
    arrived &= rng.uniform(size=PACKETS) > 0.08
    arrived[:2] = True
    received = []
    for k in np.flatnonzero(arrived):
        received.append((1.7e9 + time_s[k], frames[k]))
        rssi = round((power[k] + 127.0) * 1.9)
        status = mavlink.MAVLink_radio_status_message(min(max(rssi, 1), 254), 0, 100, 40, 40, 0, 0)
        received.append((1.7e9 + time_s[k] + 1e-3, bytes(status.pack(modem))))
    sent = [(t, frame) for t, frame in zip(time_s, frames, strict=True)]
    for name, entries in (("ground.tlog", received), ("ua.tlog", sent)):
        data = b"".join(struct.pack(">Q", round(t * 1e6)) + frame for t, frame in entries)
        (tmp_path / name).write_bytes(data)
    return tmp_path


def test_a_pair_of_tlogs_gives_the_radio_back_and_a_scenario_takes_it(logs):
    mine = logs / "mine.yaml"
    arguments = ["fit", str(logs / "ground.tlog"), str(logs / "ua.tlog"), "--receiver-at", "47,8,500"]
    options = ["--radio", "corrected", "--out", str(mine), "--json"]
    result = CliRunner().invoke(lostlink, [*arguments, *options], catch_exceptions=False)
    report = json.loads(result.output)
    assert report["packets"] == pytest.approx(PACKETS, abs=3)
    truth = {
        "propagation.exponent": 2.9,
        "offset_db": 0.0,
        "shadowing.sigma_db": 5.0,
        "base_loss": 0.08,
        "noise.floor_dbm": -97.0,
    }
    for estimate in report["estimates"]:
        assert estimate["low"] <= truth[estimate["name"]] <= estimate["high"], estimate

    tree = yaml.safe_load((SCENARIOS / "separation.yaml").read_text(encoding="utf-8"))
    tree["radio"] = str(mine)
    flown = radio_of(parse_scenario(yaml.safe_dump(tree), "fitted"))
    assert flown.config == presets.load_radio(mine)
    assert flown.config.base_loss == pytest.approx(report["radio"]["base_loss"])
    curve = np.array([100.0, 400.0, 700.0])
    expected = Radio(presets.load_radio("corrected", TRUTH)).probability_of_delivery(curve)
    assert flown.probability_of_delivery(curve) == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["ground.tlog"], "ground.tlog: the sender's own log"),
        (["ground.tlog", "nothing.tlog"], "nothing.tlog: No such file"),
        (["ground.tlog", "ua.tlog"], "where the receiver stood"),
        (["ground.tlog", "ua.tlog", "--receiver-at", "47,8"], "three numbers"),
        (["ground.tlog", "ua.tlog", "--receiver-at", "97,8,0"], "degrees within"),
        (["ua.tlog", "ua.tlog", "--receiver-at", "47,8,500"], "packets arrived"),
    ],
)
def test_mistakes_are_one_line_and_status_2(logs, monkeypatch, arguments, says):
    monkeypatch.chdir(logs)
    result = CliRunner().invoke(lostlink, ["fit", *arguments, "--radio", "corrected"])
    assert result.exit_code == 2
    assert says in result.output
    assert "Traceback" not in result.output


def test_a_scenario_refuses_a_radio_file_that_is_none(tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("preset: corrected\npropagation: {exponent: -3}\n")
    text = (SCENARIOS / "separation.yaml").read_text(encoding="utf-8")
    with pytest.raises(
        ScenarioError, match=r"bad\.yaml:2: propagation\.exponent.*named at mission\.yaml:16: radio"
    ):
        parse_scenario(text.replace("radio: hata-qpsk", f"radio: {bad}"), "mission.yaml")
