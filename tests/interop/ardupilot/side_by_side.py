"""The same words to the stand-in, ArduCopter and ArduPlane, in runs alike, and what each answers and does.

python -m tests.interop.ardupilot.side_by_side    flies all (ARDUPILOT_HOME); writes their rows and the docs' table
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from aps.vehicle.autopilots.choice import autopilot_of
from aps.wire.dialect import ARDUPILOT, mavlink
from bridge.agents import Agent, CommandFailed
from bridge.bus.messages import AircraftState
from lostlink import fly
from tests.interop.builtin_vehicles import free_instance

ROOT = Path(__file__).parents[3]
DATA = ROOT / "tests" / "data" / "side_by_side.json"
PAGE = ROOT / "docs" / "reference" / "standin.md"
KINDS = {
    "stand-in": ("standin", "f450"),
    "ArduCopter": ("ardupilot", "f450"),
    "ArduPlane": ("ardupilot", "aerosonde"),
}
"""Who answers -> autopilot and airframe of its run."""
PARTS = ("on_the_ground", "climb", "in_the_air", "lists", "modes", "way_home")
WATCHED_S = 4.0
"""For how long it is watched what a mode does."""
UNWATCHED = {
    *(
        "ACRO",
        "AUTO",
        "AUTOLAND",
        "AUTOROTATE",
        "AUTOTUNE",
        "DRIFT",
        "FLIP",
        "LAND",
        "MANUAL",
        "RTL",
        "SMART_RTL",
    ),
    *("STABILIZE", "SYSTEMID", "TAKEOFF", "THERMAL", "THROW", "TRAINING", "TURTLE"),
}
"""Modes that fly away, come down or fall: their answer is enough."""
CELL_LENGTH = 90
Rows = dict[str, str]


def flown(kind: str, directory: Path, slot: int, parts: tuple[str, ...] = PARTS) -> Rows:
    """What one answers in a run of its own, in still air."""
    autopilot, airframe = KINDS[kind]
    agent = {"type": "own", "class": f"{__file__}:SideBySide", "options": {"parts": list(parts)}}
    scenario = {
        "schema": 1,
        "name": "side-by-side",
        "duration_s": 2000,
        "autopilot": autopilot,
        "origin": {"lat_deg": 40.1331, "lon_deg": -105.2404, "alt_amsl_m": 1690.0},
        "radio": "perfect",
        "figure": False,
        "ports": {"first_slot": slot, "zenoh": 0},
        "nodes": [
            {"id": 0, "airframe": airframe, "agent": agent},
            {"id": "gcs", "kind": "ground", "agent": {"type": "still"}},
        ],
    }
    result = fly(scenario, directory=directory)
    assert result.error is None, result.error
    lines = (result.path / "agents" / "0" / "rows.jsonl").read_text().splitlines()
    return {row["asked"]: row["answer"] for row in map(json.loads, lines)}


def table(rows: dict[str, Rows]) -> str:
    """The table of docs/reference/standin.md."""
    lines = ["| asked | stand-in | ArduCopter | ArduPlane |", "|---|---|---|---|"]
    for asked in dict.fromkeys(asked for kind in KINDS for asked in rows[kind]):
        first, *others = [rows[kind].get(asked, "") for kind in KINDS]
        cells = [first, *("same" if first and other == first else other for other in others)]
        lines.append(f"| {' | '.join([asked, *cells])} |")
    return "\n".join(lines) + "\n"


class SideBySide(Agent):
    """Asks for each verb and mode in turn, and writes down what came of it."""

    states: list[AircraftState] = []  # noqa: RUF012 - begun anew with each question

    async def fly(self) -> None:
        await self.ua.wait_for(lambda state: state.ready_to_arm)
        self.row("ready to arm after", f"{self.ua.sim_time_ns / 1e9:.0f} s")
        self.type = (await self.ua.message("HEARTBEAT"))["type"]
        self.plane = self.type == mavlink.MAV_TYPE_FIXED_WING
        self.height_m = 80.0 if self.plane else 20.0
        for part in self.options["parts"]:
            await getattr(self, part)()

    async def climb(self) -> None:
        await self.ua.set_mode("FBWA" if self.plane else "GUIDED")
        await self.ua.arm()
        began_ns = self.ua.sim_time_ns
        await self.ask("`takeoff`", "takeoff", alt_rel_m=self.height_m)
        self.row("take-off takes", f"{(self.ua.sim_time_ns - began_ns) / 1e9:.0f} s")

    def on_tick(self, sim_time_ns: int) -> None:
        if self.ua.state is not None:
            self.states.append(self.ua.state)

    def row(self, asked: str, answer: str) -> None:
        cut = answer if len(answer) <= CELL_LENGTH else f"{answer[:CELL_LENGTH]}..."
        self.record("rows", asked=asked, answer=cut)

    async def ask(
        self, asked: str, verb: str, then: Callable[[], str] | None = None, **arguments: Any
    ) -> None:
        """Ask for a verb; ``then`` says what to add when its goal is reached."""
        self.states = []
        try:
            event = await self.ua.run(verb, **arguments)
        except CommandFailed as error:
            self.row(asked, str(error).removeprefix(f"UA 0: {verb}: ").removeprefix(f"{verb} "))
        else:
            self.row(asked, event.outcome + (f", {then()}" if then else ""))

    async def on_the_ground(self) -> None:
        here = {"lat_deg": self.ua.state.latitude_deg, "lon_deg": self.ua.state.longitude_deg}
        await self.ask("disarmed: `takeoff`", "takeoff", alt_rel_m=20.0)
        await self.ask("disarmed: `goto`", "goto", **here, alt_rel_m=20.0)
        await self.ask("disarmed: `hold`", "hold")
        await self.ask("disarmed: `mission`, none there", "mission")
        await self.ask("`mode` NO_SUCH", "mode", mode="NO_SUCH")
        await self.ask("`goto` latitude 100", "goto", lat_deg=100.0, lon_deg=0.0, alt_rel_m=20.0)
        await self.ask("`parameter_get` NO_SUCH", "parameter_get", name="NO_SUCH")
        await self.ask("`message` ODOMETRY", "message", name="ODOMETRY")
        await self.ask("disarmed: `mode` RTL", "mode", mode="RTL")
        await self.ask("`arm` in RTL", "arm")
        await self.ask("disarmed: `mode` LOITER", "mode", mode="LOITER")
        await self.ask("`arm` in LOITER", "arm")
        await self.ask("armed on the ground: `disarm`", "disarm")
        await self.ask("disarmed: `mode` GUIDED", "mode", mode="GUIDED")

    async def in_the_air(self) -> None:
        home, height_m = self.ua.state, self.height_m
        north = {"lat_deg": home.latitude_deg + 40 / 111_000, "lon_deg": home.longitude_deg}
        await self.ask("in flight: `arm`", "arm")
        await self.ask("in flight: `disarm`", "disarm")
        await self.ask("in flight: `reboot`", "reboot")
        await self.ask("in flight: `takeoff`", "takeoff", alt_rel_m=height_m + 10)
        await self.ask(
            "`goto`", "goto", self.battery, **north, alt_rel_m=height_m, speed_mps=20 if self.plane else 6
        )
        await self.ask("`goto` with `yaw_deg`", "goto", self.nose, **north, alt_rel_m=height_m, yaw_deg=90.0)
        amsl_m = home.altitude_amsl_m - home.altitude_rel_m + height_m
        await self.ask("`goto`, frame amsl", "goto", **north, alt_rel_m=amsl_m, frame="amsl")
        await self.ask("`goto`, frame terrain", "goto", **north, alt_rel_m=height_m, frame="terrain")
        place = {"north_m": 20.0, "east_m": 10.0, "down_m": -height_m}
        await self.ask("`goto_ned`", "goto_ned", **place)
        await self.ask("`goto_ned` with `yaw_deg`", "goto_ned", self.nose, **place, yaw_deg=90.0)
        near = {"north_m": 5.0, "east_m": 0.0, "down_m": 0.0}
        await self.ask("`goto_ned`, frame offset", "goto_ned", **near, frame="offset")
        await self.ask("`goto_ned`, frame body", "goto_ned", **near, frame="body")
        speed = self.speed
        still = {"north_mps": 0.0, "east_mps": 0.0, "duration_s": 6.0}
        ahead = still | {"north_mps": 4.0}
        await self.ask("`velocity`", "velocity", speed, **ahead)
        await self.ask("`velocity`, frame body", "velocity", speed, **ahead, frame="body")
        await self.ask("`velocity` up 1 m/s", "velocity", speed, **still, down_mps=-1.0)
        await self.ask("`velocity` with `yaw_deg`", "velocity", self.nose, **still, yaw_deg=90.0)
        await self.ask("`velocity` with `yaw_rate_dps`", "velocity", self.turning, **still, yaw_rate_dps=20.0)
        await self.ask(
            "`follow` at 4 m/s", "follow", speed, **north, alt_rel_m=height_m, north_mps=4.0, duration_s=15.0
        )
        circle = {"alt_rel_m": height_m, "radius_m": 100.0 if self.plane else 20.0, "speed_mps": 5.0}
        await self.ask("`orbit` at 5 m/s", "orbit", speed, **north, **circle)
        for kind in ("air", "ground", "climb", "descent"):
            await self.ask(f"`speed` {kind}", "speed", speed_mps=20.0 if self.plane else 3.0, kind=kind)

    def battery(self) -> str:
        volts, amperes = self.ua.state.voltage_v, self.ua.state.current_a
        return f"the battery has {'a' if volts > 5.0 else 'no'} voltage and {'a' if amperes > 1.0 else 'no'} current"

    def nose(self) -> str:
        return f"heads {round(math.degrees(self.ua.state.euler_rad.z) / 10) * 10 % 360:d} deg"

    def turning(self) -> str:
        late = self.states[len(self.states) // 2 :]
        turned = (late[-1].euler_rad.z - late[0].euler_rad.z) % math.tau
        duration_s = (late[-1].header.stamp.ns - late[0].header.stamp.ns) / 1e9
        return f"turns at {round(math.degrees(turned) / duration_s / 5) * 5:g} deg/s"

    def speed(self) -> str:
        """Over ground and up, in the second half of the flight."""
        late = self.states[len(self.states) // 2 : -10]
        ground = sum(math.hypot(s.velocity_ned_mps.x, s.velocity_ned_mps.y) for s in late) / len(late)
        up = -sum(s.velocity_ned_mps.z for s in late) / len(late)
        return f"{_halves(ground)} m/s over ground, {_halves(up)} m/s up"

    async def lists(self) -> None:
        here = self.ua.state
        place = [0, 0, 0, 0, round(here.latitude_deg + 2e-4, 7), round(here.longitude_deg, 7), self.height_m]
        items = [{"command": 16, "params": place}] * 3
        await self.ask("`mission_download`, none there", "mission_download")
        await self.ask(
            "`mission_upload`, a spline", "mission_upload", items=[{"command": 82, "params": place}]
        )
        await self.ask("`mission_upload`, way points", "mission_upload", items=items)
        await self.ask("`mission_set_current` 2", "mission_set_current", seq=2)
        await self.ask("`mission_set_current` 40", "mission_set_current", seq=40)
        await self.ask("`mission`", "mission")
        await self.ask("`mission_clear`", "mission_clear")
        for kind, command, first in (("fence", 5003, 2000.0), ("rally", 5100, 0)):
            item = {"command": command, "params": [first, *place[1:]]}
            await self.ask(f"`mission_upload`, {kind}", "mission_upload", items=[item], kind=kind)
            await self.ask(f"`mission_clear`, {kind}", "mission_clear", kind=kind)
        await self.ask("`message` AUTOPILOT_VERSION", "message", name="AUTOPILOT_VERSION")
        delay = (
            {"name": "RTL_RADIUS", "value": 80} if self.plane else {"name": "RTL_LOIT_TIME", "value": 3000}
        )
        await self.ask("`parameter_set`", "parameter_set", **delay)

    async def modes(self) -> None:
        if not self.plane:
            await self.back()
            await self.ua.send("SET_MODE", target_system=1, base_mode=1, custom_mode=5)
            await self.ua.wait_for(lambda state: state.mode == "LOITER", timeout_s=10.0)
            self.row("LOITER by a client that holds no sticks", await self.what_it_does())
        for mode in autopilot_of(ARDUPILOT).modes(self.type):
            if mode in ("INITIALISING", "GUIDED"):
                continue
            await self.back()
            await self.ask(f"`mode` {mode}", "mode", mode=mode)
            if not self.plane and self.ua.state.mode == mode and mode not in UNWATCHED:
                self.row(f"what it does in {mode}", await self.what_it_does())

    async def back(self) -> None:
        """To where there is room to fall."""
        await self.ua.set_mode("GUIDED")
        if self.plane:
            await self.sleep(3.0)
        else:
            await self.ua.goto_ned(0.0, 0.0, -120.0)

    async def what_it_does(self) -> str:
        """Whether it stays at its height and place for a while."""
        await self.sleep(3.0)
        before = self.ua.state
        await self.sleep(WATCHED_S)
        now = self.ua.state
        up = (now.altitude_rel_m - before.altitude_rel_m) / WATCHED_S
        a, b = before.position_ned_m, now.position_ned_m
        away = math.hypot(b.x - a.x, b.y - a.y) / WATCHED_S
        height = (
            "keeps its height"
            if abs(up) < 0.25
            else f"{'climbs' if up > 0 else 'sinks'} at {_halves(abs(up))} m/s"
        )
        return height + (", keeps its place" if away < 0.25 else f", moves at {_halves(away)} m/s")

    async def way_home(self) -> None:
        await self.back()
        if self.plane:
            await self.ask("`hold`", "hold")
        else:
            self.states = []
            steering = asyncio.create_task(self.ua.velocity(5.0, 0.0, duration_s=60.0))
            await self.sleep(5.0)
            await self.ask("`hold` at 5 m/s", "hold")
            self.row("... `velocity` then", "superseded" if not await steering else "reached")
            self.row("what it does after `hold`", await self.what_it_does())
            await self.ua.goto_ned(0.0, 0.0, -20.0)
        await self.ask("`rtl`", "rtl")
        if not self.plane:
            await self.ua.set_mode("GUIDED")
            await self.ua.arm()
            await self.ua.takeoff(10.0)
        await self.ask("`land`", "land")


def _halves(value: float) -> str:
    return f"{round(2 * value) / 2 + 0.0:g}"


def main() -> None:
    """Fly those that are named, or all; write what they answered."""
    rows: dict[str, Rows] = json.loads(DATA.read_text()) if DATA.exists() else {}
    for kind in sys.argv[1:] or KINDS:
        with TemporaryDirectory() as directory:
            rows[kind] = flown(kind, Path(directory), free_instance())
    DATA.write_text(json.dumps({kind: rows[kind] for kind in KINDS}, indent=1) + "\n")
    head, _, _ = PAGE.read_text().partition("| asked | stand-in |")
    PAGE.write_text(head + table(rows))


if __name__ == "__main__":
    main()
