"""Nodes that hand packets on, in runs: from the scenario's radio to the record.

Nodes stand in a row, each in reach of those beside it alone; what is expected is reckoned here from lengths and rates.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from lostlink import Run, ScenarioError, load_run, redecide
from lostlink.compare.compare import compare
from lostlink.redecision.rewrite import write_run
from lostlink.report.content import content_of
from lostlink.report.page.page import page_of
from tests import warm

CLASS = f"{Path(__file__).parents[1] / 'radio' / 'air_agents.py'}:Scripted"
RADIO = {"preset": "disk", "frequency_hz": 915e6, "bit_rate_bps": 64e3, "max_range_m": 150.0}
AIRTIME = {"model": "airtime"}
FRAME_NS = 12_500_000
"""100 bytes at 64 kb/s."""
PLAIN = {"processing_s": 0.001, "jitter_s": 0.0}
SCENARIO = {
    "schema": 1,
    "name": "routing",
    "duration_s": 3.0,
    "figure": False,
    "origin": {"lat_deg": 37.0, "lon_deg": 127.0, "alt_amsl_m": 50.0},
    "fdm": {"standin_rate_hz": 100},
    "transmit": {"phase_s": 0.0, "processing_s": 0.0, "processing_spread_s": 0.0, "every_ticks": 100_000},
}
Fly = Callable[..., Run]


def node(number: int, **options: Any) -> dict[str, Any]:
    """Of a row, 100 m apart."""
    agent = {"type": "own", "class": CLASS, "options": options}
    if number == 0:  # there has to be a UA
        return {"id": 0, "kind": "ua", "home": {"north_m": 0.0}, "agent": agent}
    place = {"north_m": 100.0 * number, "height_m": 0.0}
    return {"id": f"g{number}", "kind": "ground", "place": place, "agent": agent}


@pytest.fixture
def flown(tmp_path: Path, free_slot: Callable[[int], int]) -> Fly:
    def flown(
        nodes: list[dict[str, Any]], routing: Any, medium: dict[str, Any] = AIRTIME, **more: Any
    ) -> Run:
        scenario = {
            **SCENARIO,
            "ports": {"first_slot": free_slot(1), "zenoh": 0},
            "radio": RADIO | {"medium": medium, "routing": routing},
            "nodes": nodes,
        } | more
        return warm.flown(scenario, tmp_path / f"{len(list(tmp_path.iterdir()))}")

    return flown


def rows(run: Run, tx: str, rx: str) -> list[dict[str, Any]]:
    found = run.packets
    chosen = found[(found.tx == tx) & (found.rx == rx) & (found.channel == "test")]
    records: list[dict[str, Any]] = chosen.sort_values("seq").to_dict("records")
    return records


def ways(run: Run, tx: str, rx: str) -> list[list[str]]:
    """By which nodes packets came, as it changed."""
    table = run.routes
    chosen = table[(table.tx == tx) & (table.rx == rx)]
    return [part.sort_values("hop").node.astype(str).tolist() for _, part in chosen.groupby("arrived_ns")]


def ledger(run: Run) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((run.path / "ledger.json").read_text())
    return content


def balances(run: Run) -> bool:
    table = run.packets.groupby(["tx", "rx"], observed=True).packets.sum()
    return all(
        link["sent"] == link["delivered"] + sum(link["lost"].values()) == table[link["tx"], link["rx"]]
        for link in ledger(run)["links"]
    )


ROUTES = {"0": {"g3": "g1", "g2": "g1"}, "g1": {"g3": "g2"}, "g3": {"0": "g2"}, "g2": {"0": "g1"}}


def test_without_routing_only_the_neighbour_hears(flown: Fly) -> None:
    run = flown([node(0, sends=[(1.0, "g3", 100)]), node(1), node(2), node(3)], "none")
    assert [row["fate"] for row in rows(run, "0", "g3")] == ["out_of_range"]
    assert "routing" not in ledger(run)
    assert not (run.path / "routes.parquet").exists()


def test_static_routes_from_scenario_to_record(flown: Fly) -> None:
    """Three hops there, at once on the air, 1 ms in each node between; and back."""
    sends = [(1.0, "g3", 100), (1.5, "g1", 100), (2.0, "all", 100)]
    routing = {"model": "static", "routes": ROUTES, "header_bytes": 0} | PLAIN
    run = flown([node(0, sends=sends), node(1), node(2), node(3, sends=[(1.2, "0", 100)])], routing)
    [there], [back] = rows(run, "0", "g3")[:1], rows(run, "g3", "0")[:1]
    for row in (there, back):
        assert (row["fate"], row["attempts"]) == ("delivered", 3)
        assert row["arrived_ns"] - row["entered_ns"] == pytest.approx(3 * FRAME_NS + 2_000_000, abs=2_000)
        assert row["distance_m"] == pytest.approx(100.0, abs=0.5)  # of the last hop
    assert ways(run, "0", "g3") == [["0", "g1", "g2"]]
    assert ways(run, "g3", "0") == [["g3", "g2", "g1"]]
    assert [row["fate"] for row in rows(run, "0", "g1")] == ["delivered"] * 2
    assert rows(run, "0", "g2")[-1]["fate"] == "out_of_range"  # what is for all goes as far as it is heard
    [counts] = ledger(run)["routing"]
    assert (counts["radio"], counts["handed_on"], counts["notices"]) == ("main", 4, 0)
    assert balances(run)


def test_a_flood_from_scenario_to_record(flown: Fly) -> None:
    """Two hops: node 2 hears, node 3 does not; each has it once."""
    routing = {"model": "flood", "hop_limit": 2, "header_bytes": 0} | PLAIN
    run = flown([node(0, sends=[(1.0, "all", 100)]), node(1), node(2), node(3)], routing)
    found = {rx: rows(run, "0", rx) for rx in ("g1", "g2", "g3")}
    assert {rx: [row["fate"] for row in each] for rx, each in found.items()} == {
        "g1": ["delivered"],
        "g2": ["delivered"],
        "g3": ["hop_limit"],
    }
    [row] = found["g2"]
    assert row["arrived_ns"] - row["entered_ns"] == pytest.approx(2 * FRAME_NS + 1_000_000, abs=2_000)
    assert found["g3"][0]["distance_m"] == pytest.approx(100.0, abs=0.5)  # of the hop that brought it to g2
    heard = (run.path / "agents" / "g2" / "heard.jsonl").read_text().splitlines()
    assert [each["seq"] for each in map(json.loads, heard) if each["sender"] == "0"] == [row["seq"]]
    assert ways(run, "0", "g2") == [["0", "g1"]]
    assert balances(run)
    told = content_of(run)
    [route] = [each for each in told["routes"] if (each["tx"], each["rx"]) == ("0", "g2")]
    assert (route["way"], route["hops_mean"], route["delivered"]) == (["0", "g1"], 2.0, 1)
    assert told["routing"] == ledger(run)["routing"]
    [air] = run.summary["air"]
    frames = told["routing"][0]["sent"] + told["routing"][0]["handed_on"]
    assert frames == 4 + 2  # the data packages at the first tick are all at once, and nobody hears them
    assert air["use_share"] == pytest.approx(told["routing"][0]["packet_air_ns"] / 3.05e9)
    page = page_of(told, {})
    assert "0 &gt; g1 &gt; g2" in page
    assert "What routing cost" in page


def test_a_mesh_from_scenario_to_record(flown: Fly) -> None:
    """Messages of 24 bytes take 3 ms; at 0.06 s no node knows a way, after eight intervals each does."""
    sends = [(0.06, "g3", 20), (4.0, "g3", 100), (4.5, "all", 50)]
    routing = {"model": "mesh", "ogm_interval_s": 0.5} | PLAIN
    slots = {"model": "tdma", "slot_s": 0.02}
    run = flown([node(0, sends=sends), node(1), node(2), node(3)], routing, slots, duration_s=6.0)
    early, routed, flooded = rows(run, "0", "g3")
    assert (early["fate"], early["started_ns"], early["attempts"]) == ("no_route", -1, 0)
    assert (routed["fate"], routed["attempts"]) == ("delivered", 3)
    hop_ns = round(8 * (100 + 24) / 64e3 * 1e9)
    assert routed["arrived_ns"] - routed["entered_ns"] >= 3 * hop_ns + 2_000_000
    assert routed["ended_ns"] - routed["started_ns"] == hop_ns
    assert flooded["fate"] == "delivered"
    assert ways(run, "0", "g3")[0] == ["0", "g1", "g2"]
    for receiver in ("g1", "g2", "g3"):  # what is for all is transmitted three times by each, and comes once
        lines = (run.path / "agents" / receiver / "heard.jsonl").read_text().splitlines()
        heard = [(each["sender"], each["seq"]) for each in map(json.loads, lines)]
        assert ("0", flooded["seq"]) in heard
        assert len(heard) == len(set(heard))
    [counts] = ledger(run)["routing"]
    own, by_neighbours = 4 * 6.0 / 0.5, (1 + 2 + 2 + 1) * 6.0 / 0.5
    # in a row each node transmits each message once
    assert own + 0.9 * by_neighbours < counts["notices"] <= 4 * own
    assert counts["notice_air_ns"] == 3_000_000 * counts["notices"]
    assert balances(run)


@pytest.mark.slow
def test_a_relay_whose_radio_goes_off_is_left_in_five_messages(flown: Fly) -> None:
    """Two relays between the ends, on both sides of the way: 112 m to each end, of 150 m that the radio reaches."""
    silent_s, interval_s = 6.0, 0.2
    sends = [(4.0 + 0.05 * number, "end", 20) for number in range(100)]
    ends = [node(0, sends=sends), node(2) | {"id": "end"}]

    def run(off: str = "") -> Run:
        relays = [
            node(1) | {"id": name, "place": {"north_m": 100.0, "east_m": east_m, "height_m": 0.0}}
            for name, east_m in (("east", 50.0), ("west", -50.0))
        ]
        for relay in relays:
            if relay["id"] == off:
                relay["radio_off"] = [{"from_s": silent_s}]
        routing = {"model": "mesh", "ogm_interval_s": interval_s} | PLAIN
        medium = {"model": "csma"}
        return flown([*ends, *relays], routing, medium, duration_s=9.5)

    [used] = {way[1] for way in ways(run(), "0", "end")[-1:]}
    broken = run(off=used)
    found = pd.DataFrame(rows(broken, "0", "end"))
    came = found[found.fate == "delivered"]
    other = {"east": "west", "west": "east"}[used]
    assert ways(broken, "0", "end")[-1] == ["0", other]
    after_s = came[came.arrived_ns > silent_s * 1e9].arrived_ns.min() / 1e9 - silent_s
    assert 0.0 < after_s < 5 * (interval_s + 0.02) + 0.05 + 0.1
    assert set(found[found.fate != "delivered"].fate) == {"radio_off"}
    assert balances(broken)


def test_each_network_has_its_own_way(flown: Fly) -> None:
    """On `main` nothing is handed on; on the other a flood brings the same to node 2."""
    sends = [(1.0, "g2", 100), (1.5, "g2", 100, 0, None, "", "backbone")]
    backbone = RADIO | {"frequency_hz": 433e6, "medium": AIRTIME, "routing": "flood"}
    nodes = [node(0, sends=sends), node(1), node(2)]
    run = flown(nodes, "none", networks={"backbone": backbone})
    plain, routed = rows(run, "0", "g2")
    assert (plain["radio"], plain["fate"]) == ("main", "out_of_range")
    assert (routed["radio"], routed["fate"]) == ("backbone", "delivered")
    assert run.routes[["radio", "hop", "node"]].astype(str).to_numpy().tolist() == [
        ["backbone", "1", "0"],
        ["backbone", "2", "g1"],
    ]
    assert [each["radio"] for each in ledger(run)["routing"]] == ["backbone"]
    again = redecide(run.path)
    pd.testing.assert_frame_equal(again.table.to_pandas(), run.table("deliveries").to_pandas())
    assert [radio for radio, _ in again.routes] == ["backbone"]


def test_a_way_of_ones_own(flown: Fly) -> None:
    own = {"class": f"{Path(__file__).with_name('own_routing.py')}:StarRouting", "hub": "g1"} | PLAIN
    run = flown([node(0, sends=[(1.0, "g2", 100), (1.5, "all", 100)]), node(1), node(2)], own)
    assert ways(run, "0", "g2") == [["0", "g1"]]
    assert [row["fate"] for row in rows(run, "0", "g2")] == ["delivered", "out_of_range"]
    with pytest.raises(ScenarioError, match=r"radio\.routing\.hub: is required, and missing"):
        flown([node(0), node(1)], {key: value for key, value in own.items() if key != "hub"})


def scripted(flown: Fly, routing: dict[str, Any], **more: Any) -> Run:
    sends = {n: [(1.0 + 0.2 * k, "all" if k % 3 else "g3", 150 + n) for k in range(8)] for n in (0, 1, 2)}
    nodes = [node(n, sends=sends.get(n, [])) for n in range(4)]
    medium = {"model": "csma", "standard": "11g"}
    return flown(nodes, routing, medium, **more)


FATES = ["tx", "rx", "seq", "fate", "started_ns", "ended_ns", "arrived_ns", "attempts"]


def fates(run: Run) -> pd.DataFrame:
    found = run.packets.astype(dict.fromkeys(("tx", "rx", "fate"), str))
    return found[found.channel == "test"][FATES].sort_values(["tx", "rx", "seq"], ignore_index=True)


WAYS = [
    {"model": "flood", "hop_limit": 4},
    {"model": "static", "routes": ROUTES},
    {"model": "mesh", "ogm_interval_s": 0.2},
]
each_way = pytest.mark.parametrize(
    "routing",
    [
        pytest.param(
            way, id=str(way["model"]), marks=[pytest.mark.slow, pytest.mark.long] * (way is not WAYS[2])
        )
        for way in WAYS
    ],
)


@each_way
@pytest.mark.slow
def test_one_process_and_many_have_the_same_routes(flown: Fly, routing: dict[str, Any]) -> None:
    one = scripted(flown, routing)
    many = scripted(flown, routing, processes="many")
    assert compare(one.path, many.path) is None
    assert one.digest == many.digest
    assert len(one.routes)
    assert balances(one)


@pytest.mark.slow
@each_way
def test_fates_do_not_depend_on_ticks(flown: Fly, routing: dict[str, Any]) -> None:
    """The nodes stand."""
    first = fates(scripted(flown, routing))
    assert len(first) == 3 * (5 * 3 + 3)
    assert len(set(first.fate)) > 1
    for rate_hz in (5, 50):
        pd.testing.assert_frame_equal(first, fates(scripted(flown, routing, tick_rate_hz=rate_hz)))


@pytest.mark.slow
@each_way
def test_decided_anew_the_same_radio_gives_the_same_routes(
    flown: Fly, routing: dict[str, Any], tmp_path: Path
) -> None:
    run = scripted(flown, routing)
    again = redecide(run.path)
    pd.testing.assert_frame_equal(again.table.to_pandas(), run.table("deliveries").to_pandas())
    made = write_run(again, tmp_path / "anew")
    assert load_run(made.path).table("routes").equals(run.table("routes"))
    none = redecide(run.path, radio=RADIO | {"medium": {"model": "csma"}})
    assert none.routes == ()


@pytest.mark.parametrize(
    ("routing", "problem"),
    [
        ({"model": "flood", "hop_limit": 0}, r"radio\.routing\.hop_limit: .*0"),
        ({"model": "flood", "hops": 3}, r"radio\.routing\.hops"),
        ({"model": "gossip"}, r"radio\.routing.*gossip"),
        ("mish", r"radio\.routing.*mish"),
        ({"model": "static"}, r"radio\.routing\.routes"),
        ({"model": "static", "routes": {"0": {"g1": "g7"}}}, r"radio\.routing: routes\.0\.g1: g7: node g7"),
        (
            {"model": "static", "routes": {"0": {"g2": "g1"}, "g1": {"g2": "0"}}},
            r"radio\.routing\.routes: .*0: g2: leads back: 0 > g1 > 0",
        ),
        ({"model": "static", "routes": {"0": {"g2": "0"}}}, r"a node needs no route to itself"),
        ({"model": "mesh", "hop_penalty": 256}, r"radio\.routing\.hop_penalty: .*256"),
        ({"model": "mesh", "ogm_interval_s": 0.01}, r"radio\.routing\.ogm_interval_s: .*0\.01"),
    ],
)
def test_what_routing_cannot_be_is_told(flown: Fly, routing: Any, problem: str) -> None:
    with pytest.raises(ScenarioError, match=problem):
        flown([node(0), node(1), node(2)], routing)


@pytest.mark.parametrize(
    ("medium", "word"), [("ideal", "takes time on the air"), ("sik", "one peer"), ("elrs", "one peer")]
)
def test_media_without_hops_are_refused(flown: Fly, medium: str, word: str) -> None:
    with pytest.raises(ScenarioError, match=rf"radio.*routing: flood: .*medium: {medium}.*{word}|{word}"):
        flown([node(0), node(1)], {"model": "flood"}, {"model": medium})


def test_nodes_of_a_network_have_one_way_of_routing(flown: Fly) -> None:
    other = node(1) | {"radio": RADIO | {"medium": AIRTIME}}
    with pytest.raises(
        ScenarioError, match=r"nodes\.g1\.radio: its routing is none, that of the run's radio flood"
    ):
        flown([node(0), other], {"model": "flood"})
