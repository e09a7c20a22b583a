"""Sensors and emitters in a scenario: what they may say, which roles they have, and what becomes of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.fleet.hosts import host_groups
from bridge.scenario.file import ScenarioError, parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.ground_track import GroundTrack
from bridge.scenario.resolve.named_files import named_code
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of, sensors_of

BEACON = "{id: beacon, kind: emitter, place: {north_m: 7}, frequency_hz: 433.92e+6, power_dbm: 20}"
HEAD = """schema: 1
name: small
duration_s: 5
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: corrected
nodes:
"""


def scenario(*nodes: str, sensor: str = "{}", folder: Path = Path()) -> Scenario:
    all_nodes = [*nodes, f"{{id: 0, sensor: {sensor}, agent: {{type: still}}}}"]
    return parse_scenario(HEAD + "".join(f"  - {node}\n" for node in all_nodes), "small.yaml", folder)


def test_the_scenario_of_the_page_is_one() -> None:
    page = (Path(__file__).parents[4] / "docs" / "reference" / "sensing.md").read_text()
    it = parse_scenario(page.split("```yaml\n")[1].split("```")[0], "sensing.md")
    assert [each.name for each in emitters_of(it)] == ["beacon", "truck"]
    assert set(sensors_of(it)) == {"0", "1"}


def mistake(*nodes: str, sensor: str = "{}") -> str:
    with pytest.raises(ScenarioError) as caught:
        scenario(*nodes, sensor=sensor)
    return str(caught.value)


def test_an_emitter_is_a_station_and_nothing_else() -> None:
    it = scenario(BEACON, "{id: gcs, kind: ground, agent: {type: still}}")
    assert it.stations == ("gcs", "0", "beacon")
    assert it.transceiver_ids == ("gcs", "0")
    assert it.regulated == ("gcs", "0")
    assert not it.nodes_with_a_task
    assert set().union(*host_groups(it).values()) == {"gcs", "0"}
    assert it.title("beacon") == "node beacon"
    assert set(radios_of(it)) == {"gcs", "0"}
    assert GroundTrack(it, it.emitters[0]).at(0).position_ned_m == (7.0, 0.0, -2.0)


def test_what_is_read_back_is_the_same() -> None:
    it = scenario(
        BEACON,
        "{id: 7, kind: emitter, frequency_hz: 1.0e+9, power_dbm: 1, antenna: {model: dipole}, duty: 0.5, "
        "track: [{sim_time_s: 0}, {sim_time_s: 3, north_m: 4}]}",
        sensor="{radio: {preset: rf-sensor, shadowing: {sigma_db: 5}}, rate_hz: 2, identifies: frequency}",
    )
    assert Scenario.from_yaml(it.to_yaml()) == it
    assert [each.name for each in emitters_of(it)] == ["beacon", "7"]
    assert emitters_of(it)[1].antenna.model == "dipole"
    (sensor,) = sensors_of(it).values()
    assert sensor.radio.shadowing.spread_db == 5.0
    assert (sensor.rate_hz, sensor.identifies) == (2.0, "frequency")


def test_more_emitters_in_slots_than_a_radio_can_reckon_with_are_refused_by_name() -> None:
    """Those that it does not hear, and those that never pause, do not count."""
    jammers = [
        f"{{id: j{k}, kind: emitter, frequency_hz: 2.412e+9, power_dbm: 3, duty: 0.5}}" for k in range(9)
    ]
    text = mistake(*jammers)
    assert "small.yaml:5: radio: its receiver hears the emitters j0, j1" in text
    assert "at most 8 emitters and interferers may have a duty between 0 and 1" in text
    for old, new in (("2.412e+9", "900e+6"), ("duty: 0.5", "duty: 1")):
        it = scenario(*jammers[:8], jammers[8].replace(old, new))
        assert len(radios_of(it, emitters_of(it))["0"].sources) == 8 + (new == "duty: 1")


def test_radios_hear_the_emitters_near_their_frequency() -> None:
    it = scenario(BEACON, "{id: jam, kind: emitter, frequency_hz: 2.42e+9, power_dbm: 30}")
    (radio,) = radios_of(it, emitters_of(it)).values()
    assert [each.name for each in radio.emitters] == ["jam"]


def test_files_of_a_sensor_and_of_an_antenna_are_as_seen_from_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "receiver.yaml").write_text("preset: rf-sensor\noffset_db: -3\n")
    rows = "".join(f"{azimuth},{elevation},1\n" for azimuth in (0, 180) for elevation in (-90, 90))
    (tmp_path / "dish.csv").write_text(rows)
    emitter = BEACON.replace("}", "", 1).replace("{north_m: 7", "{north_m: 7}")
    emitter = f"{emitter[:-1]}, antenna: {{model: pattern, pattern_file: dish.csv}}}}"
    it = scenario(emitter, sensor="{radio: receiver.yaml}", folder=tmp_path)
    assert sensors_of(it)["0"].radio.offset_db == -3.0
    assert len(emitters_of(it)[0].antenna.pattern) == 4
    assert named_code(it).files == (tmp_path / "receiver.yaml",)
    assert Scenario.from_yaml(it.to_yaml()) == it


@pytest.mark.parametrize(
    ("old", "new", "key", "says"),
    [
        ("power_dbm: 20", "power_dbm: 2000", "nodes.beacon.power_dbm", "less than or equal to 200"),
        (", power_dbm: 20", "", "nodes.beacon.power_dbm", "is required"),
        ("power_dbm: 20", "power_dbm: 20, duty: 2", "nodes.beacon.duty", "less than or equal to 1"),
        (
            "power_dbm: 20",
            "power_dbm: 20, agent: {type: still}",
            "nodes.beacon.agent",
            "frequency_hz, power_dbm",
        ),
        (
            "power_dbm: 20",
            "power_dbm: 20, antenna: {model: horn}",
            "nodes.beacon.antenna.model",
            "dipole, sector",
        ),
        (
            "power_dbm: 20",
            "power_dbm: 20, antenna: {model: sector, gan_db: 1}",
            "nodes.beacon.antenna",
            "gan_db",
        ),
        (
            "power_dbm: 20",
            "power_dbm: 20, antenna: {model: pattern, pattern_file: no.csv}",
            "antenna",
            "no.csv",
        ),
        ("id: beacon", "id: '0'", "nodes", "id 0 is used more than once"),
        ("place: {north_m: 7}", "place: {}, track: [{sim_time_s: 0}]", "nodes.beacon", "give one of them"),
        (
            "place: {north_m: 7}",
            "track: [{sim_time_s: 3}, {sim_time_s: 3}]",
            "nodes.beacon.track.1",
            "above that of the",
        ),
    ],
)
def test_mistakes_in_an_emitter_are_named(old: str, new: str, key: str, says: str) -> None:
    text = mistake(BEACON.replace(old, new))
    assert f"small.yaml:7: {key}" in text or (key == "nodes" and says in text) or key == "antenna"
    assert says in text


@pytest.mark.parametrize(
    ("sensor", "key", "says"),
    [
        ("{rate_hz: 0}", "sensor.rate_hz", "greater than 0"),
        ("{rte_hz: 1}", "sensor.rte_hz", "allowed here: rate_hz, band_hz"),
        ("{radio: rf-senser}", "sensor.radio", "did you mean rf-sensor"),
        ("{radio: {preset: rf-sensor, offset_db: x}}", "sensor.radio", "offset_db"),
        ("{identifies: colour}", "sensor.identifies", "'id', 'frequency' or 'none'"),
        ("{band_hz: [2, 1]}", "nodes.0.sensor", "the lower end comes first"),
    ],
)
def test_mistakes_in_a_sensor_are_named(sensor: str, key: str, says: str) -> None:
    text = mistake(BEACON, sensor=sensor)
    assert "small.yaml:8: " in text
    assert key in text
    assert says in text
