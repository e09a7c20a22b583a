"""Modems of radios with rules of their own, from scenario file to record: several SiK on one NETID, and ExpressLRS."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from lostlink import load_run
from standin.vehicle.parameters import TABLE
from tests.integration.bridge.mavlink.scripted_station import Said, flown, out_of
from tests.warm import run_lostlink

SCENARIO = """schema: 1
name: {name}
seed: 5
speed: max
duration_s: {duration_s}
figure: false
origin: {{lat_deg: 47.0, lon_deg: 8.0, alt_amsl_m: 500}}
radio: perfect
networks: {{telemetry: {radio}}}
ports: {{first_slot: {slot}}}
zenoh: false
mcap: {{write: false}}
nodes:
  - {{id: gcs, kind: ground, place: {{east_m: 20}}, modems: {{telemetry: {{serve: [pty]}}}}, agent: {{type: still}}}}
  - id: 0
    count: {count}
    home: {{line: {{spacing_m: 10}}}}
    modems: {{telemetry: {{serial: 1}}}}
    agent: {{type: still}}
"""
DURATION_S, FROM_S, PERIOD_S = 18, 4.0, 0.7
SIK = "{preset: sik-433, medium: {units: {25: [gcs, UNITS]}}}"
ELRS_S, ELRS_PERIOD_S = 10, 0.011
"""ExpressLRS sends RADIO_STATUS when more than 10 ms by a clock of milliseconds have passed."""


def requests(count: int) -> Said:
    """A parameter list of each UA in turn, and streams, asked for again and again."""
    said: Said = []
    for turn in range(int((DURATION_S - FROM_S - 2.0) / PERIOD_S)):
        at_s, sysid = FROM_S + PERIOD_S * turn, turn % count + 1
        said += [
            (at_s, mav.MAVLink_param_request_list_message(sysid, 1)),
            (at_s + 0.2, mav.MAVLink_request_data_stream_message(sysid, 1, 0, 4, 1)),
        ]
    return said


def share_answered(run: Path, said: Said) -> float:
    """Of the lists that were asked for: to which the UA sent a parameter within 2 s."""
    came = [(at_s, each.get_srcSystem()) for at_s, each in out_of(run, "gcs", "PARAM_VALUE")]
    asked = [(at_s, each.target_system) for at_s, each in said if each.get_type() == "PARAM_REQUEST_LIST"]
    answered = [any(to == by and at_s < then_s < at_s + 2.0 for then_s, by in came) for at_s, to in asked]
    return sum(answered) / len(answered)


def lost_share(summary: dict[str, Any]) -> float:
    """Of what UA sent over the modems: what did not come to the station."""
    links = [link for link in summary["links"] if link["radio"] == "telemetry" and link["rx"] == "gcs"]
    return 1.0 - sum(link["delivered"] for link in links) / sum(link["sent"] for link in links)


def flown_again(run: Path, tmp_path: Path, slot: int, processes: str = "auto") -> dict[str, Any]:
    command = ["refly", str(run), "--out", str(tmp_path / "again"), "--json"]
    command += ["--first-slot", str(slot), "--zenoh-port", "0", "--processes", processes]
    done = run_lostlink(*command)
    assert done.returncode == 0, done.stderr
    content: dict[str, Any] = json.loads(done.stdout)
    return content


@pytest.mark.long
def test_three_copters_on_one_netid_lose_what_one_does_not(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    """Beside one copter: half of the telemetry is lost, and most requests for parameters time out; it repeats."""
    runs = {}
    for count, units in ((1, "0"), (3, "0, 1, 2")):
        radio = SIK.replace("UNITS", units)
        values = {"name": f"on{count}", "duration_s": DURATION_S, "radio": radio, "count": count}
        runs[count] = flown(SCENARIO.format(**values, slot=free_slot(3)), tmp_path, requests(count))
    alone, three = (share_answered(run, requests(count)) for count, (run, _) in runs.items())
    assert alone > 0.9
    assert three < 0.5
    assert lost_share(runs[1][1]) < 0.1
    assert lost_share(runs[3][1]) > 0.3
    causes = {cause for link in runs[3][1]["links"] if link["radio"] == "telemetry" for cause in link["lost"]}
    assert {"collided", "half_duplex"} <= causes
    run, summary = runs[3]
    again = flown_again(run, tmp_path, free_slot(3))
    assert again["difference"] is None
    assert again["summary"]["digests"] == summary["digests"]


@pytest.mark.slow
def test_a_station_hears_its_own_modem_while_the_copter_is_gone(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    """What users miss in QGroundControl 5933: a status for each of its heartbeats, whoever is there."""
    gone_s, forgets_s, duration_s = 4, 4, 14
    values = {"name": "gone", "duration_s": duration_s, "radio": "{preset: sik-433, bursts: {model: none}}"}
    scenario = SCENARIO.format(**values, count=1, slot=free_slot(1))
    text = scenario.replace(
        "    count: 1\n", f"    count: 1\n    radio_off: [{{from_s: {gone_s}, to_s: {duration_s}}}]\n"
    )
    run, _ = flown(text, tmp_path, [])
    beats = [at_s for at_s, each in out_of(run, "gcs", "HEARTBEAT") if each.get_srcSystem() == 1]
    assert gone_s - 1.5 < max(beats) < gone_s + 0.5
    told = out_of(run, "gcs", "RADIO_STATUS")
    assert {(each.get_srcSystem(), each.get_srcComponent()) for _, each in told} == {(51, 68)}
    assert [int(at_s) for at_s, _ in told] == list(range(1, duration_s)), (
        "one for each heartbeat, within the second"
    )
    assert all(each.remrssi for at_s, each in told if 1.5 < at_s < gone_s)
    assert not any(each.remrssi for at_s, each in told if at_s > gone_s + forgets_s)


@pytest.mark.slow
@pytest.mark.parametrize("radio", ["sik-433", "elrs-900-200"])
def test_modems_lose_units_to_the_causes_that_the_links_have(
    radio: str, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    settings = f"{{preset: {radio}, base_loss: 0.3}}"
    values = {"name": "causes", "duration_s": 12, "radio": settings, "count": 1}
    said: Said = [(4.0 + turn, mav.MAVLink_request_data_stream_message(1, 1, 0, 4, 1)) for turn in range(4)]
    _, summary = flown(SCENARIO.format(**values, slot=free_slot(1)), tmp_path, said)
    links = {link["tx"]: link for link in summary["links"] if link["radio"] == "telemetry"}
    counts = summary["counters"]["router"]
    for node, link in links.items():
        head = f"modem.telemetry.{node}.units_lost."
        lost = {name.removeprefix(head): count for name, count in counts.items() if name.startswith(head)}
        assert lost == {cause: count for cause, count in link["lost"].items() if cause != "run_ended"}
    assert sum(links["0"]["lost"].values()) > 5
    assert ("base_loss" in links["0"]["lost"]) == (radio == "sik-433")


LISTENS = """
from bridge.agents import Agent


class Listens(Agent):
    async def fly(self):
        self.log("listens", 1)
        self.ua.radios["telemetry"].on_reply(lambda reply: self.log("reply", reply.seq))
        await self.sleep(4.0)
"""


@pytest.mark.slow
def test_what_becomes_of_a_modems_frames_is_told_no_agent(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    """They are unicasts, which csma acknowledges; the agent at the node has not sent them."""
    (tmp_path / "mine.py").write_text(LISTENS, encoding="utf-8")
    values = {"name": "told", "duration_s": 3, "radio": "wifi-2.4", "count": 1}
    text = SCENARIO.format(**values, slot=free_slot(1))
    text = text.replace("agent: {type: still}}", "agent: {type: own, class: 'mine.py:Listens'}}", 1)
    run, summary = flown(text, tmp_path, [])
    (link,) = (each for each in summary["links"] if each["radio"] == "telemetry" and each["tx"] == "gcs")
    assert link["delivered"] > 0
    assert load_run(run).agent_data.name.tolist() == ["listens"]


@pytest.mark.slow
def test_what_is_for_one_node_is_acknowledged_and_tried_again(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    """Of two modems the station's frames are for the copter, as in `lostlink modem`; the copter's are for all."""
    values = {"name": "wifi", "duration_s": 12, "radio": "{preset: wifi-2.4, base_loss: 0.3}", "count": 1}
    text = SCENARIO.format(**values, slot=free_slot(1)).replace("{serial: 1}", "{serial: 1, to: all}")
    said: Said = [(2.0 + turn / 20, mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)) for turn in range(190)]
    run, summary = flown(text, tmp_path, said)
    rows = load_run(run).packets.query("radio == 'telemetry'").groupby(["tx", "fate"], observed=True)
    assert summary["outcome"] != "fail"
    assert {fate for tx, fate in rows.groups if tx == "gcs"} == {"delivered"}
    tries = rows.attempts.mean()
    assert tries["gcs", "delivered"] == pytest.approx(1 / 0.7, rel=0.15)
    assert tries["0", "delivered"] == tries["0", "base_loss"] == 1.0
    counts = rows.size()
    assert counts["0", "base_loss"] / counts["0"].sum() == pytest.approx(0.3, abs=0.15)
    again = flown_again(run, tmp_path, free_slot(1))
    assert again["difference"] is None


@pytest.mark.slow
def test_a_copter_behind_expresslrs(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    """The station has the transmitter module, which tells it nothing; the receiver tells the autopilot at 91 Hz."""
    values = {"name": "elrs", "duration_s": ELRS_S, "radio": "elrs-900-200", "count": 1}
    said: Said = [(4.0, mav.MAVLink_param_request_list_message(1, 1))]
    run, summary = flown(SCENARIO.format(**values, slot=free_slot(1)), tmp_path, said)
    came = out_of(run, "gcs", "PARAM_VALUE")
    assert {message.param_id for _, message in came} == {row.name for row in TABLE}
    assert len(out_of(run, "gcs", "HEARTBEAT")) > 6
    assert out_of(run, "gcs", "RADIO_STATUS") == []
    told = out_of(run, "0", "RADIO_STATUS")
    assert len(told) / ELRS_S == pytest.approx(1.0 / ELRS_PERIOD_S, rel=0.02)
    assert {(each.get_srcSystem(), each.get_srcComponent()) for _, each in told} == {(255, 68)}
    assert min(each.txbuf for _, each in told) < 90
    assert {each.rssi for at_s, each in told if at_s > 2.0} <= {
        int(percent * 2.55) for percent in range(95, 101)
    }
    again = flown_again(run, tmp_path, free_slot(1))
    assert again["difference"] is None
    assert again["summary"]["digests"] == summary["digests"]
