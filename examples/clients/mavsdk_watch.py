"""Watch UA 1 of a run with MAVSDK (pip install mavsdk), from its APS daemon's TCP port. Ctrl-C ends it.

    python mavsdk_watch.py tcpout://127.0.0.1:6770 246

The number is the system id of the program: each MAVSDK program on one UA should have its own.
"""

import asyncio
import contextlib
import sys

from mavsdk import Configuration
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

GROUND_STATION = 190  # MAV_COMP_ID_MISSIONPLANNER, as MAVSDK's own


def say(what: object) -> None:
    sys.stdout.write(f"{what}\n")  # at once, as MAVSDK logs there from threads of its own
    sys.stdout.flush()


async def main(url: str = "tcpout://127.0.0.1:6770", own_sysid: str = "245") -> None:
    configuration = Configuration.create_manual(int(own_sysid), GROUND_STATION, True)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=20)
        say(f"system {await system.get_system_id()} is there")
        async for position in TelemetryAsync(system).subscribe_position():
            say(position)


with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
    asyncio.run(main(*sys.argv[1:]))
