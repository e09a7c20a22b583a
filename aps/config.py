"""Settings of one daemon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from aps.links.allowance import DEFAULT_FRAMES_PER_S
from aps.links.outbox import DEFAULT_LIMIT_BYTES
from aps.links.table import DEFAULT_MAX_CLIENTS
from aps.logs.tlog import DEFAULT_MAX_FILE_BYTES, DEFAULT_MAX_FILES
from aps.timeouts import ROUTE_EXPIRY_S
from aps.vehicle.streams import DEFAULT_RATES_HZ

NS_PER_S: Final = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class DaemonConfig:
    """Settings of one daemon."""

    autopilot: str
    """Way to the autopilot: ``tcp:HOST:PORT``, ``udp-in:HOST:PORT``, ``udp-out:HOST:PORT``, ``serial:DEVICE:BAUD``."""
    more_autopilots: tuple[str, ...] = ()
    """Further ways to the same autopilot: the first one on which it is heard is used."""
    sysid: int
    """System id of the UA, 1..255."""
    listen_host: str = "127.0.0.1"
    listen_port: int = 0
    """TCP port for MAVLink clients; 0 takes any free one (see ``Daemon.listen_port``)."""
    links: tuple[str, ...] = ()
    """Further links for clients, as ``aps.links.address.parse_address`` reads them: ``udp-out:127.0.0.1:14550``."""
    stream_rates_hz: Mapping[int, float] = field(default_factory=lambda: DEFAULT_RATES_HZ)
    """Message id -> rate that the daemon itself asks for, in the autopilot's own time."""
    queue_limit_bytes: int = DEFAULT_LIMIT_BYTES
    """Bound of the queue towards each client, and towards the autopilot."""
    max_clients: int = DEFAULT_MAX_CLIENTS
    client_frames_per_s: float = DEFAULT_FRAMES_PER_S
    """What one client may send for good; beyond it, it has to wait (TCP, serial) or its datagrams are dropped."""
    route_expiry_s: float = ROUTE_EXPIRY_S
    middle_stick: bool = False
    """Whether the throttle stick of a copter is held in the middle while it flies LOITER, ALT_HOLD and the like by a
    command of ours: for simulations, as a real vehicle has a pilot and a receiver."""
    events_file: Path | None = None
    """What the autopilot's events mean: ``etc/extras/all_events.json.xz`` of PX4's build. Without it a daemon by wall
    time asks the autopilot; one in held mode tells them by number."""
    tlog_directory: Path | None = None
    """Where every frame is recorded (.tlog); ``None``: nowhere."""
    tlog_name: str = ""
    """Beginning of the files' names; empty: by the sysid."""
    tlog_file_bytes: int = DEFAULT_MAX_FILE_BYTES
    """Then a new file is begun ..."""
    tlog_files: int = DEFAULT_MAX_FILES
    """... and of so many, the oldest is deleted."""
    tlog_epoch_us: int = 0
    """In held mode: us since 1970 at sim time 0, so that a repeated flight has the same record."""
