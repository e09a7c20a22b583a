"""Packets that are too weak to be locked on to: from the scenario's medium to record, books, report and plan."""

import json
from dataclasses import asdict
from math import erf, log10, pi, sqrt
from typing import Any

import pytest

from bridge.scenario.file import parse_scenario
from lostlink import redecide
from lostlink.plan.output import lines_of
from lostlink.plan.plan import plan_of
from lostlink.redecision.rewrite import write_deliveries
from tests.integration.bridge.radio.test_air import RADIO, SCENARIO, Flown, balances, flown, node, rows

__all__ = ["flown"]
LEVEL_DBM, SIGMA_DB, WAY_M = -82.0, 3.0, 3300.0
NAMED = {"model": "csma", "standard": "11a", "rate_mbps": 6.0, "preamble_dbm": LEVEL_DBM}
SHADOWED = RADIO | {
    "shadowing": {"model": "normal", "sigma_db": SIGMA_DB},
    "earth_radius_factor": None,
}
"""915 MHz, 20 dBm, a noise floor of -116.9 dBm, and 10 dB over it are enough: -82 dBm is at 3286 m."""
NODES = [node(0, 0.0), node(1, WAY_M, sends=[(0.5 + 0.05 * k, "all", 100) for k in range(200)])]


@pytest.mark.slow
def test_what_is_too_weak_for_its_receiver_has_a_cause_of_its_own(flown: Flown) -> None:
    run = flown(NODES, NAMED, radio=SHADOWED, duration_s=12.0)
    found = rows(run, "g1", "0")
    weak = found.received_power_dbm < LEVEL_DBM
    assert (found[weak].fate == "below_preamble").all()
    assert (found[~weak].fate == "delivered").all()
    assert set(found.per) == {0.0}
    assert balances(run)

    mean_dbm = 20.0 - 20.0 * log10(4.0 * pi * WAY_M * 915e6 / 299_792_458.0)
    predicted = 0.5 * (1.0 + erf((mean_dbm - LEVEL_DBM) / SIGMA_DB / sqrt(2.0)))
    [row] = [each for each in run.summary["bins"] if each["tx"] == "g1"]
    assert row["of"] == "transmissions"
    assert row["predicted"] == pytest.approx(predicted, abs=1e-3)
    lost = run_lost(run)  # the two first packets begin at once: bins have them as they were alone on the air
    assert row["sent"] - row["delivered"] == pytest.approx(lost["below_preamble"], abs=1)
    assert row["ci99"][0] <= row["measured"] <= row["ci99"][1]

    checks = {check["name"]: check for check in run.summary["checks"]}
    sent, alone = (sum(each[key] for each in run.summary["bins"]) for key in ("sent", "delivered"))
    assert (checks["noise"]["size"], checks["certain fates"]["size"]) == (sent, alone)
    assert "too weak for their receivers to lock on to (below_preamble)" in run.summary["verdict"]

    again = redecide(run.path)
    assert again.comparison.is_same
    write_deliveries(again, run.path.parent / "again")
    written, read = (path / "deliveries.parquet" for path in (run.path.parent / "again", run.path))
    assert written.read_bytes() == read.read_bytes()
    heard = redecide(run.path, radio=SHADOWED | {"medium": NAMED | {"preamble_dbm": None}})
    assert not any(link.lost["below_preamble"] for link in heard.ledger.links.values())


def run_lost(run: Any) -> dict[str, int]:
    [link] = [link for link in run.summary["links"] if link["tx"] == "g1"]
    lost: dict[str, int] = link["lost"]
    return lost


def test_a_level_that_is_not_given_is_that_of_noise(flown: Flown) -> None:
    """And it has no name in the table of deliveries: nothing can be lost by it."""
    medium = {name: value for name, value in NAMED.items() if name != "preamble_dbm"}
    run = flown(
        [*NODES[:1], node(1, WAY_M, sends=[(0.5, "all", 100)])], medium, radio=SHADOWED, duration_s=2.0
    )
    assert rows(run, "g1", "0").fate.tolist() == ["delivered"]
    assert not (run.packets.fate == "below_preamble").any()


def test_a_plan_says_where_receivers_hear_nothing_more() -> None:
    plain = SHADOWED | {"shadowing": {"model": "none"}}
    content = SCENARIO | {
        "radio": plain | {"medium": NAMED},
        "nodes": [{"id": 0, "agent": {"type": "still"}}],
    }
    plan = plan_of(parse_scenario(json.dumps(content), "plan.json"))
    preamble = plan.radio.reach.preamble
    assert preamble is not None
    assert asdict(preamble) == {
        "level_dbm": LEVEL_DBM,
        "distance_m": 3280.0,
        "erasure_m": pytest.approx(57_700, rel=0.01),
    }
    assert plan.radio.reach.distance_m == {"0.9": 3280.0, "0.5": 3280.0, "0.1": 3280.0}
    [line] = [line for line in lines_of(plan) if "medium.preamble_dbm" in line]
    assert "below -82 dBm (medium.preamble_dbm), which the mean power is beyond 3280 m" in line
    far = SCENARIO | {
        "radio": plain | {"medium": NAMED | {"preamble_dbm": None}},
        "nodes": [{"id": 0, "agent": {"type": "still"}}],
    }
    assert plan_of(parse_scenario(json.dumps(far), "plan.json")).radio.reach.preamble is None
