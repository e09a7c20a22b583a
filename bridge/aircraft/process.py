"""The process of one aircraft: its APS daemon, and the daemon's bridge to Zenoh."""

from __future__ import annotations

import asyncio
import logging
import sys

from aps.daemon import Daemon, DaemonConfig
from bridge.aircraft.aircraft_bridge import AircraftBridge
from bridge.bus.session import open_client
from bridge.run.directory import RunDirectory
from bridge.run.process import parse_arguments, run_until_stopped

log = logging.getLogger("aircraft")


async def run_aircraft(run: RunDirectory, node: str, stop: asyncio.Event) -> None:
    """Serve until ``stop`` is set."""
    scenario, keys = run.scenario, run.keys
    ua = scenario.aircraft(node)
    config = DaemonConfig(
        autopilot=f"tcp:127.0.0.1:{scenario.autopilot_port(ua)}",
        sysid=ua.sysid,
        listen_port=scenario.aps_port(ua),
    )
    with open_client(run.info.endpoint) as session:
        async with Daemon(config) as daemon:
            AircraftBridge(session, keys, node, daemon)
            session.declare_alive(keys.alive(f"aircraft-{node}"))
            log.info("MAVLink of UA %s at tcp:127.0.0.1:%d", node, daemon.listen_port)
            await stop.wait()


def main() -> int:
    """Run the process."""
    run, node = parse_arguments("aircraft", __doc__ or "", per_ua=True)
    return run_until_stopped(lambda stop: run_aircraft(run, node, stop))


if __name__ == "__main__":
    sys.exit(main())
