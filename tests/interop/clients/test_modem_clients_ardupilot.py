"""Real ArduCopter behind a SiK modem, and one program of others at the ground node's: it does all over the air.

They are real programs, at speed 1, and wait for an answer by wall time as they do in the field. Nothing here depends on
how long it takes: a copter stays armed until its take-off comes. What they sent is in the record, from which the run is
flown again without them.
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import AsyncIterator, Callable
from itertools import groupby
from pathlib import Path

import pytest

from bridge.bus.session import free_port
from bridge.record.names import from_autopilot
from bridge.record.tables.reader import read_columns
from bridge.record.tables.truth import TRUTH
from tests.integration.bridge.conftest import LOSTLINK
from tests.integration.bridge.mavlink.scripted_station import messages, out_of
from tests.interop.served import CLIENTS, Program, program

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow, pytest.mark.long, pytest.mark.timeout(1800)]
ITEMS = 20
PARAMETERS_AT_LEAST = 1000
GUIDED, LOITER, RTL, BRAKE = 4, 5, 6, 17
LONG_S = 600.0
TIMES = 20
SCENARIO = """schema: 1
name: on-air
seed: 3
autopilot: ardupilot
speed: 1
duration_s: 1500
figure: false
origin: {{lat_deg: 47.0, lon_deg: 8.0, alt_amsl_m: 500}}
radio: perfect
networks: {{telemetry: sik-433}}
ports: {{first_slot: {slot}, zenoh: 0}}
mcap: {{write: false}}
nodes:
  - {{id: 0, parameters: {{DISARM_DELAY: 0}}, modems: {{telemetry: {{serial: 1}}}}, agent: {{type: still}}}}
  - id: gcs
    kind: ground
    place: {{east_m: 20}}
    modems: {{telemetry: {{serve: ["tcpin::{port}", "udp:127.0.0.1:{udp_port}"]}}}}
    agent: {{type: still}}
"""


class Flown:
    """A run with a modem for a program: where that is, and what became of it.

    Attributes:
        port: TCP, of the modem.
        udp_port: to which the modem sends.
    """

    def __init__(self, folder: Path, slot: int) -> None:
        self._folder, self._slot = folder, slot
        self.port, self.udp_port = free_port(), free_port()

    @contextlib.asynccontextmanager
    async def flying(self) -> AsyncIterator[None]:
        """From take-off of the clock until the program has done its work."""
        file = self._folder / "scenario.yaml"
        file.write_text(SCENARIO.format(slot=self._slot, port=self.port, udp_port=self.udp_port))
        async with program(*LOSTLINK[1:], "run", file, "--out", self._folder / "runs") as run:
            await run.says("sim time")
            yield
            run.interrupt()
            await run.says("interrupted", timeout_s=LONG_S)
            await run.ended()

    @property
    def run(self) -> Path:
        """Its directory."""
        (found,) = (self._folder / "runs").iterdir()
        return found

    def modes(self) -> list[int]:
        """Of the copter while it was armed, one after the other."""
        beats = (
            each for _, each in messages(from_autopilot("0").path(self.run)) if each.get_type() == "HEARTBEAT"
        )
        return [mode for mode, _ in groupby(beat.custom_mode for beat in beats if beat.base_mode & 128)]

    async def repeats(self, slot: int) -> None:
        """Flown again, with its parts in many processes and at other ports: identical."""
        command = [*LOSTLINK[1:], "refly", self.run, "--out", self._folder / "again", "--json"]
        command += ["--first-slot", slot, "--zenoh-port", 0, "--processes", "many"]
        async with program(*command) as again:
            lines = await again.ends_well(LONG_S)
        (told,) = (json.loads(line) for line in lines if line.startswith("{"))
        assert told["difference"] is None


@pytest.fixture
async def flown(tmp_path: Path, arducopter: Path, free_slot: Callable[[int], int]) -> AsyncIterator[Flown]:
    """Let a test fly; then look at what every client has to have brought about."""
    flown = Flown(tmp_path, free_slot(1))
    yield flown
    values = {each.param_index for _, each in out_of(flown.run, "gcs", "PARAM_VALUE")}
    assert len(values) > PARAMETERS_AT_LEAST, "they came over the air"
    modes = flown.modes()
    assert GUIDED in modes
    assert {LOITER, BRAKE} & set(modes)
    assert modes[-1] == RTL
    height_m = read_columns(flown.run, TRUTH, ("node", "position_down_m"))
    assert height_m["position_down_m"][height_m["node"] == "0"].min() < -9.0
    await flown.repeats(free_slot(1))


def told_by(lines: list[str]) -> dict[str, str]:
    return dict(line.split(": ", 1) for line in lines if ": " in line)


def is_whole(told: dict[str, str]) -> bool:
    assert int(told["parameters"]) > PARAMETERS_AT_LEAST
    assert told["mission"] == f"{ITEMS} up, {ITEMS} down, the same: True"
    return True


async def test_mavsdk(flown: Flown) -> None:
    async with (
        flown.flying(),
        program(CLIENTS / "mavsdk_on_air.py", f"tcpout://127.0.0.1:{flown.port}") as client,
    ):
        told = told_by(await client.ends_well(LONG_S))
    assert is_whole(told)
    assert told["mode"] == "RETURN_TO_LAUNCH"


async def test_pymavlink(flown: Flown) -> None:
    """By UDP, which the modem sends to it."""
    async with (
        flown.flying(),
        program(CLIENTS / "pymavlink_on_air.py", f"udpin:127.0.0.1:{flown.udp_port}") as client,
    ):
        told = told_by(await client.ends_well(LONG_S))
    assert is_whole(told)
    assert told["mode"] == "RTL"


async def types_until(client: Program, text: str, answer: str, timeout_s: float = 30.0) -> None:
    """Type a command until it is answered, as its user would: either may be lost on the air."""
    for _ in range(TIMES):
        since = client.types(text)
        with contextlib.suppress(AssertionError):
            await client.says(answer, since, timeout_s)
            return
    raise AssertionError(f"no {answer!r} to {text!r}; {client}")


def waypoints(folder: Path) -> list[str]:
    """Home, a take-off and waypoints, as MAVProxy's files have them."""
    rows = [(16, 0, 47.0, 500.0), (22, 3, 47.0, 15.0)]
    rows += [(16, 3, 47.0 + number * 1e-5, 15.0 + number) for number in range(2, ITEMS)]
    lines = [
        "\t".join(
            map(str, [seq, int(not seq), frame, command, 0, 0, 0, 0, f"{lat:.8f}", "8.00000000", height, 1])
        )
        for seq, (command, frame, lat, height) in enumerate(rows)
    ]
    (folder / "mission.txt").write_text("\n".join(["QGC WPL 110", *lines]) + "\n")
    return lines


def places(lines: list[str]) -> list[tuple[float, ...]]:
    """Commands and places of a file's rows without home, which the autopilot knows better."""
    rows = [line.split() for line in lines]
    return [(float(row[3]), float(row[8]), float(row[9]), float(row[10])) for row in rows[1:]]


async def test_mavproxy(flown: Flown, tmp_path: Path) -> None:
    mission = waypoints(tmp_path)
    script = Path(sys.executable).with_name("mavproxy.py")
    options = ("--master", f"tcp:127.0.0.1:{flown.port}", "--cmd", "set param_ftp 0", "--streamrate", 2)
    async with (
        flown.flying(),
        program("-u", script, *options, "--state-basedir", tmp_path, cwd=tmp_path) as client,
    ):
        assert (
            int((await client.says(r"Received (\d+) parameters", timeout_s=LONG_S))[1]) > PARAMETERS_AT_LEAST
        )
        await types_until(client, "wp load mission.txt", "MISSION_ACK: TYPE_MISSION: ACCEPTED", 60.0)
        await types_until(client, "wp list", rf"Saved {ITEMS} waypoints to .*way\.txt", 60.0)
        await types_until(client, "mode GUIDED", "Mode GUIDED")
        await types_until(client, "arm throttle", "ARMED")
        await types_until(client, "takeoff 15", r"height 1\d", 60.0)
        await types_until(client, "mode LOITER", "Mode LOITER")
        await types_until(client, "mode RTL", "Mode RTL")
    kept = (tmp_path / "way.txt").read_text().splitlines()[1:]
    for here, there in zip(places(mission), places(kept), strict=True):
        assert there == pytest.approx(here, abs=1e-6)
