"""What is known to go wrong before anything flies: laws beyond their validity, and times after the end."""

import json
from pathlib import Path
from typing import Any

import pytest

from bridge.scenario.file import parse_scenario, read_scenario
from bridge.scenario.mistakes.error import ScenarioError
from lostlink.plan.plan import plan_of

RADIO = {
    "frequency_hz": 915e6,
    "transmit_power_dbm": 20.0,
    "propagation": {"model": "okumura-hata"},
}
MAP = Path(__file__).parents[4] / "sitl_configs/maps/ridge.nc"
STILL = {"agent": {"type": "still"}}
BASE = STILL | {"id": "base", "kind": "ground", "place": {"height_m": 30.0}}
CAR = STILL | {"id": "car", "kind": "ground", "place": {"north_m": 1500.0, "height_m": 2.0}}
CLAMPED = {"radio": RADIO | {"propagation": {"model": "okumura-hata", "outside": "clamp"}}}


def warnings(**more: Any) -> list[str]:
    return [*plan_of(parse_scenario(text(**more), "before.json")).warnings]


def text(**more: Any) -> str:
    scenario = {
        "schema": 1,
        "name": "before",
        "duration_s": 60,
        "origin": {"lat_deg": 37.0, "lon_deg": 127.0, "alt_amsl_m": 50.0},
        "transmit": {"every_ticks": 1000},
        "radio": RADIO,
        "nodes": [{"id": 0} | STILL, BASE, CAR],
    }
    return json.dumps(scenario | more)


@pytest.mark.parametrize(
    ("radio", "told"),
    [
        (
            RADIO | {"frequency_hz": 2412e6},
            "radio.propagation: okumura-hata is made for 150 to 1500 MHz, and frequency_hz of custom is 2412 MHz: ",
        ),
        (
            RADIO | {"propagation": {"model": "cost231-hata"}},
            "radio.propagation: cost231-hata is made for 1500 to 2000 MHz, and frequency_hz of custom is 915 MHz: ",
        ),
        (
            RADIO
            | {"propagation": {"model": "free-space"}, "noise": {"model": "man-made", "environment": "city"}},
            "radio.noise: man-made is made for 0.3 to 250 MHz, and frequency_hz of custom is 915 MHz: ",
        ),
    ],
)
def test_a_law_that_refuses_its_carrier_is_a_mistake(radio: dict[str, Any], told: str) -> None:
    with pytest.raises(ScenarioError, match=r"before\.json:1: ") as raised:
        parse_scenario(text(radio=radio), "before.json")
    assert told in str(raised.value)
    assert "`outside: warn`" in str(raised.value)


@pytest.mark.filterwarnings("ignore::channel.validity.ValidityWarning")
def test_a_law_that_goes_on_beyond_its_carrier_is_warned_of() -> None:
    radio = RADIO | {"frequency_hz": 2412e6, "propagation": {"model": "okumura-hata", "outside": "warn"}}
    [line] = warnings(radio=radio)
    assert line.endswith("is 2412 MHz; it goes on with its formula (propagation.outside: warn)")
    assert warnings(**CLAMPED) == []


def test_a_map_of_another_carrier_is_a_mistake_or_warned_of() -> None:
    """Its fallback had all links without a word, and a run that refuses broke off over places within the map."""
    law = {"model": "gain-map", "file": str(MAP)}
    made_for = f"gain-map is made for 2291.4 to 2532.6 MHz, and frequency_hz of custom is 5800 MHz ({MAP})"
    with pytest.raises(ScenarioError, match=r"before\.json:1: radio\.propagation: gain-map") as raised:
        parse_scenario(text(radio=RADIO | {"frequency_hz": 5.8e9, "propagation": law}), "before.json")
    assert f"{made_for}: take another map; `outside: fallback`" in str(raised.value)
    law["outside"] = "fallback"
    [line] = warnings(radio=RADIO | {"frequency_hz": 5.8e9, "propagation": law})
    assert line == (
        f"radio of network main: {made_for}; its fallback has all links (propagation.outside: fallback)"
    )
    assert warnings(radio=RADIO | {"frequency_hz": 2.5e9, "propagation": law}) == []


def test_emitters_off_the_carrier_of_a_sensors_map_are_warned_of() -> None:
    law = {"model": "gain-map", "file": str(MAP), "outside": "fallback"}
    sensor = {"radio": {"preset": "rf-sensor", "propagation": law}}
    beacon = {"id": "beacon", "kind": "emitter", "frequency_hz": 433.92e6, "power_dbm": 10.0}
    nodes = [{"id": 0, "sensor": sensor} | STILL, BASE, beacon]
    [line] = warnings(radio=CLAMPED["radio"], nodes=nodes)
    assert line == (
        f"sensor of node 0: emitter beacon is off the carrier of {MAP}: its fallback has the way "
        "(propagation.outside: fallback)"
    )


def test_shipped_presets_are_not_refused_and_say_it_themselves() -> None:
    for preset in ("moon2020", "hata-qpsk"):
        plan = plan_of(parse_scenario(text(radio={"preset": preset}), "before.json"))
        assert not [line for line in (*plan.warnings, *plan.not_modelled) if "is made for" in line]
    plan = plan_of(parse_scenario(text(radio={"preset": "telemetry-915"}), "before.json"))
    [line] = [line for line in plan.not_modelled if "is made for" in line]
    assert (
        "man-made is made for 200 to 900 MHz, and frequency_hz of telemetry-915 is 915 MHz; it counts" in line
    )


def test_places_that_a_law_refuses_are_warned_of() -> None:
    """1500 m from a mast of 30 m to a car are Hata's; a UA on the ground is not."""
    [line] = warnings()
    assert line.startswith(
        "radio of network main: between nodes 0 and base, where they are at the start, height of the "
    )
    assert "mobile = 0.1: allowed is 1 to 10, the validity range of okumura-hata" in line
    near = CAR | {"place": {"north_m": 500.0, "height_m": 2.0}}
    radio = {"radio": RADIO | {"propagation": {"model": "free-space"}}}
    ua = {"id": 0} | STILL
    both = {"nodes": [ua, BASE | {"radio": RADIO}, near | {"radio": RADIO}]}
    assert any(
        "between nodes base and car" in line and "distance_m = 500" in line
        for line in warnings(**radio, **both)
    )
    assert warnings(**radio) == []


EMITTER = {
    "id": "e",
    "kind": "emitter",
    "place": {"north_m": 900.0},
    "frequency_hz": 915e6,
    "power_dbm": 20.0,
}
SMALL = {"model": "terrain", "heights_m": [[0.0, 0.0], [0.0, 0.0]], "spacing_m": 100.0}


@pytest.mark.parametrize(
    ("law", "changes", "told"),
    [
        (SMALL, {}, "place (north, east) = (890.0, 0.0): allowed is within the terrain"),
        (
            {"model": "al-hourani"},
            {"frequency_hz": 433.92e6},
            "frequency_hz = 433920000.0: allowed is 7e+08 to",
        ),
        (
            {"model": "okumura-hata"},
            {"place": {"north_m": 1500.0, "height_m": 30.0}},
            "mobile = 0.1: allowed is",
        ),
        ({"model": "uma-av"}, {}, "height of the aircraft = 0.1: allowed is 22.5 to 300"),
        ({"model": "al-hourani"}, {}, ""),
        (SMALL | {"outside": "border"}, {}, ""),
        (SMALL, {"frequency_hz": 5e9}, ""),  # out of the sensor's band
    ],
)
def test_what_a_sensor_s_law_refuses_is_warned_of(
    law: dict[str, Any], changes: dict[str, Any], told: str
) -> None:
    """Its first measurement ends the run."""
    sensor = {"preset": "rf-sensor", "frequency_hz": 915e6, "propagation": law}
    nodes = [{"id": 0, "sensor": {"radio": sensor, "band_hz": [4e8, 3e9]}} | STILL, EMITTER | changes]
    lines = [line for line in warnings(radio="perfect", nodes=nodes) if "measurement ends the run" in line]
    assert len(lines) == bool(told)
    for line in lines:
        assert line.startswith("sensor of node 0: towards emitter e, where they are at the start, ")
        assert told in line


@pytest.mark.parametrize("as_interferer", [False, True])
def test_what_a_radio_s_law_refuses_of_emitters_is_warned_of(*, as_interferer: bool) -> None:
    """The first packet to a node that hears it ends the run; the nodes themselves stand on the terrain."""
    radio: dict[str, Any] = RADIO | {"propagation": SMALL | {"origin_north_m": -50.0, "origin_east_m": -50.0}}
    nodes: list[dict[str, Any]] = [{"id": 0} | STILL, {"id": 1, "home": {"north_m": 10.0}} | STILL]
    assert warnings(radio=radio, nodes=nodes) == []
    source = {"position_ned_m": [900.0, 0.0, -2.0], "power_dbm": 20.0, "name": "e"}
    heard = {"radio": radio | {"interference": {"interferers": [source]}}, "nodes": nodes}
    if not as_interferer:
        heard = {"radio": radio, "nodes": [*nodes, EMITTER]}
    [line] = [line for line in warnings(**heard) if "ends the run" in line]
    assert line.startswith(
        "radio of network main: from e to node 0, where they are at the start, place (north"
    )


LATE: dict[str, dict[str, Any]] = {
    "wind.gusts.1: it begins at 60 s, and the run ends at duration_s, 60 s": {
        "wind": {"gusts": [{"speed_mps": 3, "from_deg": 0, "start_s": at_s} for at_s in (59, 60)]}
    },
    "node car: its track leads away from its first place at 70 s, and the run ends": {
        "nodes": [
            {"id": 0} | STILL,
            STILL
            | {
                "id": "car",
                "kind": "ground",
                "track": [{"sim_time_s": 70}, {"sim_time_s": 80, "north_m": 5}],
            },
        ]
    },
    "expectation 'delivery all to all from 61 to 70 s': its between_s begins at 61 s, and the run ends at": {
        "expectations": [
            {"type": "delivery", "between_s": between_s, "at_least": 0.5}
            for between_s in ([60, 70], [61, 70])
        ]
    },
    "expectation 'node 0 near 0 m N, 0 m E at 61 s': its at is 61 s, and the run ends at duration_s, 60 s: it will": {
        "expectations": [
            {"type": "position", "node": 0, "north_m": 0, "east_m": 0, "within_m": 5, "at": at}
            for at in (60, 61, "end")
        ]
    },
}


@pytest.mark.parametrize(("told", "what"), LATE.items())
def test_what_comes_after_the_end_is_warned_of(told: str, what: dict[str, Any]) -> None:
    [line] = warnings(**CLAMPED | what)
    assert line.startswith(told)


def test_the_end_is_a_whole_tick() -> None:
    """With 20 ticks a second, a run of 2.03 s ends with that of 2.05 s."""
    expected = [{"type": "delivery", "between_s": [begin_s, 9], "at_least": 0.5} for begin_s in (2.05, 2.06)]
    [line] = warnings(**CLAMPED | {"duration_s": 2.03, "expectations": expected})
    assert "begins at 2.06 s, and the run ends at duration_s, 2.03 s: it will not be met" in line


@pytest.mark.parametrize("key", ["between_s", "distance_m"])
def test_an_interval_that_falls_is_a_mistake(key: str) -> None:
    expected = {"expectations": [{"type": "delivery", key: [70, 10], "at_least": 0.5}]}
    with pytest.raises(ScenarioError, match=rf"expectations\.0\.{key}: .*\[70, 10\].*write \[10, 70\]"):
        parse_scenario(text(**CLAMPED | expected), "before.json")
    parse_scenario(
        text(**CLAMPED | {"expectations": [expected["expectations"][0] | {key: [10, 10]}]}), "before.json"
    )


def test_a_shipped_scenario_has_nothing_too_late() -> None:
    assert not [line for line in plan_of(read_scenario("separation")).warnings if "the run ends" in line]


RIDGE = {"model": "terrain", "spacing_m": 1000.0, "heights_m": [[0.0] * 3, [60.0] * 3, [0.0] * 3]}


@pytest.mark.parametrize(
    ("law", "nodes", "told"),
    [
        (
            RIDGE,
            [BASE | {"place": {"north_m": 1000.0}}],
            "below the ground of terrain: base by 58 m; antennas",
        ),
        (RIDGE, [BASE | {"place": {"north_m": 1000.0, "height_m": 62.0}}], ""),
        (
            RIDGE,
            [BASE | {"place": None, "track": [{"sim_time_s": 0}, {"sim_time_s": 9, "north_m": 500.0}]}],
            "base by 28 m; antennas",
        ),
        (
            RIDGE,
            [{"id": 1, "home": {"north_m": 100.0}} | STILL],
            "below the ground of terrain: 1 by 6 m; antennas",
        ),
        (
            RIDGE | {"heights_m": [[-30.0] * 3] * 2},
            [],
            "UA that begin above the ground of terrain: 0 by 30 m; is",
        ),
        (
            {"model": "two-ray"},
            [BASE | {"place": {"height_m": -20.0}}],
            "the ground of two-ray: base by 20 m; antennas",
        ),
        (
            RIDGE,
            [EMITTER | {"place": {"north_m": 1000.0}}],
            "below the ground of terrain: e by 58 m; antennas",
        ),
    ],
)
def test_nodes_below_the_ground_are_warned_of(
    law: dict[str, Any], nodes: list[dict[str, Any]], told: str
) -> None:
    """Behind 0.1 m of ground, in place of the mast that was meant, there are tens of dB."""
    nodes = [{"id": 0} | STILL, *({k: v for k, v in node.items() if v is not None} for node in nodes)]
    lines = [
        line for line in warnings(radio=RADIO | {"propagation": law}, nodes=nodes) if "ground of" in line
    ]
    assert len(lines) == bool(told)
    for line in lines:
        assert told in line
