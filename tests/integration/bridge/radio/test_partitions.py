"""Partitions, in runs: from the scenario's key to the record, on each kind of medium.

Four nodes stand within 40 m and hear each other; for a while there are two on each side. Who hears whom when is
reckoned here.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

from bridge.scenario.file import with_changes
from lostlink import redecide
from lostlink.compare.compare import compare
from lostlink.reading.moved import scenario_of
from lostlink.redecision.redecide import decide
from lostlink.redecision.rewrite import write_run
from lostlink.report.content import content_of
from tests.integration.bridge.radio.test_air import RADIO, Flown, balances, flown, node, rows, told

__all__ = ["flown"]

NODES = ("0", "g1", "g2", "g3")
SIDES = [["0", "g1"], ["g2", "g3"]]
BEGINS_S, ENDS_S = 1.0, 2.0
PARTED = {"groups": [[0, "g1"], ["g2", "g3"]], "from_s": BEGINS_S, "to_s": ENDS_S}
FIGURES = ["distance_m", "received_power_dbm", "snr_db", "per"]
TICK_S = 0.05


def four(**options: Any) -> list[dict[str, Any]]:
    """Each sends in a tick of its own, five times a second."""
    found = []
    for number in range(4):
        first_s = TICK_S * number
        sends = [(round(first_s + 0.2 * k, 3), options.get("to", "all"), 40) for k in range(1, 14)]
        found.append(node(number, 10.0 * number, sends=sends))
    return found


def are_apart(tx: str, rx: str, at_s: float) -> bool:
    return BEGINS_S <= at_s < ENDS_S and not any({tx, rx} <= set(side) for side in SIDES)


def sent_s(row: Any) -> float:
    return round(row.sim_time_ns / 1e9, 3)


MEDIA = {
    "ideal": {"model": "ideal"},
    "airtime": {"model": "airtime"},
    "tdma": {"model": "tdma", "slot_s": 0.0125, "guard_s": 0.001},
    "csma": {"model": "csma", "standard": "11g", "rate_mbps": 6},
    "delay": {"model": "delay", "least_s": 0.01, "median_s": 0.02, "most_s": 0.04, "rate_bps": 1e6},
}


@pytest.mark.parametrize("model", MEDIA)
def test_nothing_comes_from_the_other_side_and_all_else_as_ever(flown: Flown, model: str) -> None:
    run = flown(four(), MEDIA[model], partitions=[PARTED])
    apart = 0
    for tx in NODES:
        for rx in NODES:
            for row in rows(run, tx, rx).itertuples() if tx != rx else ():
                begins_s = row.started_ns / 1e9 if model == "tdma" else sent_s(row)
                expected = "partitioned" if are_apart(tx, rx, begins_s) else "delivered"
                assert row.fate == expected, (tx, rx, row)
                apart += expected == "partitioned"
    assert apart == 4 * 2 * 5
    lost = run.packets[run.packets.fate == "partitioned"]
    assert lost[FIGURES].isna().all(axis=None)
    assert balances(run)
    counts = [link["lost"].get("partitioned", 0) for link in run.summary["links"]]
    assert sum(counts) == apart
    assert run.summary["outcome"] == "pass"


def test_with_csma_a_unicast_is_tried_as_often_as_ever_and_nobody_acknowledges_it(flown: Flown) -> None:
    sends = [(at_s, "g2", 40) for at_s in (0.5, 1.5, 2.5)]
    nodes = [node(0, 0.0, sends=[(1.2, "g1", 40)]), node(1, 10.0, sends=sends), node(2, 20.0)]
    run = flown(nodes, MEDIA["csma"], partitions=[PARTED | {"groups": [[0, "g1"], ["g2"]]}])
    found = rows(run, "g1", "g2")
    assert found.fate.tolist() == ["delivered", "partitioned", "delivered"]
    assert found.attempts.tolist() == [1, 7, 1]
    assert [reply["acknowledged"] for reply in told(run, "g1", "replies")] == [True, False, True]
    assert rows(run, "0", "g1").fate.tolist() == ["delivered"]
    assert balances(run)


@pytest.mark.parametrize("model", ["airtime", "csma"])
def test_no_carrier_and_no_interference_come_from_the_other_side(flown: Flown, model: str) -> None:
    """Two neighbours give their radios 400 bytes at once, each for the one beside it."""
    sends = [(at_s, "all", 400) for at_s in (0.5, 1.5, 2.5)]
    nodes = [node(0, 0.0, sends=sends), node(1, 10.0), node(2, 20.0), node(3, 30.0, sends=sends)]
    run = flown(nodes, MEDIA[model], partitions=[PARTED])
    near, far = rows(run, "0", "g1"), rows(run, "g3", "g2")
    assert near.fate[1] == far.fate[1] == "delivered"
    assert near.started_ns[1] == far.started_ns[1]
    together = [near.started_ns[k] == far.started_ns[k] for k in (0, 2)]
    if model == "airtime":
        assert together == [True, True]
        assert {near.fate[0], near.fate[2], far.fate[0], far.fate[2]} == {"collided"}
    else:  # both wait for DIFS and see none: only the same slot lets both begin
        assert near.fate[0] == "collided" or not together[0]


def test_with_sik_bytes_are_lost_and_with_elrs_they_wait(flown: Flown) -> None:
    sends = [(round(0.5 + 0.2 * k, 3), "g1", 40) for k in range(10)]
    nodes = [node(0, 0.0, sends=sends), node(1, 10.0)]
    parted = [PARTED | {"groups": [["0"], ["g1"]]}]
    run = flown(nodes, {"model": "sik"}, partitions=parted, duration_s=4.0)
    for row in rows(run, "0", "g1").itertuples():
        expected = "partitioned" if are_apart("0", "g2", row.started_ns / 1e9) else "delivered"
        assert row.fate == expected, row
    assert set(rows(run, "0", "g1").fate) == {"partitioned", "delivered"}
    found = rows(flown(nodes, {"model": "elrs"}, partitions=parted, duration_s=4.0), "0", "g1")
    waits = found.sim_time_ns.between(1e9, 2e9, inclusive="left")
    assert waits.sum() == 5
    assert set(found.fate[~waits]) == {"delivered"}
    assert set(found.fate[waits]) == {
        "delivered",
        "partitioned",
    }  # forgotten: the transmitter found its link again
    assert (found.arrived_ns[waits & (found.fate == "delivered")] >= 2e9).all()


@pytest.mark.parametrize("routing", ["flood", "mesh"])
def test_with_routing_a_node_of_no_group_hands_packets_on_between_them(flown: Flown, routing: str) -> None:
    """Routing hands on what the groups say through `g2`, if it is in none; a mesh needs time to find that way."""
    quick = {"model": "mesh", "ogm_interval_s": 0.1} if routing == "mesh" else {"model": "flood"}
    radio = RADIO | {"bit_rate_bps": 1e6, "routing": quick}
    sends = [(4.5, "g3", 40)]
    nodes = [node(0, 0.0, sends=sends), node(1, 10.0), node(2, 20.0), node(3, 30.0)]
    more = {"radio": radio, "duration_s": 5.0}
    through = {"groups": [["0", "g1"], ["g3"]], "from_s": 0.0}
    run = flown(nodes, MEDIA["csma"], partitions=[through], **more)
    assert rows(run, "0", "g3").fate.tolist() == ["delivered"]
    ways = run.routes[(run.routes.tx == "0") & (run.routes.rx == "g3")]
    assert ways.node.astype(str).tolist()[-1] == "g2"
    shut = {"groups": [["0", "g1", "g2"], ["g3"]], "from_s": 0.0}
    run = flown(nodes, MEDIA["csma"], partitions=[shut], **more)
    assert rows(run, "0", "g3").fate.tolist() == ["no_route" if routing == "mesh" else "partitioned"]
    assert balances(run)


def test_a_flood_that_stops_behind_a_partition_is_lost_to_that(flown: Flown) -> None:
    """The last that may hand it on is nearest to the one that it is for, and could not reach it either."""
    radio = RADIO | {"routing": {"model": "flood", "hop_limit": 1}}
    nodes = [node(0, 0.0, sends=[(1.5, "g3", 40)]), node(1, 10.0), node(3, 30.0)]
    parted = PARTED | {"groups": [["0", "g1"], ["g3"]]}
    run = flown(nodes, MEDIA["airtime"], radio=radio, partitions=[parted])
    assert rows(run, "0", "g3").fate.tolist() == ["partitioned"]


def test_all_networks_are_parted_and_do_not_disturb_each_other_across(flown: Flown) -> None:
    """Node 0 on `main` and g3 on `other`, both within 30 m, transmit at once: each would spoil the other's frame."""
    sends = [(at_s, "all", 400) for at_s in (0.5, 1.5)]
    by_other = [(at_s, "all", 400, 0, None, "", "other") for at_s in (0.5, 1.5)]
    nodes = [node(0, 0.0, sends=sends), node(1, 20.0), node(2, 25.0), node(3, 40.0, sends=by_other)]
    for number in (0, 1):
        nodes[number]["networks"] = ["main"]
    medium = {"model": "airtime"}
    parted = PARTED | {"to_s": 9.0}
    run = flown(nodes, medium, networks={"other": RADIO | {"medium": medium}}, partitions=[parted])
    assert rows(run, "0", "g1").fate.tolist() == ["interfered", "delivered"]
    assert rows(run, "g3", "g2").fate.tolist() == ["interfered", "delivered"]
    assert rows(run, "0", "g2").fate.tolist() == ["interfered", "partitioned"]


def test_groups_of_addressees_are_their_members_and_partitions_may_overlap(flown: Flown) -> None:
    nodes = four()
    for number, group in enumerate(("a", "b", "a", "b")):
        nodes[number]["groups"] = [group]
    parted = [
        {"groups": [["a"], ["b"]], "from_s": 1.0},
        {"groups": [["g1"], ["g3"]], "from_s": 0.5, "to_s": 2.0},
    ]
    run = flown(nodes, MEDIA["ideal"], partitions=parted)
    for tx, rx, expected in (("0", "g1", 1.0), ("g3", "g2", 1.0), ("g1", "g3", 0.5)):
        ends_s = 2.0 if tx == "g1" else 9.0
        for row in rows(run, tx, rx).itertuples():
            assert (row.fate == "partitioned") == (expected <= sent_s(row) < ends_s), row
    assert set(rows(run, "0", "g2").fate) == {"delivered"}


@pytest.mark.parametrize("model", ["ideal", pytest.param("csma", marks=pytest.mark.slow)])
def test_redecide_keeps_adds_and_removes_partitions_byte_for_byte(
    flown: Flown, model: str, tmp_path: Any
) -> None:
    parted, whole = flown(four(), MEDIA[model], partitions=[PARTED]), flown(four(), MEDIA[model])
    assert redecide(parted.path).comparison.is_same
    for run, partitions, other in ((parted, [], whole), (whole, [PARTED], parted)):
        scenario = with_changes(scenario_of(run.path), {"partitions": partitions})
        result = decide(run.path, scenario)
        assert {change["packets"] for change in result.comparison.changes} == {40}
        again = write_run(result, tmp_path / f"with-{len(partitions)}").path
        name = "deliveries.parquet"
        assert (again / name).read_bytes() == (other.path / name).read_bytes()


def test_what_reads_losses_knows_them(flown: Flown) -> None:
    run, whole = (flown(four(), MEDIA["ideal"], partitions=each) for each in ([PARTED], []))
    content = content_of(run)
    assert "partitioned" in json.dumps(content, default=str)
    ledger = json.loads((run.path / "ledger.json").read_text())
    assert sum(row["sent"] for row in ledger["bins"]) == 4 * 3 * 14 - 40
    assert {row["measured"] for row in ledger["bins"]} == {1.0}
    assert compare(run.path, whole.path) is not None


def test_one_process_and_many_have_the_same_partitions(flown: Flown) -> None:
    one, many = (
        flown(four(), MEDIA["csma"], partitions=[PARTED], processes=each) for each in ("one", "many")
    )
    assert compare(one.path, many.path) is None
    assert one.digest == many.digest
