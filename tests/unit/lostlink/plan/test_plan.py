"""The plan of a run, as `lostlink check` prints it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from bridge.scenario.file import ScenarioError, parse_scenario, read_scenario
from bridge.scenario.resolve.radio import radio_from
from channel.link.radio import Radio
from channel.presets import load_radio
from lostlink.cli.flying.check import check
from lostlink.plan.output import lines_of
from lostlink.plan.plan import plan_of
from lostlink.plan.radios.reach import reach_of

HOLDS_BYTES, FLIES_OUT_BYTES = 328, 376
"""Lengths of data packages in flight, read from the record of a run with this radio, which counts payloads."""
TEXT = """\
schema: 1
name: planned
duration_s: 60
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: corrected
hosts: per-ua
transmit: {every_ticks: 4}
ports: {first_slot: 7}
nodes:
  - {id: 0, count: 3, home: {line: {spacing_m: 10}}, agent: {type: hold, altitude_m: 30}}
  - {id: gcs, kind: ground, place: {north_m: -5, height_m: 6}, agent: {type: free}}
  - {id: 9, home: {north_m: 50}, radio: {preset: corrected, mtu_bytes: 100}, agent: {type: own, class: "os.path:join"}}
"""


def checked(*options: str) -> Result:
    return CliRunner().invoke(check, list(options))


def plan_with(*settings: str) -> dict[str, Any]:
    options = [part for setting in settings for part in ("--set", setting)]
    plan: dict[str, Any] = json.loads(checked("separation", "--json", *options).output)
    return plan


TOWER = """\
schema: 1
name: cell
duration_s: 60
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: {preset: lte-like, propagation: {outside: OUTSIDE}}
nodes:
  - {id: 0, agent: {type: still}}
  - {id: tower, kind: ground, place: {north_m: 500, height_m: 35}, agent: {type: still}}
"""
SECOND = "  - {id: 1, agent: {type: still}}\n"


@pytest.mark.slow
def test_links_and_heights_that_a_cellular_law_does_not_have_are_told_before_the_run() -> None:
    """A base and a UA are what it is for; two UA are refused at once, or said to be counted otherwise."""
    one, two = (
        plan_of(parse_scenario(text.replace("OUTSIDE", "clamp"), "cell.yaml")).not_modelled
        for text in (TOWER, TOWER + SECOND)
    )
    assert "links between UA: rma-av has none; the lower end of such a link counts as its base" in two
    assert not any("links between" in line for line in one)
    assert any(line.startswith("UA below 10 or above 300 m: by rma-av they count") for line in one)
    refusing = plan_of(parse_scenario(TOWER.replace("OUTSIDE", "refuse"), "cell.yaml")).not_modelled
    assert any(line.startswith("UA below 10 or above 300 m: by rma-av they end the run") for line in refusing)
    with pytest.raises(ScenarioError, match=r"cell.yaml:5: radio: rma-av has .* no links between UA: 0, 1"):
        parse_scenario((TOWER + SECOND).replace("OUTSIDE", "refuse"), "cell.yaml")


def test_nodes_processes_and_ports() -> None:
    plan = plan_of(parse_scenario(TEXT, "planned.yaml"))
    assert [(n.id, n.kind, n.place_m, n.vehicle, n.agent) for n in plan.nodes] == [
        ("0", "ua", (0, 0, 0), "copter", "hold"),
        ("1", "ua", (0, 10, 0), "copter", "hold"),
        ("2", "ua", (0, 20, 0), "copter", "hold"),
        ("gcs", "ground", (-5, 0, 6), None, "free"),
        ("9", "ua", (50, 0, 0), "copter", "os.path:join"),
    ]
    hosted = [node for name, nodes in plan.processes.items() if name.startswith("host-") for node in nodes]
    assert sorted(hosted) == ["0", "1", "2", "9"]
    assert "UDP port 9092 (flight dynamics of UA 2)" in plan.ports


def test_where_mavlink_is_sent_is_said() -> None:
    said = checked("separation", "--set", "speed=1", "--set", "ports.mavsdk=0").output
    assert "MAVLink of UA 1 to 127.0.0.1:14550\n" in said
    assert "UDP outputs" not in checked("separation", "--set", "speed=2").output


@pytest.mark.parametrize(
    ("settings", "joined", "processes", "ports"),
    [
        ((), "one process, without Zenoh beside it", ["fleet"], [6760, 6770]),
        (("zenoh=true",), "one process, with Zenoh beside it", ["fleet"], [7447, 6760, 6770]),
        (
            ("processes=one", "autopilot=external"),
            "one process, without Zenoh beside it",
            ["fleet"],
            [9002, 6760, 9012, 6770],
        ),
        (
            ("processes=many", "hosts=1"),
            "many processes, joined by Zenoh",
            ["router", "physics", "host-0", "autopilots-0"],
            [7447, 9002, 6760, 5760, 9012, 6770, 5770],
        ),
    ],
)
def test_what_runs_is_what_the_choice_of_processes_needs(
    settings: tuple[str, ...], joined: str, processes: list[str], ports: list[int]
) -> None:
    plan = plan_with(*settings)
    assert plan["joined"] == joined
    assert list(plan["processes"]) == processes
    assert [int(port.split()[2]) for port in plan["ports"]] == ports


def test_offered_load_is_rate_times_length_over_bit_rate() -> None:
    load = plan_of(parse_scenario(TEXT, "planned.yaml")).load
    assert [(n.packets_per_s, n.payload_bytes, n.is_guess) for n in load.nodes] == [
        (5.0, HOLDS_BYTES, False),
        (5.0, HOLDS_BYTES, False),
        (5.0, HOLDS_BYTES, False),
        (None, None, True),
        (5.0, HOLDS_BYTES, True),
    ]
    assert load.on_air_bits_per_s == 4 * 5 * HOLDS_BYTES * 8
    assert load.airtime_share == pytest.approx(4 * 5 * HOLDS_BYTES * 8 / 24e6)


def test_more_than_the_bit_rate_is_warned_of() -> None:
    assert on_medium("model=ideal", more=["transmit.every_ticks=20"])["warnings"] == []
    (warning,) = on_medium("model=ideal")["warnings"]
    share = 20 * 8 * (HOLDS_BYTES + 8 + FLIES_OUT_BYTES + 8) / 64e3
    assert f"{share:.3g} times what the radio's bit rate carries" in warning


def on_medium(*medium: str, more: Sequence[str] = ()) -> dict[str, Any]:
    return plan_with("radio=telemetry-915", *(f"radio.medium.{each}" for each in medium), *more)


def test_where_no_node_waits_frames_are_said_to_overlap() -> None:
    (warning,) = on_medium("model=airtime")["warnings"]
    assert "no node waits for others there, so that frames are on the air at once" in warning
    assert "queue_full" not in warning


def test_load_on_a_pair_of_sik_radios_is_over_what_their_firmware_carries() -> None:
    """64 kb/s: 3240 B/s each while both are busy, by simulating the firmware's arithmetic apart from this code."""
    plan = plan_with("radio=telemetry-915")
    load, both_bps = plan["load"], 8 * 2 * 3240
    assert load["medium"] == "sik"
    assert load["capacity_bps"] == pytest.approx(both_bps, rel=0.03)
    (warning,) = plan["warnings"]
    share = 20 * 8 * (HOLDS_BYTES + FLIES_OUT_BYTES) / load["capacity_bps"]
    assert f"{share:.3g} times what the medium sik carries" in warning


def test_load_on_several_pairs_of_sik_radios_is_that_of_the_busiest() -> None:
    """Two pairs of two that hold offer what one does, each over its own capacity; their sum was taken."""
    text = TEXT.split("  - {id: gcs")[0].replace("corrected", "telemetry-915")
    one, two = (
        plan_of(parse_scenario(text.replace("count: 3", f"count: {count}"), "pairs.yaml")).load
        for count in (2, 4)
    )
    assert (one.shared_by, two.shared_by, two.is_shared) == ("all", "group", False)
    assert two.airtime_share == one.airtime_share
    assert two.capacity_bps == one.capacity_bps


def test_load_on_a_medium_is_over_what_it_carries() -> None:
    """Two of 20 packets a second, in slots of 50 ms that have room for one each (41 and 47 ms): 10 for each."""
    plan = on_medium("model=tdma", "slot_s=0.05", "guard_s=0.001")
    load, payload_bps = plan["load"], 20 * 8 * (HOLDS_BYTES + FLIES_OUT_BYTES)
    assert (load["medium"], load["takes_time"], load["is_shared"]) == ("tdma", True, False)
    assert [node["airtime_share"] for node in load["nodes"]] == pytest.approx([2.0, 2.0])
    assert load["payload_bits_per_s"] == payload_bps
    assert load["capacity_bps"] == pytest.approx(10 * 8 * FLIES_OUT_BYTES)
    (warning,) = plan["warnings"]
    assert warning.startswith(
        "a node offers 2 times what the medium tdma carries: packets wait in queues until"
    )
    assert plan["radio"]["medium"] == "tdma"
    assert not any(
        line.startswith(("airtime", "collisions", "medium access")) for line in plan["not_modelled"]
    )


def test_load_on_slots_of_a_schedule_is_that_of_the_busiest_node() -> None:
    """In 200 ms node 0 has room for one packet at 64 kb/s (41 ms), node 1 for two at 128 (24); each offers 4.

    Another slot of node 0 takes no data packages.
    """
    slots = (
        "{nodes: 0, duration_s: 0.05}, {nodes: 1, duration_s: 0.05, bit_rate_bps: 128e3}, "
        "{nodes: 0, duration_s: 0.05, priority: 5}"
    )
    load = on_medium("model=tdma", f"schedule={{slots: [{slots}], round_s: 0.2}}")["load"]
    assert (load["medium"], load["is_shared"]) == ("tdma", False)
    assert [node["airtime_share"] for node in load["nodes"]] == pytest.approx([4.0, 2.0])
    assert load["airtime_share"] == pytest.approx(4.0)


@pytest.mark.slow
def test_in_slots_of_another_rate_packages_arrive_as_far_as_with_a_radio_of_that_rate() -> None:
    """All slots at 1 Mb/s, and the reach was told at 64 kb/s, 12 dB more; that of half of 64 kb/s in one of two."""
    radio, medium = ["radio=telemetry-915", "radio.noise={model: thermal}"], "radio.medium.model=tdma"
    slots = (
        "{nodes: 0, duration_s: 0.1, bit_rate_bps: 32e3}, {nodes: 1, duration_s: 0.1, bit_rate_bps: 1024e3}"
    )
    found = plan_with(*radio, medium, f"radio.medium.schedule={{slots: [{slots}]}}")["radio"]["slot_reach"]
    for rate in ("32000", "1.024e+06"):
        plain = plan_with(*radio, medium, "radio.medium.slot_s=0.1", f"radio.bit_rate_bps={float(rate)}")
        assert found.pop(rate)["distance_m"] == plain["radio"]["reach"]["distance_m"]
    assert not found
    table = plan_with("radio=elrs-900-200", medium, f"radio.medium.schedule={{slots: [{slots}]}}")
    assert table["radio"]["slot_reach"] == {}, "a table is that of one rate"


def test_what_slots_carry_is_of_those_who_have_room_in_them() -> None:
    """Of two nodes one alone has a slot, in which its package has room once in 0.5 s: not the load of both over it."""
    schedule = "schedule={slots: [{nodes: 0, duration_s: 0.05}], round_s: 0.5}"
    load = on_medium("model=tdma", schedule)["load"]
    assert [node["airtime_share"] > 0.0 for node in load["nodes"]] == [True, False]
    assert load["capacity_bps"] == pytest.approx(8 * HOLDS_BYTES / 0.5)


def test_load_on_expresslrs_is_held_against_user_bytes() -> None:
    """Half the slots of 3003 us are the receiver's, and 62 user bytes take 7 of them: 1475 bytes a second.

    The transmitter, node 0, has every second of the others, or all of them without a remote control.
    """
    down = 20 * FLIES_OUT_BYTES / (62 / (7 * 2 * 0.003003))
    for medium, up_slots in (("has_rc=true", 4), ("has_rc=false", 2)):
        plan = on_medium("model=elrs", "mode=lora-333-full", medium)
        load, up_bps = plan["load"], 8 * 62 / (7 * up_slots * 0.003003)
        up = 20 * 8 * HOLDS_BYTES / up_bps
        assert [node["airtime_share"] for node in load["nodes"]] == pytest.approx([up, down], rel=1e-3)
        assert load["airtime_share"] == pytest.approx(max(up, down), rel=1e-3)
    assert up < down
    more = ["transmit.every_ticks=4", "radio.bit_rate_bps=43.8e3"]
    plan = on_medium("model=elrs", "mode=lora-333-full", more=more)
    assert plan["load"]["capacity_bps"] == pytest.approx(8 * 62 / (7 * 4 * 0.003003))
    (warning,) = plan["warnings"]
    assert f"a node offers {5 * 8 * HOLDS_BYTES / plan['load']['capacity_bps']:.3g} times" in warning


def test_load_on_lines_of_each_sender_is_that_of_the_busiest() -> None:
    load = on_medium("model=delay", "least_s=0", "median_s=0.04", "most_s=0.1", "rate_bps=100e3")["load"]
    assert (load["is_shared"], load["capacity_bps"]) == (False, pytest.approx(100e3))
    assert load["airtime_share"] == pytest.approx(20 * 8 * FLIES_OUT_BYTES / 100e3)


def test_a_package_that_fits_no_slot_is_warned_of() -> None:
    """41 ms of 64 kb/s are 328 bytes and no more."""
    plan = on_medium("model=tdma", "slot_s=0.041", more=["transmit.every_ticks=2"])
    (warning,) = plan["warnings"]
    assert warning.startswith(
        f"node 1: its data package has {FLIES_OUT_BYTES} bytes, for which the medium tdma has no"
    )


@pytest.mark.parametrize(
    "medium", [("model=airtime", "max_length_bytes=300"), ("model=elrs", "buffer_bytes=300")]
)
def test_a_package_that_is_too_long_for_the_medium_is_warned_of(medium: tuple[str, str]) -> None:
    warnings = " ".join(on_medium(*medium)["warnings"])
    for node, length in ((0, HOLDS_BYTES), (1, FLIES_OUT_BYTES)):
        assert f"node {node}: its data package has {length} bytes, for which the medium" in warnings


def test_a_package_that_fits_no_slot_with_the_header_of_its_routing_is_warned_of() -> None:
    """Slots of 49 ms have room for 392 bytes: for the longer package and 8 more, not for 28 more."""
    slots = "model=tdma", "slot_s=0.049"
    ways = {way: on_medium(*slots, more=[f"radio.routing={{model: {way}}}"]) for way in ("flood", "mesh")}
    text = f"node 1: its data package has {FLIES_OUT_BYTES} bytes, for which the medium tdma has no room"
    assert {way: any(text in each for each in plan["warnings"]) for way, plan in ways.items()} == {
        "flood": False,
        "mesh": True,
    }


@pytest.mark.slow
def test_a_mesh_whose_messages_fit_no_slot_is_warned_of() -> None:
    """Slots for data packages alone take no message of priority 7, and 1 ms has no room for 24 bytes."""
    slots = ", ".join(f"{{nodes: {node}, duration_s: 0.1, priority: 0}}" for node in (0, 1))
    more = ["transmit.every_ticks=40"]
    of_class = "model=tdma", f"schedule={{slots: [{slots}]}}"
    for routing, warned in (
        ("{model: mesh}", 2),
        ("{model: mesh, ogm_priority: 0}", 0),
        ("{model: flood}", 0),
    ):
        plan = on_medium(*of_class, more=[*more, f"radio.routing={routing}"])
        assert sum("originator messages" in each for each in plan["warnings"]) == warned
    plan = on_medium("model=tdma", "slot_s=0.001", more=[*more, "radio.routing={model: mesh}"])
    assert "node 0: the medium tdma has no room for the originator messages" in " ".join(plan["warnings"])


def test_load_on_a_medium_reads_well() -> None:
    options = ["radio.medium={model: tdma, slot_s: 0.05}", "transmit.every_ticks=20"]
    said = checked(
        "separation", "--radio", "telemetry-915", *(part for each in options for part in ("--set", each))
    )
    line = (
        "  all nodes: 2 packets/s, 5632 bit/s of payload, the busiest sender 10.0% of the 3.008e+04 bit/s that the "
        "medium tdma carries of its packets"
    )
    assert line in said.output.splitlines()
    assert "data packages only" not in said.output
    guess = plan_of(parse_scenario(TEXT, "planned.yaml"))
    assert any(line.startswith("  data packages only: what own agents") for line in lines_of(guess))


def test_an_outage_after_the_end_is_warned_of() -> None:
    late = TEXT.replace("radio: {preset", "radio_off: [{from_s: 5, to_s: 60}, {from_s: 60}], radio: {preset")
    assert "node 9: its radio goes off at 60 s" in plan_of(parse_scenario(late, "late.yaml")).warnings[-1]


def test_radio_outages_are_named_with_who_is_off_together(tmp_path: Path) -> None:
    off = TEXT.replace(
        "radio: {preset", "radio_off: [{from_s: 5, to_s: 7.1234567}, {from_s: 30}], radio: {preset"
    )
    off = off.replace("{id: 0, count: 3,", "{id: 0, count: 3, radio_off: [{from_s: 30}],")
    (tmp_path / "off.yaml").write_text(off)
    lines = checked(str(tmp_path / "off.yaml")).output.splitlines()
    at = lines.index("Radio outages")
    assert lines[at + 1 : at + 4] == [
        "  node 9: off from 5 s to 7.1234567 s",
        "  nodes 0, 1, 2, 9: off from 30 s to the end",
        "",
    ]
    assert json.loads(checked(str(tmp_path / "off.yaml"), "--json").output)["outages"] == [
        {"nodes": ["9"], "from_s": 5.0, "to_s": 7.1234567},
        {"nodes": ["0", "1", "2", "9"], "from_s": 30.0, "to_s": None},
    ]
    assert "Radio outages" not in checked("separation").output


def test_partitions_are_told_with_their_sides_and_who_is_on_none(tmp_path: Path) -> None:
    parts = "[{groups: [[2], [9]], from_s: 60}, {groups: [[0, 1], [2]], from_s: 5, to_s: 7.5}]"
    (tmp_path / "parted.yaml").write_text(f"{TEXT}partitions: {parts}\n")
    said = checked(str(tmp_path / "parted.yaml")).output
    lines = said.splitlines()
    at = lines.index("Partitions")
    assert lines[at + 1 : at + 4] == [
        "  0, 1 | 2: apart from 5 s to 7.5 s; gcs, 9: on no side, with links to all",
        "  2 | 9: apart from 60 s to the end; 0, 1, gcs: on no side, with links to all",
        "",
    ]
    assert "partitions.0: it begins at 60 s, and the run ends at duration_s" in said
    assert json.loads(checked(str(tmp_path / "parted.yaml"), "--json").output)["partitions"] == [
        {"groups": [["0", "1"], ["2"]], "unlisted": ["gcs", "9"], "from_s": 5.0, "to_s": 7.5},
        {"groups": [["2"], ["9"]], "unlisted": ["0", "1", "gcs"], "from_s": 60.0, "to_s": None},
    ]
    assert "Partitions" not in checked("separation").output


def test_ua_with_one_home_are_warned_of() -> None:
    text = TEXT.replace("home: {line: {spacing_m: 10}}", "home: {north_m: 50}")
    warning = plan_of(parse_scenario(text, "planned.yaml")).warnings[-1]
    assert warning.startswith("UA 0, 1, 2, 9 have one home, 50 m N, 0 m E: ")
    many = plan_of(parse_scenario(text.replace("count: 3", "count: 7"), "planned.yaml")).warnings[-1]
    assert many.startswith("UA 0, 1, 2, 3, 4 and 3 more have one home")


def test_parameters_that_stand_ins_do_not_take_are_warned_of() -> None:
    fleet = TEXT.replace("count: 3,", "count: 7, parameters: {WPNAV_SPEED: 500, RTL_ALT: 900},")
    own = (
        "UA 0, 1, 2, 3, 4 and 2 more: stand-ins take no parameters (WPNAV_SPEED, RTL_ALT); real autopilots do"
    )
    assert own in plan_of(parse_scenario(fleet, "planned.yaml")).warnings
    real = fleet.replace("count: 7,", "count: 7, autopilot: ardupilot,")
    common = "parameters: {SIM_SPEEDUP: 1}\n" + fleet
    told = {
        text: [
            line
            for line in plan_of(parse_scenario(text, "planned.yaml")).warnings
            if "stand-ins take" in line
        ]
        for text in (real, common)
    }
    assert told[real] == []
    assert told[common] == [own, "stand-ins take no parameters (SIM_SPEEDUP); real autopilots do"]


def test_ports_with_which_no_run_would_start_are_warned_of() -> None:
    assert plan_with("processes=many", "nodes.1.id=100")["warnings"] == [
        "a run would not start: TCP port 6760 (autopilot of UA 100) is also wanted for MAVLink server of UA 0: change "
        "ports.autopilot in the scenario"
    ]
    text = TEXT.replace("count: 3", "count: 7").replace("first_slot: 7", "first_slot: 4000, aps: 40000")
    line = plan_of(parse_scenario(text, "planned.yaml")).warnings[-1]
    assert line.startswith("a run would not start: ")
    assert line.count("is beyond 65535") == 3
    assert line.endswith(", and so are 5 more: lower ports.aps or ports.first_slot in the scenario")


def test_a_package_longer_than_the_mtu_is_warned_of() -> None:
    (warning,) = plan_of(parse_scenario(TEXT, "planned.yaml")).warnings
    assert warning == (
        f"node 9: its data package has {HOLDS_BYTES} bytes, more than mtu_bytes of its radio, 100: none would be "
        "delivered; agents of your own may send otherwise"
    )


def test_a_warning_of_too_much_says_that_own_agents_may_send_otherwise() -> None:
    slow = "{preset: corrected, bit_rate_bps: 1.0e+4}"
    text = TEXT.replace("{preset: corrected, mtu_bytes: 100}", slow).replace(
        "radio: corrected", f"radio: {slow}"
    )
    own = plan_of(parse_scenario(text, "planned.yaml")).warnings
    assert [text.endswith("; agents of your own may send otherwise") for text in own] == [True]
    builtin = on_medium("model=ideal")["warnings"]
    assert [text.endswith("or give it a medium (radio.medium)") for text in builtin] == [True]


def test_a_package_longer_than_the_mtu_and_the_mediums_longest_is_warned_of_once() -> None:
    warnings = plan_with("radio=xbee-900hp")["warnings"]
    assert [text.split(",")[-1] for text in warnings if "data package" in text] == [
        " 256: none would be delivered"
    ] * 2


def test_the_reach_of_a_disk_is_its_radius() -> None:
    origin = read_scenario("separation").origin
    radius = {"preset": "disk", "max_range_m": 123.0}
    assert reach_of(radio_from(radius, origin), 40).distance_m == {"0.9": 123.0, "0.5": 123.0, "0.1": 123.0}
    assert reach_of(radio_from({"preset": "disk", "base_loss": 0.7}, origin), 40).distance_m["0.5"] is None
    hata = {"preset": "disk", "propagation": {"model": "okumura-hata"}}
    assert reach_of(radio_from(hata, origin), 40).limit_m is None  # not made for less than a kilometre


def test_outages_of_a_medium_count_for_the_reach() -> None:
    """Each end's line is up for 0.8 of the time: 64 % of packets meet no outage, wherever they go."""
    radio = {"preset": "lte-uav", "medium": {"good_s": 4.0, "bad_s": 1.0}}
    reach = reach_of(radio_from(radio, read_scenario("separation").origin), 40)
    assert reach.distance_m == {"0.9": None, "0.5": reach.limit_m, "0.1": reach.limit_m}


def test_what_is_left_out_follows_the_scenario() -> None:
    plain = " ".join(plan_with()["not_modelled"])
    assert all(
        word in plain for word in ("airtime", "collisions", "carrier sense", "wind", "stand-in", "fading")
    )
    richer = plan_with("wind=breeze", "radio=telemetry-915", "autopilot=ardupilot")["not_modelled"]
    assert not any(line.startswith(("wind", "real autopilots", "fading", "shadowing")) for line in richer)


SITL_ERRORS = "errors of sensors beyond those of the autopilot's simulation"
WHITE = "errors of sensors beyond white noise (fdm.px4): biases, drifts, delays"
STANDIN = "real autopilots: a stand-in flies (docs/reference/standin.md); autopilot: ardupilot or px4 flies real ones"


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ((), [STANDIN, SITL_ERRORS]),
        (("autopilot=ardupilot",), [SITL_ERRORS]),
        (("autopilot=px4",), [WHITE]),
        (("nodes.1.autopilot=ardupilot",), [f"of UA 0: {STANDIN}", SITL_ERRORS]),
        (("nodes.1.autopilot=px4",), [f"of UA 0: {STANDIN}", f"of UA 0: {SITL_ERRORS}", f"of UA 1: {WHITE}"]),
        (("autopilot=px4", "fdm.sensor_noise.gyro_sigma_radps=0.1"), [WHITE.replace("biases, ", "")]),
    ],
)
def test_what_is_left_out_of_the_flight_is_told_of_whom_it_concerns(
    settings: tuple[str, ...], expected: list[str]
) -> None:
    told = plan_with("wind=breeze", *settings)["not_modelled"]
    assert [line for line in told if "stand-in" in line or "errors of sensors" in line] == expected


MIXED = """\
schema: 1
name: mixed-autopilots
duration_s: 60
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: corrected
processes: PROCESSES
autopilot: ardupilot
nodes:
  - {id: 0, count: 2, home: {line: {spacing_m: 10}}, autopilot: standin, agent: {type: still}}
  - {id: 5, home: {east_m: 50}, agent: {type: still}}
  - {id: 7, home: {east_m: 60}, autopilot: px4, agent: {type: still}}
"""


@pytest.mark.parametrize("processes", ["one", "many"])
def test_a_mixed_fleet_has_a_process_for_each_real_autopilot_and_others_for_the_standins(
    processes: str,
) -> None:
    plan = plan_of(parse_scenario(MIXED.replace("PROCESSES", processes), "mixed.yaml"))
    flown = {name: nodes for name, nodes in plan.processes.items() if name.startswith("autopilot")}
    standins = [nodes for name, nodes in flown.items() if name.startswith("autopilots-")]
    assert sorted(sum(standins, ())) == ["0", "1"]
    assert {name: nodes for name, nodes in flown.items() if nodes not in standins} == {
        "autopilot-5": ("5",),
        "autopilot-7": ("7",),
    }
    assert plan.autopilot == "ardupilot, px4, standin"


def test_what_is_left_out_is_told_of_each_network() -> None:
    lines = plan_with("networks={mesh: {preset: wifi-2.4, routing: mesh}}")["not_modelled"]
    told = [line for line in lines if line.startswith("on mesh: ")]
    assert [line.split()[2] for line in told[:2]] == ["access", "of"], "its medium, and its routing"
    assert not {line.removeprefix("on mesh: ") for line in told} & set(lines), "each is said once"


@pytest.mark.parametrize(("factor", "end"), [("1.3", " but the horizon"), ("null", "")])
def test_a_flat_earth_has_no_horizon(factor: str, end: str) -> None:
    lines = plan_with(f"radio={{preset: perfect, earth_radius_factor: {factor}}}")["not_modelled"]
    assert f"terrain and buildings: nothing stands between the nodes{end}" in lines


def test_it_reads_well() -> None:
    done = checked("separation", "--radio", "corrected", "--set", "nodes.0.home.east_m=-7")
    assert done.exit_code == 0
    for line in (
        "  0: UA, f450 (copter) at 0 m N, -7 m E, agent hold",
        "  all nodes: 40 packets/s, 1.126e+05 bit/s on air, 0.5% of the radio's bit rate "
        "(medium ideal: nothing takes time)",
        f"  node 1: 20 packets/s of {FLIES_OUT_BYTES} bytes",
    ):
        assert line in done.output.splitlines()


def test_a_wrong_scenario_is_told_line_by_line() -> None:
    done = checked("separation", "--set", "sead=1", "--set", "spead=1")
    assert done.exit_code == 2
    options = [line.split("=")[0] for line in done.stderr.splitlines()]
    assert options == ["lostlink: --set sead", "lostlink: --set spead"]


def test_groups_of_addressees_are_listed_with_their_members() -> None:
    options = ["nodes.0.groups=[wing, pair]", "nodes.1.groups=[wing]"]
    assert plan_with(*options)["groups"] == {"pair": ["0"], "wing": ["0", "1"]}
    settings = [part for option in options for part in ("--set", option)]
    lines = checked("separation", *settings).output.splitlines()
    at = lines.index("Groups of addressees (2)")
    assert lines[at + 1 : at + 3] == ["  pair: 0", "  wing: 0, 1"]
    assert not any("Groups" in line for line in checked("separation").output.splitlines())


def test_a_radio_that_gets_anywhere_is_told_of_once() -> None:
    told = checked("separation", "--radio", "perfect", "--set", "networks.far=perfect").output
    assert [line.strip() for line in told.splitlines() if "any distance" in line] == [
        "90% of data packages arrive up to any distance",
        "far, packets of 40 bytes: 90% up to any distance",
    ]
    assert "above the ground" not in told


MODEMS = Path(__file__).parents[3] / "data" / "modems.yaml"


def test_networks_modems_and_who_disturbs_whom() -> None:
    """In one band: Wi-Fi at 2.4 GHz and ExpressLRS; SiK at 433 MHz is in none of the others'."""
    air = ["networks.wifi=wifi-2.4", "networks.control=elrs-2.4-333full"]
    told = checked(str(MODEMS), *(part for each in air for part in ("--set", each))).output
    lines = [line.strip() for line in told.split("Networks (5)\n")[1].split("\n\n")[0].splitlines()]
    assert (
        len([line for line in lines if " bytes with both ends 40 m above the ground: 90% up to " in line])
        == 4
    )
    assert [line for line in lines if "both ends" not in line] == [
        "main: perfect, 2412 MHz, medium ideal, nodes 0, 1, gcs",
        "near: sik-433, 433.92 MHz, medium sik, nodes 0, gcs",
        "near, modem of node 0: SERIAL1, 57600 baud, for gcs",
        "near, modem of node gcs: served at tcpin::0, 57600 baud, for 0",
        "far: xbee-900hp, 915 MHz, medium airtime, nodes 0, 1, gcs",
        "far, modem of node 0: SERIAL2, 115200 baud, for all",
        "far, modem of node 1: SERIAL1, 57600 baud, for all",
        "far, modem of node gcs: served at pty, no serial line: bytes pass at once, for all",
        "wifi: wifi-2.4, 2437 MHz, medium csma, nodes 0, gcs; disturbed by control",
        "control: elrs-2.4-333full, 2440 MHz, medium elrs, nodes 0, gcs; disturbed by wifi",
    ]


def test_a_wind_that_is_spelt_out_is_told_as_scenarios_have_it() -> None:
    wind = "{constant: {speed_mps: 8, from_deg: 270}, turbulence: {level: moderate}}"
    assert checked("separation", "--set", f"wind={wind}").output.splitlines()[1].endswith(f", wind {wind}")


def test_each_network_has_its_own_reach() -> None:
    """Of `main`, with data packages, the plan of the radio has it."""
    main, *others = plan_with("radio=perfect", "networks={near: sik-433, mesh: wifi-2.4}")["networks"]
    assert main["reach"] is None
    for network in others:
        radio, reach = Radio(load_radio(network["radio"])), network["reach"]
        assert (reach["payload_bytes"], reach["height_m"]) == (40, 40.0)
        for share, distance_m in reach["distance_m"].items():
            near, far = radio.probability_of_delivery([0.99 * distance_m, 1.01 * distance_m], 40)
            assert far < float(share) < near


SWARM = """\
schema: 1
name: swarm
duration_s: 60
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: {preset: wifi-2.4, medium: {model: csma, standard: 11b, rate_mbps: 1, basic_rate_mbps: 1}}
tick_rate_hz: 20
transmit: {every_ticks: 20}
nodes:
  - {id: 0, agent: {type: still}}
  - {id: "m{i}", kind: ground, count: 29, place: {line: {spacing_m: 10}}, agent: {type: still}}
"""


def test_nodes_that_all_transmit_at_the_same_tick_are_warned_of() -> None:
    """Of 100 nodes with 7 % of what the air carries 16 % collided; with ticks of their own none."""
    at_one_tick = plan_of(parse_scenario(SWARM, "swarm.yaml")).warnings
    spread = SWARM.replace("tick_rate_hz: 20", "tick_rate_hz: 1").replace("every_ticks: 20", "every_ticks: 1")
    [line] = [each for each in at_one_tick if "at the same ticks" in each]
    assert line.startswith("all nodes transmit at the same ticks (transmit.every_ticks: 20), and offer ")
    assert "lower tick_rate_hz and every_ticks alike" in line
    assert not any(
        "at the same ticks" in each for each in plan_of(parse_scenario(spread, "swarm.yaml")).warnings
    )


SLOW = """\
schema: 1
name: slow
duration_s: 60
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: {preset: telemetry-915, medium: {model: airtime}}
tick_rate_hz: 100
transmit: {every_ticks: 100}
"""


@pytest.mark.parametrize("nodes", [1, 2])
def test_one_node_alone_meets_nobody_at_its_tick(nodes: int) -> None:
    text = SLOW + "nodes:\n" + "".join(f"  - {{id: {n}, agent: {{type: still}}}}\n" for n in range(nodes))
    warned = any("at the same ticks" in each for each in plan_of(parse_scenario(text, "slow.yaml")).warnings)
    assert warned is (nodes > 1)


@pytest.mark.slow
def test_a_radio_of_another_rate_than_its_medium_is_warned_of() -> None:
    assert on_medium("model=csma", more=["transmit.every_ticks=20"])["warnings"] == [
        "radio of network main: frames last as long as at 6 Mb/s (medium.rate_mbps), and have the errors of 0.064 Mb/s "
        "(bit_rate_bps)"
    ]
    assert plan_with("radio=wifi-5.8", "transmit.every_ticks=20")["warnings"] == []


LASTS = "radio of network main: frames last as long as "


@pytest.mark.parametrize(
    ("changes", "warnings"),
    [
        (["radio=telemetry-915"], []),
        (["radio=elrs-2.4-333full"], []),
        (["radio=elrs-900-200"], []),
        (
            ["radio=telemetry-915", "radio.medium.air_kbps=32"],
            ["at 0.032 Mb/s (medium.air_kbps), and have the errors of 0.064 Mb/s (bit_rate_bps)"],
        ),
        (["radio=telemetry-915", "radio.medium.air_kbps=32", "radio.bit_rate_bps=32e3"], []),
        (
            ["radio=telemetry-915", "radio.medium.ecc=true"],
            ["with ecc true (medium.ecc), and have the errors of coding none (error.coding)"],
        ),
        (["radio=telemetry-915", "radio.medium.ecc=true", "radio.error.coding=golay"], []),
        pytest.param(
            ["radio=elrs-900-200", "radio.medium.mode=900-25"],
            ["at 0.00213689 Mb/s (medium.mode), and have the errors of 0.0146 Mb/s (bit_rate_bps)"],
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_modem_of_another_rate_or_code_than_its_errors_is_warned_of(
    changes: list[str], warnings: list[str]
) -> None:
    found = plan_with(*changes, "transmit.every_ticks=200")["warnings"]
    assert [each for each in found if each.startswith(LASTS)] == [LASTS + each for each in warnings]


JAMMED = """\
schema: 1
name: jammed
duration_s: 60
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: {preset: wifi-2.4, propagation: PROPAGATION}
nodes:
  - {id: 0, home: {north_m: 300}, agent: {type: still}}
  - {id: mast, kind: ground, place: {north_m: 0, height_m: 35}, agent: {type: still}}
  - {id: jammer, kind: emitter, place: {north_m: 1000, height_m: 100}, frequency_hz: 2.437e9, power_dbm: 60}
"""


def held(propagation: str) -> list[str]:
    warnings = plan_of(parse_scenario(JAMMED.replace("PROPAGATION", propagation), "jammed.yaml")).warnings
    return [line for line in warnings if "never pause are a carrier" in line]


@pytest.mark.slow
def test_nodes_that_an_emitter_holds_back_are_told_with_what_they_take_in() -> None:
    """Free space: 60 dBm over 978.7 m and 706.9 m at 2.437 GHz, antennas and cable as of the preset, and no filter."""
    (line,) = held("{model: free-space}")
    assert "at the first place of node 0 (" in line
    assert ", mast (" in line


@pytest.mark.parametrize(
    "slots", ["slot_s: 0.1, slots: ['0']", "schedule: {slots: [{nodes: 0, duration_s: 0.1}]}"]
)
def test_a_node_without_a_slot_is_told_before_it_transmits(slots: str) -> None:
    plan = plan_with(
        f"radio={{preset: telemetry-915, medium: {{model: tdma, {slots}}}}}", "transmit.every_ticks=20"
    )
    shares = {node["node"]: node["airtime_share"] for node in plan["load"]["nodes"]}
    assert shares["0"] > 0.0 == shares["1"]
    told = [line for line in plan["warnings"] if "slot" in line]
    assert told == [
        "node 1: it has no slot of the medium tdma, and only listens: nothing that it transmits would be delivered"
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("carrier", "heard"), [("2.437e9", True), ("2.446e9", True), ("5.8e9", False)])
def test_an_emitter_that_nothing_hears_is_warned_of(carrier: str, heard: bool) -> None:
    text = JAMMED.replace("PROPAGATION", "{model: free-space}").replace("2.437e9", carrier)
    told = [
        line for line in plan_of(parse_scenario(text, "jammed.yaml")).warnings if "emitter jammer" in line
    ]
    wanted = "emitter jammer at 5800 MHz is heard by no radio and no sensor; radios are at 2437 MHz"
    assert told == ([] if heard else [wanted])


@pytest.mark.slow
def test_an_emitter_that_a_sensor_hears_is_not_warned_of() -> None:
    sensor = "sensor: {radio: wifi-2.4, band_hz: [5.7e9, 5.9e9]}, agent: {type: still}}"
    text = JAMMED.replace("PROPAGATION", "{model: free-space}").replace("2.437e9", "5.8e9")
    text = text.replace("agent: {type: still}}", sensor, 1)
    assert not [line for line in plan_of(parse_scenario(text, "jammed.yaml")).warnings if "jammer" in line]


@pytest.mark.slow
def test_sensors_that_measure_no_emitter_are_warned_of() -> None:
    """MHz for Hz, say: beside the one of the mast, which hears it, two never would report anything."""
    told = {"0": "{band_hz: [2400, 2500]}", "mast": "{radio: wifi-2.4}"}
    text = JAMMED.replace("PROPAGATION", "{model: free-space}")
    for node, sensor in told.items():
        text = text.replace(f"id: {node},", f"id: {node}, sensor: {sensor},")
    text += "  - {id: 1, home: {north_m: 350}, sensor: {band_hz: [2400, 2500]}, agent: {type: still}}\n"
    lines = [line for line in plan_of(parse_scenario(text, "jammed.yaml")).warnings if "sensor" in line]
    assert lines == [
        "sensor of node 0, 1: no emitter has its frequency in its band, 0.0024 to 0.0025 MHz (sensor.band_hz)"
    ]


@pytest.mark.slow
def test_a_law_that_refuses_a_place_on_the_ground_ends_no_plan() -> None:
    """rma-av is for a base of 35 m and UA from 1.5 m on: a UA at home is lower, the mast is what it is made for."""
    refused, clamped = held("{model: rma-av}"), held("{model: rma-av, outside: clamp}")
    assert all("node 0" not in line for line in refused)
    assert any("mast (" in line for line in [*refused, *clamped])
