"""However a run of a study ends, it costs that run alone, and the table tells why."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq

from tests.warm import run_lostlink

AGENT = """
import os, signal
from bridge.agents import Agent
from standin.autopilot import Autopilot

def broken(autopilot):
    raise ArithmeticError("a mistake of the stand-in")

class Mine(Agent):
    async def fly(self):
        await self.sleep(0.8)

    def on_tick(self, sim_time_ns):
        super().on_tick(sim_time_ns)
        if sim_time_ns == 500_000_000 and self.options["does"] == "raise":
            raise ArithmeticError("a mistake of mine")
        if sim_time_ns == 500_000_000 and self.options["does"] == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if sim_time_ns == 500_000_000 and self.options["does"] == "die nameless":
            os.kill(os.getpid(), 40)
        if sim_time_ns == 500_000_000 and self.options["does"] == "leave":
            os._exit(5)
        if sim_time_ns == 500_000_000 and self.options["does"] == "ask":
            input()
        if sim_time_ns == 500_000_000 and self.options["does"] == "break":
            Autopilot.step = broken
"""
SCENARIO = """
schema: 1
name: ends
duration_s: 1
speed: max
origin: {lat_deg: 40.13, lon_deg: -105.24, alt_amsl_m: 1690}
radio: perfect
nodes:
  - {id: 0, agent: {type: still}}
  - {id: 1, kind: ground, place: {north_m: 380}, agent: {type: own, class: "mine.py:Mine", options: {does: raise}}}
"""
STUDY = """
schema: 1
name: ends
scenario: ends.yaml
keep: all
vary: {nodes.1.agent.options.does: [raise, die, die nameless, leave, ask, break, nothing]}
"""


def test_a_run_that_fails_or_dies_costs_no_other(tmp_path: Path) -> None:
    for name, text in (("mine.py", AGENT), ("ends.yaml", SCENARIO), ("study.yaml", STUDY)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    command = ["study", str(tmp_path / "study.yaml"), "--out", str(tmp_path), "--lanes", "1"]
    flown = run_lostlink(*command, timeout=120)
    rows = pq.read_table(tmp_path / "ends" / "metrics.parquet").to_pylist()
    cases = {row["nodes.1.agent.options.does"]: row for row in rows}
    folders = {does: tmp_path / "ends" / "runs" / row["id"] for does, row in cases.items()}
    (raised,) = folders["raise"].glob("*/logs/node-1.log")
    (broken,) = folders["break"].glob("*/run.json")
    assert {does: row["failure"] for does, row in cases.items()} == {
        "raise": "the agent of node 1 failed: ArithmeticError at a tick: a mistake of mine (mine.py:16); "
        "its log is logs/node-1.log",
        "die": "its process was ended by SIGKILL; see log.txt",
        "die nameless": "its process was ended by signal 40; see log.txt",
        "leave": "its process ended with status 5; see log.txt",
        "ask": "the agent of node 1 failed: EOFError at a tick: EOF when reading a line (mine.py:24); "
        "its log is logs/node-1.log",
        "break": "the run cannot go on: the stand-in of UA 0 cannot go on: "
        "ArithmeticError: a mistake of the stand-in",
        "nothing": "",
    }
    assert {does: row["sim_duration_s"] for does, row in cases.items()} == {
        "raise": 0.5,
        **dict.fromkeys(("die", "die nameless", "leave"), None),
        "ask": 0.5,
        "break": 0.5,
        "nothing": 0.8,
    }
    (asked,) = folders["ask"].glob("*/logs/node-1.log")
    where = {"raise": raised.parents[1], "ask": asked.parents[1], "break": broken.parent}
    where |= {does: folders[does] for does in ("die", "die nameless", "leave")}
    assert all(
        f": {cases[does]['failure']} (in {folder})\n" in flown.stdout for does, folder in where.items()
    )
