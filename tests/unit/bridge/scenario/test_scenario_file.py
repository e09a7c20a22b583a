"""Scenario files: what ships is right, and every mistake is named with file, line, key and what is allowed."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from bridge.scenario.agents import OwnAgent
from bridge.scenario.document.settings import parse_setting
from bridge.scenario.file import (
    DEFAULT_SCENARIO,
    SCENARIOS,
    ScenarioError,
    parse_scenario,
    read_scenario,
    scenario_names,
    with_changes,
)
from bridge.scenario.resolve.flight import airframe_of, wind_of
from bridge.scenario.resolve.radio import radio_of
from channel.medium.medium import Medium

TEXT = (SCENARIOS / "separation.yaml").read_text(encoding="utf-8")


def line_of(word: str, text: str) -> int:
    return next(i for i, line in enumerate(text.splitlines(), 1) if word in line)


@pytest.mark.parametrize("name", scenario_names())
def test_shipped_scenario_reads_and_survives_its_own_yaml(name: str) -> None:
    scenario = read_scenario(name)
    assert parse_scenario(scenario.to_yaml(), "again") == scenario


@pytest.mark.parametrize(
    ("old", "new", "key", "says"),
    [
        ("seed: 1", "sead: 1", "sead", "unknown key; did you mean seed? (allowed here: schema, name"),
        ("speed: max", "speed: fast", "speed", "'max' or a real-time factor from 0.1 to 1e+06 (got 'fast')"),
        ("speed: max", "speed: 1.0e+300", "speed", "real-time factor from 0.1 to 1e+06 (got 1e+300)"),
        ("speed: max", "speed: 0.01", "speed", "from 0.1 to"),
        ("lat_deg: 40.1331", "lat_deg: 400", "origin.lat_deg", "less than or equal to 90 (got 400)"),
        ("tick_rate_hz: 20", "tick_rate_hz: 3", "tick_rate_hz", "whole nanoseconds"),
        (
            "type: hold",
            "type: hang",
            "nodes.0.agent.type",
            "has to be one of: hold, out_and_back, still, free, own",
        ),
        (
            "altitude_m: 40}",
            "altitude_m: 40, speed: 2}",
            "nodes.0.agent.speed",
            "allowed here: isolated, type, altitude_m",
        ),
        ("north_m: 5", "nort_m: 5", "nodes.1.home.nort_m", "allowed here: north_m, east_m, heading_deg"),
        ("radio: hata-qpsk", "radio: moon2021", "radio", "did you mean moon2020?"),
        (
            "radio: hata-qpsk",
            "radio: {preset: moon2020, nose: {}}",
            "radio.nose",
            "unknown key; did you mean noise?",
        ),
        ("radio: hata-qpsk", "radio: 5", "radio", "name of a radio preset"),
        ("radio: hata-qpsk", "radio: hata-qpsk\nwind: storm", "wind", "no wind 'storm': known are"),
        ("seed: 1", "wind: {preset: gutsy}", "wind.preset", "no wind 'gutsy'; did you mean gusty?"),
        ("seed: 1", "wind: {constant: {sped_mps: 3}}", "wind.constant.sped_mps", "did you mean speed_mps?"),
        ("seed: 1", "wind: {gusts: [{speed_mps: 3}]}", "wind.gusts.0.start_s", "is required"),
        ("seed: 1", "wind: 5", "wind", "name of a wind, a YAML file, or a mapping"),
        (
            "seed: 1",
            "fdm: {workers: none}",
            "fdm.workers",
            "'auto' or a number of processes, at least 1 (got 'none')",
        ),
        ("seed: 1", "fdm: {workers: 0}", "fdm.workers", "at least 1 (got 0)"),
        (
            "seed: 1",
            "fdm: {wrkers: 2}",
            "fdm.wrkers",
            "allowed here: workers, coupling, scheme, legacy_rate_hz, standin_rate_hz, sensor_noise",
        ),
        ("seed: 1", "fdm: {coupling: both}", "fdm.coupling", "'serial' or 'parallel' (got 'both')"),
        (
            "autopilot: standin",
            "autopilot: external\nfdm: {scheme: legacy, coupling: parallel}",
            "fdm.coupling",
            "parallel needs scheme json",
        ),
        ("seed: 1", "fdm: {scheme: gazebo}", "fdm.scheme", "'json' or 'legacy' (got 'gazebo')"),
        (
            "seed: 1",
            "fdm: {scheme: legacy}",
            "fdm.scheme",
            "is for autopilot: external; the others speak json only",
        ),
        ("seed: 1", "fdm: {scheme: legacy, legacy_rate_hz: 5}", "fdm.legacy_rate_hz", "10 (got 5)"),
        ("seed: 1", "fdm: {standin_rate_hz: 50}", "fdm.standin_rate_hz", "100 (got 50)"),
        (
            "seed: 1",
            "fdm: {sensor_noise: {gyro: 1}}",
            "fdm.sensor_noise.gyro",
            "allowed here: gyro_sigma_radps, ",
        ),
        (
            "seed: 1",
            "fdm: {sensor_noise: {position_sigma_m: -1}}",
            "fdm.sensor_noise.position_sigma_m",
            "got -1",
        ),
        ("seed: 1", "weather: {qnh_hpa: 29.92}", "weather.qnh_hpa", "850 (got 29.92)"),
        (
            "seed: 1",
            "weather: {temperature: 3}",
            "weather.temperature",
            "allowed here: temperature_offset_k, ",
        ),
        ("seed: 1", "weather: {temperature_offset_k: 3, ground_temperature_c: 3}", "weather", "not both"),
        ("schema: 1", "schema: 2", "schema", "has to be 1 (got 2)"),
        ("seed: 1", "seed: 1\nseed: 2", "seed", "given twice"),
        ("duration_s: 600 ", "duration_s: .inf ", "duration_s", "finite"),
        ("duration_s: 600 ", "duration_s: true ", "duration_s", "has to be a number (got true)"),
        ("north_m: 5", "north_m: yes", "nodes.1.home.north_m", "has to be a number (got true)"),
        ("seed: 1", "take_off_at_s: off", "take_off_at_s", "has to be a number (got false)"),
        ("seed: 1", "lookahead_ticks: true", "lookahead_ticks", "has to be 0 or 1 (got true)"),
        ("seed: 1", "weather: {qnh_hpa: true}", "weather.qnh_hpa", "has to be a number (got true)"),
        ("seed: 1", "wind: {constant: {speed_mps: true}}", "wind.constant.speed_mps", "a number (got true)"),
        ("seed: 1", "fdm: {px4: {gps_vertical_sigma_m: true}}", "fdm.px4.gps_vertical_sigma_m", "(got true)"),
        ("seed: 1", "seed: true", "seed", "has to be a whole number (got true)"),
        ("seed: 1", "se[d: 1", "se[d", "unknown key; did you mean seed?"),
        ("seed: 1", "int: 1", "int", "unknown key; allowed here: schema, "),
        ("north_m: 5", "'nor[h_m': 5", "nodes.1.home.nor[h_m", "unknown key; did you mean north_m?"),
    ],
)
def test_mistake_is_named_with_line_and_key(old: str, new: str, key: str, says: str) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text, "mine.yaml")
    line = line_of(new.splitlines()[-1], text)
    assert f"mine.yaml:{line}: {key}: " in str(caught.value)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    "expectation",
    [
        "{type: separation, at_least_m: 50, at_most_m: 35}",
        "{type: delivery, at_least: 0.9, at_most: 0.5}",
        "{type: logged, value: error_m, at_least: 8, at_most: 3}",
        "{type: function, function: mine.py:ticks, at_least: 8, at_most: 3}",
    ],
)
def test_bounds_that_nothing_is_between_are_refused(expectation: str) -> None:
    said = r"x:\d+: expectations\.0\.at_most(_m)?: [\d.]+ is below at_least(_m)?, [\d.]+: nothing is both$"
    with pytest.raises(ScenarioError, match=said):
        parse_scenario(f"{TEXT}\nexpectations:\n  - {expectation}\n", "x")


def test_unknown_airframe_is_named_with_the_known_ones() -> None:
    said = (
        r"x:\d+: nodes\.0\.airframe: unknown airframe 'f451'; did you mean f450\? Known are aerosonde, f450"
    )
    with pytest.raises(ScenarioError, match=said):
        parse_scenario(TEXT.replace("airframe: f450", "airframe: f451", 1), "x")


def at_latitude(lat_deg: float, nodes: str) -> str:
    return f"""schema: 1
name: far
duration_s: 9
origin: {{lat_deg: {lat_deg}, lon_deg: 20.0, alt_amsl_m: 0.0}}
radio: disk
nodes:
{nodes}
"""


@pytest.mark.parametrize(
    ("lat_deg", "node", "key", "says"),
    [
        (
            90,
            "{id: 0, home: {north_m: 20}, agent: {type: still}}",
            "home",
            "20 m north of the origin, at 90 ",
        ),
        (-89.9999, "{id: 0, home: {north_m: -20}, agent: {type: still}}", "home", "-20 m north"),
        (90, "{id: g, kind: ground, place: {north_m: 1}, agent: {type: still}}", "place", "1 m north"),
        (
            90,
            "{id: g, kind: ground, agent: {type: still},\n"
            "     track: [{sim_time_s: 0}, {sim_time_s: 9, north_m: 3}]}",
            "track.1",
            "3 m north",
        ),
    ],
)
def test_a_place_beyond_a_pole_is_named(lat_deg: float, node: str, key: str, says: str) -> None:
    other = "  - {id: 7, home: {north_m: 0}, agent: {type: still}}\n"
    text = at_latitude(lat_deg, f"{other}  - {node}")
    line = line_of("north_m: " + says.split(" m")[0], text)
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text, "x")
    (told,) = str(caught.value).splitlines()
    assert told.startswith(f"x:{line}: nodes.{node[5]}.{key}.north_m: {says}")
    assert told.endswith("is beyond a pole")


def test_a_place_just_before_a_pole_is_taken() -> None:
    near = "  - {id: 0, home: {north_m: 11.1}, agent: {type: still}}"
    assert parse_scenario(at_latitude(89.9999, near), "x").ua[0].home.north_m == 11.1


def test_weather_at_a_height_without_formulas_is_named() -> None:
    high = at_latitude(10, "  - {id: 0, agent: {type: still}}").replace(
        "alt_amsl_m: 0.0", "alt_amsl_m: 11001"
    )
    assert parse_scenario(high, "x").origin.alt_amsl_m == 11001
    said = r"x:4: origin\.alt_amsl_m: weather: home is at 11001 m; .* from -2000 to 11000 m$"
    with pytest.raises(ScenarioError, match=said):
        parse_scenario(high + "weather: {qnh_hpa: 1000}\n", "x")


def test_missing_keys_are_all_named() -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario("schema: 1\nname: x\n", "x.yaml")
    assert {line.split(": ")[1] for line in str(caught.value).splitlines()} == {
        "duration_s",
        "origin",
        "radio",
        "nodes",
    }


def test_id_used_twice() -> None:
    with pytest.raises(ScenarioError, match="id 0 is used more than once"):
        parse_scenario(TEXT.replace("id: 1", "id: 0"), "x")


@pytest.mark.parametrize("text", ["", "[]", "a", "1: [", "? [a]: b", "a: &x [*x]", "\t", "{" * 500])
def test_what_is_no_scenario_is_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match=r"^x"):
        parse_scenario(text, "x")


def test_unknown_name_lists_the_known(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"no such file.*separation"):
        read_scenario(str(tmp_path / "nothing.yaml"))


def test_the_default_run_has_the_powers_of_a_receiver_and_its_link_breaks_on_the_way_out() -> None:
    radio = radio_of(read_scenario(DEFAULT_SCENARIO))
    link = radio.link([40.0, 400.0, 600.0])
    assert link.received_power_dbm == pytest.approx([-72.6, -107.0, -113.1], abs=0.1)
    assert link.noise_dbm == pytest.approx(-112.0, abs=0.1)  # k T B in 250 kHz, and 8 dB
    near, half_way, far = radio.probability_of_delivery([100.0, 350.0, 600.0], radio.length_bytes(340))
    assert (near > 0.999, 0.4 < half_way < 0.6, far < 0.1) == (True, True, True)


def test_in_the_default_run_a_packet_sent_again_from_the_same_place_meets_the_same_shadowing() -> None:
    medium = Medium(radio_of(read_scenario(DEFAULT_SCENARIO)), seed=1, nodes=("0", "1"))
    medium.place("0", (0, 0, -40))
    medium.place("1", (350, 0, -40))
    medium.send(medium.packets(tx="0", seq=range(20), length_bytes=40))
    assert np.ptp(medium.settle().received_power_dbm) == 0.0


def test_changes_of_the_command_line_are_checked_too() -> None:
    scenario = read_scenario("separation")
    changed = with_changes(scenario, {"seed": 7, "ports.first_slot": 3})
    assert (changed.seed, changed.ports.first_slot) == (7, 3)
    assert changed.fdm_port(changed.ua[1]) == 9002 + 10 * 4
    with pytest.raises(ScenarioError, match=r"duration_s: .*greater than 0"):
        with_changes(scenario, {"duration_s": -1.0})


@pytest.mark.parametrize(
    ("text", "key"),
    [('nodes.1.agent.options.x="\\ud800"', "nodes.1.agent.options.x"), ('name="a\\udc00"', "name")],
)
def test_a_text_that_utf8_cannot_encode_is_refused_with_key_and_value(text: str, key: str) -> None:
    setting = parse_setting(text)
    said = f"--set {text}: {key}: has to be text that UTF-8 can encode (got {setting.value!r})"
    with pytest.raises(ScenarioError) as caught:
        read_scenario("separation", [setting])
    assert str(caught.value) == said
    with pytest.raises(ScenarioError, match="that UTF-8 can encode"):
        with_changes(read_scenario("separation"), {key: setting.value})


def test_a_key_that_utf8_cannot_encode_is_refused_with_its_line() -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(f'{TEXT}\n"\\ud800": {{}}\n', "mine.yaml")
    line = len(TEXT.splitlines()) + 2
    assert str(caught.value) == (
        f"mine.yaml:{line}: \\ud800: has to be text that UTF-8 can encode (got '\\ud800')"
    )


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a file of each kind that a scenario can name; the process is in another one."""
    folder = tmp_path / "mission of 2026-11-21T12:00"
    folder.mkdir()
    (tmp_path / "start").mkdir()
    monkeypatch.chdir(tmp_path / "start")
    shipped = SCENARIOS / ".."
    (folder / "air.yaml").write_text("constant: {speed_mps: 3, from_deg: 90}\n")
    copytree(shipped / "airframes" / "jsbsim", folder / "jsbsim")
    (folder / "quad.yaml").write_text((shipped / "airframes" / "f450.yaml").read_text(encoding="utf-8"))
    (folder / "own.py").write_text("from lostlink import Agent\nclass Mine(Agent): ...\n")
    (folder / "mine.yaml").write_text("preset: moon2020\nbase_loss: 0.25\n")
    (folder / "loss.csv").write_text("snr_db,rate\n0,1\n20,0\n")
    return folder


def write_beside(folder: Path, radio: str) -> str:
    text = TEXT.replace("radio: hata-qpsk", f"radio: {radio}\nwind: air.yaml")
    text = text.replace("airframe: f450", "airframe: quad.yaml", 1)
    text = text.replace("{type: hold, altitude_m: 40}", "{type: own, class: own.py:Mine}")
    (folder / "mission.yaml").write_text(text)
    return str(folder / "mission.yaml")


@pytest.mark.parametrize("radio", ["mine.yaml", "{preset: mine.yaml}"])
def test_files_are_looked_for_beside_the_scenario(elsewhere: Path, radio: str) -> None:
    scenario = read_scenario(write_beside(elsewhere, radio))
    assert wind_of(scenario).constant is not None
    assert airframe_of(scenario.ua[0]).name == "f450"
    assert scenario.ua[0].agent == OwnAgent(type="own", class_=f"{elsewhere / 'own.py'}:Mine")
    assert radio_of(scenario).config.base_loss == 0.25
    assert parse_scenario(scenario.to_yaml(), "flown again") == scenario
    assert with_changes(scenario, {"seed": scenario.seed}) == scenario


def test_files_are_beside_the_link_that_a_scenario_is_reached_by(elsewhere: Path, tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    Path(write_beside(elsewhere, "mine.yaml")).rename(tmp_path / "far" / "mission.yaml")
    (elsewhere / "mission.yaml").symlink_to(tmp_path / "far" / "mission.yaml")
    assert wind_of(read_scenario(str(elsewhere / "mission.yaml"))).constant is not None


def test_mistakes_in_all_files_are_told_at_once(elsewhere: Path) -> None:
    radio = "\n  preset: moon2020\n  error:\n    model: snr-table\n    table_file: nothing.csv"
    path = write_beside(elsewhere, radio)
    for name in ("air.yaml", "own.py", "quad.yaml"):
        (elsewhere / name).unlink()
    with pytest.raises(ScenarioError) as raised:
        read_scenario(path)
    lines = str(raised.value).splitlines()
    text = Path(path).read_text()
    places = [line_of(word, text) for word in ("table_file:", "wind:", "airframe:", "class:")]
    assert [line.split(": ")[0] for line in lines] == [f"{path}:{place}" for place in places]


def test_a_table_is_looked_for_beside_the_scenario_and_kept_in_it(elsewhere: Path) -> None:
    radio = "{preset: moon2020, error: {model: snr-table, table_file: loss.csv}}"
    path = write_beside(elsewhere, radio)
    scenario = read_scenario(path)
    assert isinstance(scenario.radio, dict)
    assert scenario.radio["error"]["table"] == [[0.0, 1.0], [20.0, 0.0]]
    assert parse_scenario(scenario.to_yaml(), "flown again") == scenario
    (elsewhere / "loss.csv").unlink()
    with pytest.raises(
        ScenarioError, match=r"mission.yaml:16: radio.error.table_file: cannot read .*loss.csv"
    ):
        read_scenario(path)


LONG = "a" * 400 + ".yaml"
"""More than a name of a file can be: looking for it is an error, as in a folder that is another user's."""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("radio: hata-qpsk", f"radio: {LONG}"),
        ("radio: hata-qpsk", "radio: ~nobody-is-called-so/a.yaml"),
        ("radio: hata-qpsk", f"radio: hata-qpsk\nwind: {LONG}"),
        ("airframe: f450", f"airframe: {LONG}"),
        ("schema: 1", f"schema: 1\nextends: {LONG}"),
        ("schema: 1", "schema: 1\nextends: ~nobody-is-called-so/a.yaml"),
    ],
)
def test_files_that_cannot_be_looked_for_are_told_by_name(old: str, new: str) -> None:
    assert old in TEXT
    with pytest.raises(ScenarioError, match=r"^mine\.yaml:.*(a\.yaml|name too long)"):
        parse_scenario(TEXT.replace(old, new), "mine.yaml")
    with pytest.raises(ScenarioError, match=LONG):
        read_scenario(LONG)
