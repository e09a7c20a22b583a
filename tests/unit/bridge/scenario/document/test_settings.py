"""Single values of a scenario, changed by dotted key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bridge.bus.keys import ALL
from bridge.scenario.document.settings import Setting, parse_setting
from bridge.scenario.file import ScenarioError, parse_scenario, read_scenario, with_changes
from bridge.scenario.parts import RESERVED_ID
from bridge.scenario.resolve.flight import wind_of
from bridge.scenario.resolve.radio import radio_of

TEXT = """\
schema: 1
name: small
duration_s: 5
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: moon2020
nodes:
  - {id: 4, agent: {type: still}}
  - {id: 2, agent: {type: still}}
  - {id: mast.1, kind: ground, agent: {type: still}, track: [{sim_time_s: 0}, {sim_time_s: 9}]}
"""


def changed(*settings: str) -> Any:
    return parse_scenario(TEXT, "small.yaml", overrides=[parse_setting(text) for text in settings])


def refused(*settings: str) -> str:
    with pytest.raises(ScenarioError) as caught:
        changed(*settings)
    return str(caught.value)


def test_nodes_go_by_id_and_other_lists_by_index() -> None:
    it = changed("nodes.2.home.north_m=100", "nodes.mast.1.track.1.north_m=7", "seed=9")
    assert [ua.home.north_m for ua in it.ua] == [0.0, 100.0]
    assert [point.north_m for point in it.ground[0].track] == [0.0, 7.0]
    assert it.seed == 9


def test_a_key_that_is_there_may_have_dots() -> None:
    networks = "networks={wifi-2.4: wifi-2.4, wifi-2: wifi-5.8}"
    it = changed(networks, "networks.wifi-2.4.base_loss=0.1", "networks.wifi-2.base_loss=0.2")
    assert it.networks == {
        "wifi-2.4": {"preset": "wifi-2.4", "base_loss": 0.1},
        "wifi-2": {"preset": "wifi-5.8", "base_loss": 0.2},
    }
    assert list(changed(networks, "networks.wifi-2.4=null").networks) == ["wifi-2"]
    modem = changed(
        "networks={m.1: sik-433}", "nodes.2.modems={m.1: {baud: 9600}}", "nodes.2.modems.m.1.serial=2"
    )
    assert modem.node("2").modems["m.1"].serial == 2


def test_a_star_means_all_nodes_and_later_settings_win() -> None:
    it = changed("nodes.*.radio=disk", "nodes.2.radio=null", "radio.frequency_hz=2.4e9", "radio=disk")
    assert [node.radio for node in it.nodes] == ["disk", None, "disk"]
    assert it.radio == "disk"


def test_nodes_that_are_set_later_win_over_settings_of_single_nodes() -> None:
    nodes = "nodes=[{id: 2, agent: {type: still}}]"
    assert changed("nodes.2.home.north_m=5", nodes).ua[0].home.north_m == 0.0
    assert changed("nodes.4.home.north_m=5", nodes, "nodes.2.home.north_m=6").ua[0].home.north_m == 6.0


EMITTER = "  - {id: b, kind: emitter, frequency_hz: 433e+6, power_dbm: 20}\n"


def test_a_star_means_the_nodes_that_can_have_the_key() -> None:
    keys = (
        "nodes.*.agent.isolated=true",
        "nodes.*.home.north_m=3",
        "nodes.*.duty=0.5",
        "nodes.*.sensor.rate_hz=2",
        "nodes.*.radio=disk",
    )
    told = (*keys, "nodes.mast.1.track=null", "nodes.*.place.east_m=7")
    it = parse_scenario(TEXT + EMITTER, "small.yaml", overrides=[parse_setting(text) for text in told])
    assert [node.agent.isolated for node in (*it.ua, *it.ground)] == [True] * 3
    assert [ua.home.north_m for ua in it.ua] == [3.0, 3.0]
    assert [node.radio for node in (*it.ua, *it.ground)] == ["disk"] * 3
    assert [node.sensor and node.sensor.rate_hz for node in (*it.ua, *it.ground)] == [2.0] * 3
    assert [node.place and node.place.east_m for node in (*it.ground, *it.emitters)] == [7.0, 7.0]
    assert it.emitters[0].duty == 0.5
    assert with_changes(it, {"nodes.*.agent": {"type": "still"}}).ground[0].agent.type == "still"


def test_a_key_that_no_node_here_can_have_is_told_with_the_kinds_that_can() -> None:
    assert refused("nodes.*.duty=0.5") == (
        "--set nodes.*.duty=0.5: nodes.*.duty: no node here can have duty: it is a key of emitter nodes"
    )
    assert "nodes.*.agnt=3: nodes.4.agnt: unknown key; did you mean agent?" in refused("nodes.*.agnt=3")


def test_null_removes_what_is_there() -> None:
    it = changed("wind=breeze", "wind=null", "nodes.2.home.north_m=7", "nodes.2.home=null")
    assert (it.wind, it.ua[1].home.north_m) == ("calm", 0.0)
    assert changed("radio.base_loss=0.1", "radio.base_loss=null").radio == {"preset": "moon2020"}
    assert with_changes(it, {"lookahead_ticks": None}).lookahead_ticks == 0
    assert (
        refused("duration_s=null")
        == "small.yaml:9: duration_s: is required, and missing: add duration_s: 300, say"
    )


def test_a_value_below_a_radios_name_changes_that_radio() -> None:
    it = changed("radio.noise.floor_dbm=-330", "radio.bit_rate_bps=1e6")
    assert it.radio == {"preset": "moon2020", "noise": {"floor_dbm": -330}, "bit_rate_bps": 1e6}
    assert radio_of(it).config.noise.model_dump()["floor_dbm"] == -330


def test_a_wind_may_be_spelt_out_or_changed() -> None:
    it = changed("wind=breeze", "wind.constant.speed_mps=9")
    assert it.wind == {"preset": "breeze", "constant": {"speed_mps": 9}}
    constant = wind_of(it).constant
    assert constant is not None
    assert constant.speed_mps == 9
    assert parse_scenario(it.to_yaml(), "again") == it


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0),
        ("-2.4E+9", -2.4e9),
        (".5e-1", 0.05),
        ("[1e3, {a: 2e3}]", [1000.0, {"a": 2000.0}]),
        ("-inf", float("-inf")),
        ('"1"', "1"),
        ("'007'", "007"),
        ('"1e3"', "1e3"),
        ("1e3x", "1e3x"),
        ("12", 12),
    ],
)
def test_plain_numbers_are_numbers_and_what_is_quoted_stays_text(text: str, value: object) -> None:
    read = parse_setting(f"nodes.0.agent.options.leader={text}").value
    assert (read, type(read)) == (value, type(value))


def test_values_are_yaml_and_take_the_place_of_what_was_there() -> None:
    it = changed(
        "nodes.4.agent={type: out_and_back, altitude_m: 30, distance_m: 9}", "transmit.every_ticks=4"
    )
    assert it.ua[0].agent.type == "out_and_back"
    assert it.transmit.every_ticks == 4


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ("sead=3", "--set sead=3: sead: unknown key; did you mean seed?"),
        ("seed=x", "--set seed=x: seed: has to be a whole number (got 'x')"),
        (
            "nodes.2.agent.type=onw",
            "--set nodes.2.agent.type=onw: nodes.2.agent.type: has to be one of: hold, out_and_back, still, free, own",
        ),
        ("nodes.2.home.nort_m=3", "nodes.2.home.nort_m: unknown key; did you mean north_m?"),
        (
            "nodes.0.home.north_m=3",
            "nodes.0.home.north_m: no node has the id 0; there are: 4, 2, mast.1, and *",
        ),
        ("nodes.mast.1.track.2.north_m=7", "track is a list with 0 to 1; '2' is not one of its items"),
        ("name.first=3", "name is 'small', which has no keys"),
        (
            "radio=moon2021",
            "--set radio=moon2021: radio: no radio preset or YAML file 'moon2021'; did you mean",
        ),
        (
            "radio.nose.floor_dbm=3",
            "--set radio.nose.floor_dbm=3: radio.nose: unknown key; did you mean noise?",
        ),
        ("seed", "--set seed: has to be KEY=VALUE"),
        ("=3", "--set =3: has to be KEY=VALUE"),
        ("a..b=3", "has to be KEY=VALUE"),
        ("seed=[", "--set seed=[: seed: is not YAML: "),
        ("seed=010", "--set seed=010: seed: 010 is 8 in YAML, where it is octal: "),
    ],
)
def test_mistakes_are_told_under_the_option(setting: str, says: str) -> None:
    assert says in refused(setting)


def test_a_program_gives_values_by_key(tmp_path: Path) -> None:
    file = tmp_path / "small.yaml"
    file.write_text(TEXT)
    it = read_scenario(file, {"nodes.2.home.east_m": -3, "radio": {"preset": "disk", "max_range_m": 70}})
    assert it.ua[1].home.east_m == -3.0
    assert radio_of(it).config.max_range_m == 70
    with pytest.raises(ScenarioError, match=r"^override duration_s=-1: duration_s: has to be greater than 0"):
        read_scenario(file, {"duration_s": -1})
    with pytest.raises(ScenarioError, match=r"^override 3: a key has to be a text"):
        read_scenario(file, {3: 1})  # type: ignore[dict-item]


def test_files_of_a_setting_are_seen_from_its_own_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("preset: disk\nmax_range_m: 12\n")
    setting = Setting("radio", "mine.yaml", "--radio mine.yaml", tmp_path)
    assert parse_scenario(TEXT, "small.yaml", overrides=[setting]).radio == str(tmp_path / "mine.yaml")


def test_a_path_of_a_program_is_its_text(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("preset: disk\nmax_range_m: 12\n")
    assert parse_scenario(TEXT, "small.yaml", overrides={"radio": file}).radio == str(file)


def test_the_reserved_id_is_what_keys_have_for_everybody() -> None:
    assert RESERVED_ID == ALL
