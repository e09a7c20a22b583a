"""A vehicle behind a daemon, and programs of others as child processes on its ports."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import re
import signal
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.daemon import Daemon, DaemonConfig
from aps.links.link import Link, Role
from bridge.fleet.children.child import on_a_leash
from tests.interop.builtin_vehicles import HOME, SYSID, until

CLIENTS = Path(__file__).parents[2] / "examples" / "clients"
TIMEOUT_S = 100.0
M_PER_DEG = math.radians(6_378_137.0)
PARAMETERS_AT_LEAST = {"standin": 21, "copter": 1000, "plane": 1000}


class Program:
    """A child process, of which all that it prints is kept by lines."""

    def __init__(self, process: asyncio.subprocess.Process, name: str) -> None:
        self._process = process
        self.name = name
        self.lines: list[str] = []
        self._more = asyncio.Condition()
        self._reading = asyncio.create_task(self._read())

    async def _read(self) -> None:
        assert self._process.stdout is not None
        while line := await self._process.stdout.readline():
            async with self._more:
                self.lines.append(line.decode(errors="replace").rstrip())
                self._more.notify_all()
        async with self._more:
            self._more.notify_all()

    def __str__(self) -> str:
        return "\n".join([f"{self.name} said:", *self.lines])

    async def says(self, pattern: str, first: int = 0, timeout_s: float = TIMEOUT_S) -> re.Match[str]:
        """Wait for a line, not before number ``first``, that has the pattern."""

        def found() -> re.Match[str] | None:
            return next((match for line in self.lines[first:] if (match := re.search(pattern, line))), None)

        try:
            async with asyncio.timeout(timeout_s), self._more:
                await self._more.wait_for(lambda: found() or self._reading.done() or self._process.returncode)
        except TimeoutError:
            raise AssertionError(f"no {pattern!r} within {timeout_s} s; {self}") from None
        match = found()
        assert match is not None, f"ended without {pattern!r}; {self}"
        return match

    def types(self, text: str) -> int:
        """Write a line to the program; returns how many lines it has said so far."""
        assert self._process.stdin is not None
        self._process.stdin.write(text.encode() + b"\n")
        return len(self.lines)

    def interrupt(self) -> None:
        """Ask it to end, as Ctrl-C does."""
        self._process.terminate()

    async def ended(self) -> None:
        """Wait for the end, whatever its status."""
        await self._process.wait()
        await self._reading

    async def ends_well(self, timeout_s: float = TIMEOUT_S) -> list[str]:
        """Wait for the end with status 0; returns all lines."""
        try:
            status = await asyncio.wait_for(self._process.wait(), timeout_s)
        except TimeoutError:
            raise AssertionError(f"no end within {timeout_s} s; {self}") from None
        await self._reading
        assert status == 0, f"status {status}; {self}"
        return self.lines

    async def close(self) -> None:
        """Kill it and what it has started, which may outlive it."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        await self._process.wait()
        await self._reading


@contextlib.asynccontextmanager
async def program(*command: object, cwd: Path | None = None) -> AsyncIterator[Program]:
    """Run a Python script, or a module with its options, as a child in a session of its own that ends with us."""
    words = [str(word) for word in command]
    process = await asyncio.create_subprocess_exec(
        *on_a_leash([sys.executable, *words]),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        cwd=cwd,
        start_new_session=True,
    )
    running = Program(process, words[0])
    try:
        yield running
    finally:
        await running.close()


@contextlib.asynccontextmanager
async def standin(speed: float) -> AsyncIterator[int]:
    """The stand-in autopilot on the F450 of fdm; gives its MAVLink port."""
    async with program("-m", "fdm", "--home", HOME, "--port=0", f"--speed={speed}") as physics:
        fdm_port = (await physics.says(r"UDP 127\.0\.0\.1:(\d+)"))[1]
        options = (f"--sysid={SYSID}", f"--fdm-port={fdm_port}", "--mavlink-port=0", f"--home={HOME}")
        async with program("-m", "standin", *options) as autopilot:
            yield int((await autopilot.says(r"tcp:127\.0\.0\.1:(\d+)"))[1])


@dataclass
class Served:
    """A vehicle that clients can reach."""

    kind: str
    daemon: Daemon
    places_e7: set[tuple[int, int]] = field(default_factory=set)
    """Where the autopilot has said that it is: latitude and longitude in 1e-7 degrees."""

    @property
    def is_plane(self) -> bool:
        return self.kind == "plane"

    @property
    def port(self) -> int:
        return self.daemon.listen_port

    @property
    def tcp(self) -> str:
        """As pymavlink, MAVProxy and dronekit write it."""
        return f"tcp:127.0.0.1:{self.port}"

    @property
    def mavsdk(self) -> str:
        return f"tcpout://127.0.0.1:{self.port}"

    async def until(self, condition: Callable[..., object], timeout_s: float = TIMEOUT_S) -> None:
        """Wait for a state of the daemon."""
        await until(self.daemon, condition, timeout_s)


def _keep_places(served: Served) -> None:
    """Write down each GLOBAL_POSITION_INT of the autopilot, as it came."""
    parser = mavlink.MAVLink(None)

    def tap(raw: bytes, link: Link) -> None:
        if (
            link.role is Role.AUTOPILOT
            and raw[0] == 0xFD
            and raw[7] == mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        ):
            message = parser.decode(bytearray(raw))
            served.places_e7.add((message.lat, message.lon))

    served.daemon.hub.taps.append(tap)


@contextlib.asynccontextmanager
async def serve(kind: str, port: int) -> AsyncIterator[Served]:
    """A daemon on an autopilot's port, once the vehicle is ready to arm."""
    config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=SYSID)
    async with Daemon(config) as daemon:
        served = Served(kind, daemon)
        _keep_places(served)
        await asyncio.wait_for(daemon.wait_heard(), 60)
        await served.until(lambda state: state.ready_to_arm and state.position_ok)
        # Not before: SITL's radio chooses a mode when it comes up.
        assert (await daemon.commands.set_mode("FBWA" if served.is_plane else "GUIDED")).reached
        yield served


@contextlib.asynccontextmanager
async def mavproxy(served: Served, directory: Path, *options: str) -> AsyncIterator[Program]:
    """MAVProxy on the vehicle; its logs go to a directory, and it takes commands by ``types``."""
    script = Path(sys.executable).with_name("mavproxy.py")
    async with program("-u", script, "--master", served.tcp, *options, cwd=directory) as client:
        yield client


def waypoint_file(served: Served, directory: Path) -> Path:
    """Home, a take-off and two waypoints, as MAVProxy writes them."""
    state = served.daemon.state
    height_m, away_deg = (60.0, 0.004) if served.is_plane else (20.0, 0.0003)
    places = [(16, 0, 0.0, 584.0), (22, 0, 0.0, height_m), (16, 1, away_deg, height_m)]
    places += [(16, 1, 2 * away_deg, height_m)]
    lines = ["QGC WPL 110"]
    for seq, (command, _, north_deg, height) in enumerate(places):
        head = [seq, int(seq == 0), 3 if seq else 0, command, 0, 0, 0, 0]
        place = [f"{state.lat_deg + north_deg:.8f}", f"{state.lon_deg:.8f}", height, 1]
        lines.append("\t".join(map(str, [*head, *place])))
    path = directory / "mission.txt"
    path.write_text("\n".join(lines) + "\n")
    return path


def places_of_tlog(file: Path) -> list[tuple[int, int]]:
    """All places in a .tlog, 1e-7 degrees; a last record that is cut short is left out."""
    log, places = mavutil.mavlink_connection(str(file)), []
    while (message := log.recv_match(type="GLOBAL_POSITION_INT")) is not None:
        places.append((message.lat, message.lon))
    log.close()
    return places


def distances_m(places: Sequence[tuple[float, float]], lat_deg: float, lon_deg: float) -> list[float]:
    """Ground distance of each place (latitude, longitude in degrees) from a point."""
    east = math.cos(math.radians(lat_deg))
    return [M_PER_DEG * math.hypot(lat - lat_deg, east * (lon - lon_deg)) for lat, lon in places]
