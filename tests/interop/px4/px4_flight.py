"""A flight of PX4 by the daemon's verbs, and its record: what ``tests/data/mavlink_px4.bin.xz`` was made with.

    python -m tests.interop.px4.px4_flight 14540 1 tests/data/mavlink_px4.bin.xz    # port and system of a running PX4

The record has the messages that the verbs look at, positions at 4 Hz, by exchange.
"""

from __future__ import annotations

import asyncio
import json
import lzma
import math
import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from aps.config import DaemonConfig
from aps.held import HeldDaemon
from aps.links.address import parse_autopilot
from aps.links.kinds.held_udp import HeldUdpLink
from aps.vehicle.execution import CommandResult
from aps.vehicle.state import VehicleState
from aps.wire.framer import Framer

TICK_S: Final = 0.05
KEPT: Final = frozenset({0, 1, 22, 40, 42, 43, 44, 46, 47, 51, 73, 77, 148, 230, 242, 245, 253, 410})
THINNED: Final = frozenset({32, 33})
_CHECK: Final = [{"name": "modes", "type": "uint32_t"}, {"name": "health_component_index", "type": "uint8_t"}]
METADATA: Final = {
    "components": {
        "1": {
            "namespace": "px4",
            "event_groups": {
                "default": {"events": {"13495236": {"message": "Reposition is outside geofence"}}},
                "arming_check": {
                    "events": {
                        "3087815": {"message": "No offboard signal", "arguments": _CHECK},
                        "453929": {"message": "No manual control input", "arguments": _CHECK},
                    }
                },
            },
            "navigation_mode_groups": {"groups": {"0": [65536], "14": [393216]}},
        }
    }
}
"""Those of PX4's events that the flight turns on."""
_RECORD: Final = struct.Struct("<IH")


def away(home: VehicleState, north_m: float, east_m: float) -> tuple[float, float]:
    """A place some metres from home."""
    north_rad, east_rad = north_m / 6_378_137.0, east_m / 6_378_137.0
    lon = home.home_lon_deg + math.degrees(east_rad / math.cos(math.radians(home.home_lat_deg)))
    return home.home_lat_deg + math.degrees(north_rad), lon


def script(home: VehicleState) -> Iterator[tuple[str, tuple[Any, ...], dict[str, Any]]]:
    """Verbs with their arguments."""

    def item(command: int, north_m: float, east_m: float, height_m: float, *params: float) -> dict[str, Any]:
        first = [*params, 0.0, 0.0, 0.0, 0.0][:4]
        return {"command": command, "params": [*first, *away(home, north_m, east_m), height_m], "frame": 3}

    corners = ((-80, -80), (80, -80), (80, 80), (-80, 80))
    yield "takeoff", (10.0,), {}
    yield "mode", ("MANUAL",), {}
    yield "arm", (), {}
    yield "mode", ("GUIDED",), {}
    yield "parameter_get", ("SYS_AUTOSTART",), {}
    yield "parameter_set", ("GF_ACTION", 2), {}
    yield "parameter_set", ("MPC_XY_CRUISE", 4.5), {}
    yield "parameter_set", ("COM_RC_IN_MODE", 4.5), {}
    yield "parameters", (), {}
    yield "mission_upload", ([item(22, 0, 0, 10.0), item(16, 15, 0, 12.0), item(16, 15, 15, 12.0)],), {}
    yield "mission_download", (), {}
    yield "mission_upload", ([item(5001, *corner, 0.0, 4.0) for corner in corners],), {"kind": "fence"}
    yield "mission_download", (), {"kind": "fence"}
    yield "mission_upload", ([item(5100, 5, 5, 20.0)],), {"kind": "rally"}
    yield "arm", (), {}
    yield "takeoff", (8.0,), {}
    yield "takeoff", (20.0,), {}
    yield "goto", (*away(home, 200.0, 0.0), 10.0), {}
    yield "goto", (*away(home, 12.0, 0.0), 10.0), {"yaw_deg": 90.0}
    yield "velocity", (0.0, 2.0), {"duration_s": 3.0}
    yield "goto_ned", (0.0, 6.0, -10.0), {}
    yield "hold", (), {}
    yield "disarm", (), {}
    yield "mission", (1,), {}
    yield "rtl", (), {}
    yield "mission_clear", (), {"kind": "fence"}


class Pilot:
    """Gives one verb after the other, each at the exchange after the end of the one before."""

    def __init__(self, daemon: HeldDaemon, start_ticks: int) -> None:
        self.results: list[CommandResult] = []
        self._daemon, self._wait = daemon, start_ticks
        self._script: Iterator[Any] | None = None
        self._flying = False
        self.over = False

    def decide(self) -> None:
        """Within each exchange."""
        self._wait -= 1
        if self._wait > 0 or self._flying or self.over:
            return
        if self._script is None:
            self._script = script(self._daemon.state)
        following = next(self._script, None)
        if following is None:
            self.over = True
            return
        verb, arguments, options = following
        self._flying = True
        self._daemon.commands.start(verb, *arguments, on_done=self._done, **options)

    def _done(self, result: CommandResult) -> None:
        self.results.append(result)
        self._flying = False


class ThinnedPx4:
    """A running PX4 by UDP, of which the daemon hears what goes into the record, and no more."""

    def __init__(self, port: int) -> None:
        self._link = HeldUdpLink(parse_autopilot(f"udp-in:127.0.0.1:{port}"), 1 << 16)
        self._framer = Framer()
        self._due_s: dict[int, float] = {}
        self.tick = 0
        self.pieces: list[bytes] = []

    def connect(self) -> None:
        """aps: a client is there."""
        self._link.connect_now()

    def disconnect(self) -> None:
        """aps: it is gone."""
        self._link.close()

    def read(self) -> bytes:
        """aps: what PX4 has said."""
        frames = self._framer.receive(self._link.read())
        chosen = b"".join(frame.raw for frame in frames if self._is_kept(frame.msg_id))
        if chosen:
            self.pieces.append(_RECORD.pack(self.tick, len(chosen)) + chosen)
        return chosen

    def _is_kept(self, msg_id: int) -> bool:
        now_s = self.tick * TICK_S
        thin = msg_id in THINNED and now_s >= self._due_s.get(msg_id, 0.0)
        if thin:
            self._due_s[msg_id] = now_s + 0.25
        return thin or msg_id in KEPT

    def write(self, data: bytes) -> None:
        """aps: what is said to PX4."""
        self._link.write(data)


def read_record(path: Path) -> dict[int, bytes]:
    """What PX4 said, by exchange."""
    content, said, at = lzma.decompress(path.read_bytes()), {}, 0
    while at < len(content):
        tick, size = _RECORD.unpack_from(content, at)
        at += _RECORD.size
        said[tick] = content[at : at + size]
        at += size
    return said


async def record(port: int, sysid: int, path: Path, say: Callable[[str], None] = print) -> None:
    """Fly, and write what PX4 said."""
    config = DaemonConfig(autopilot="tcp:127.0.0.1:1", sysid=sysid)
    px4 = ThinnedPx4(port)
    async with HeldDaemon(config, autopilot=px4) as daemon:
        daemon.vehicle.events.learn(json.dumps(METADATA).encode())
        await daemon.connect()
        pilot, loop = Pilot(daemon, 100), asyncio.get_running_loop()
        begin_s, told = loop.time(), 0
        while not pilot.over:
            px4.tick += 1
            await asyncio.sleep(begin_s + px4.tick * TICK_S - loop.time())
            daemon.begin_exchange(round(px4.tick * TICK_S * 1e9))
            pilot.decide()
            daemon.end_exchange()
            for result in pilot.results[told:]:
                say(f"{px4.tick * TICK_S:7.2f} {result}")
            told = len(pilot.results)
    write_record(path, px4.pieces)


def write_record(path: Path, pieces: list[bytes]) -> None:
    """As ``read_record`` reads it."""
    path.write_bytes(lzma.compress(b"".join(pieces), preset=9))


if __name__ == "__main__":
    asyncio.run(record(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])))
