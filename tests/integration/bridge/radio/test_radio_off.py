"""Radios that are off: by the scenario, and by an operator over Zenoh; in the record, in a replay, and flown again."""

from __future__ import annotations

import json
import queue
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.bus.keys import Keys
from bridge.bus.messages import CommandEvent, Links, decode
from bridge.bus.radio_command import radio_goal
from bridge.bus.session import Session
from bridge.record.tables.deliveries import DELIVERIES
from lostlink import connect_ua, load_run
from lostlink.redecision.redecide import redecide
from lostlink.redecision.rewrite import write_deliveries
from lostlink.replay.player import Player
from tests.integration.bridge.conftest import STILL, Run, StartRun
from tests.integration.bridge.record.test_refly import refly

S = 1_000_000_000
GROUND = "  - {{id: gcs, kind: ground, place: {{east_m: 200}}, agent: {{type: still}}}}\n"
THREE = STILL + GROUND
SCRIPTED = (STILL + GROUND.replace("kind: ground", "kind: ground, radio_off: [{{from_s: 4.5}}]")).replace(
    "north_m: 410}}", "north_m: 410}}, radio_off: [{{from_s: 1, to_s: 2.5}}, {{from_s: 3, to_s: 3.1}}]"
)
WAIT_S = 30.0
Outages = dict[str, list[tuple[int, int]]]


def check_fates(run: Run, outages: Outages) -> int:
    """Packets of an end within its outages are lost to that cause, and no others; returns how many those are."""
    rows = load_run(run.directory).packets
    ends = zip(rows.tx, rows.rx, rows.sim_time_ns, strict=True)
    expected = [
        any(begin <= at_ns < end for node in (tx, rx) for begin, end in outages.get(node, ()))
        for tx, rx, at_ns in ends
    ]
    assert [fate == "radio_off" for fate in rows.fate] == expected
    off = rows[expected]
    figures = ["distance_m", "received_power_dbm", "snr_db", "per"]
    assert off[figures].isna().all(axis=None)
    links = run.summary["links"]
    assert sum(link["lost"].get("radio_off", 0) for link in links) == len(off)
    assert all(link["sent"] == link["delivered"] + sum(link["lost"].values()) for link in links)
    assert {link["sent"] for link in links} == {len(rows) // 6}
    return len(off)


@pytest.mark.slow
def test_a_scenarios_outages_are_in_its_record_and_stay_whatever_radio_decides(
    start_run: StartRun, tmp_path: Path
) -> None:
    run = start_run(scenario=SCRIPTED, duration_s=6.0)
    assert run.finish() == 0, run.output.decode()
    outages: Outages = {"1": [(S, 5 * S // 2), (3 * S, 31 * S // 10)], "gcs": [(9 * S // 2, 99 * S)]}
    lost = check_fates(run, outages)
    assert lost == (30 + 2) * 4 + 31 * 4
    assert run.summary["outcome"] == "pass"
    again = redecide(run.directory)
    assert again.comparison.is_same
    write_deliveries(again, tmp_path / "again")
    written = DELIVERIES.parquet_path(tmp_path / "again").read_bytes()
    assert written == DELIVERIES.parquet_path(run.directory).read_bytes()
    other = redecide(run.directory, radio="perfect").comparison
    assert sum(link.lost_after.get("radio_off", 0) for link in other.links) == lost
    assert {change["before"] for change in other.changes} == {"channel_erasure"}
    player = Player.open(run.directory)
    off = {second: player.seek(round(second * S)).links().radio_off for second in (0.5, 1.0, 2.45, 2.5, 4.5)}
    assert {second: list(nodes) for second, nodes in off.items()} == {
        0.5: [],
        1.0: [1],
        2.45: [1],
        2.5: [],
        4.5: [2],
    }


class Watched:
    """Which radios are off, by the run's own reports."""

    def __init__(self, session: Session, keys: Keys) -> None:
        self._reports: queue.SimpleQueue[Links] = queue.SimpleQueue()
        session.subscribe(
            keys.tick("links"), lambda sample: self._reports.put(decode(sample.payload.to_bytes(), Links))
        )
        self.seen: list[Links] = []

    def wait_for(self, *off: str) -> None:
        """Wait until a report says that these are off, and no others."""
        while True:
            report = self._reports.get(timeout=WAIT_S)
            self.seen.append(report)
            if {report.node[number] for number in report.radio_off} == set(off):
                return


def command(session: Session, keys: Keys, node: str, *, on: bool) -> CommandEvent:
    """As an operator: switch a node's radio; returns the result."""
    events: queue.SimpleQueue[CommandEvent] = queue.SimpleQueue()
    session.query(
        keys.command(node, "radio"),
        radio_goal(on=on),
        lambda reply: events.put(decode(reply.ok.payload.to_bytes(), CommandEvent)),  # type: ignore[union-attr]
        lambda: None,
        timeout_s=WAIT_S,
    )
    assert events.get(timeout=WAIT_S).phase == CommandEvent.ACCEPTED
    return events.get(timeout=WAIT_S)


def switched(run: Run, node: str) -> list[tuple[int, bool]]:
    """When an operator switched a node's radio, and whether on."""
    lines = (run.directory / "inputs" / f"{node}.jsonl").read_text().splitlines()
    items = [json.loads(line) for line in lines]
    assert {(item["kind"], item["verb"]) for item in items} == {("command", "radio")}
    return [(item["tick_ns"], item["arguments"]["on"]) for item in items]


@pytest.mark.slow
async def test_an_operators_switch_is_an_input_that_is_repeated(
    start_run: StartRun, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    run = start_run(scenario=THREE, speed="4", duration_s=16.0)
    run.wait_for("sim time")
    keys = Keys(run.directory.name)
    with run.join("operator") as session:
        watched = Watched(session, keys)
        watched.wait_for()
        assert command(session, keys, "gcs", on=False).text == "radio off"
        watched.wait_for("gcs")
        async with connect_ua(run.directory, "1") as ua:
            await ua.run("radio", on=False)
        watched.wait_for("1", "gcs")
        assert command(session, keys, "1", on=True).success
        watched.wait_for("gcs")
        assert command(session, keys, "gcs", on=True).success
        watched.wait_for()
    assert run.finish() == 0, run.output.decode()
    assert run.summary["may_not_repeat"] == []
    outages: Outages = {}
    for node in ("1", "gcs"):
        (begin, off), (end, on) = switched(run, node)
        assert (off, on) == (False, True)
        outages[node] = [(begin, end)]
    assert check_fates(run, outages) > 0
    assert redecide(run.directory).comparison.is_same
    played = {m.sim_time_ns: m.links() for m in Player.open(run.directory).moments() if m.links_are_due}
    for report in watched.seen:
        assert tuple(played[report.header.stamp.ns].radio_off) == report.radio_off
    done = refly(run.directory, tmp_path, free_slot(2))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "identical" in done.stdout
