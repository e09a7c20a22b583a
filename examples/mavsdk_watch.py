"""Watch UA 1 of a run with MAVSDK (pip install mavsdk), from its APS daemon's TCP port. Ctrl-C ends it."""

import asyncio
import contextlib
import sys

from mavsdk import ComponentType, Configuration
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync


async def main(url: str) -> None:
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=20)
        print("system", await system.get_system_id(), "is there", flush=True)
        async for position in TelemetryAsync(system).subscribe_position():
            print(position, flush=True)


with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
    asyncio.run(main(sys.argv[1] if len(sys.argv) > 1 else "tcpout://127.0.0.1:6770"))
