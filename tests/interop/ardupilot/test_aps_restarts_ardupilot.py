"""A real ArduCopter killed and started again under three clients."""

import asyncio
import contextlib

import pytest

from aps.daemon import Daemon, DaemonConfig
from tests.integration.aps.conftest import Client
from tests.integration.aps.restarts import RECONNECT_S, survives_restarts
from tests.interop.builtin_vehicles import COPTER, SYSID, free_instance, sitl

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow]


@pytest.mark.timeout(300)
async def test_arducopter_killed_ten_times(arducopter, tmp_path):
    instance = free_instance()
    running = contextlib.AsyncExitStack()
    clients = []

    async def start():
        await running.enter_async_context(sitl(arducopter, "quad", COPTER, tmp_path, 1, instance=instance))

    async def connect(port, sysid):
        clients.append(Client(*await asyncio.open_connection("127.0.0.1", port), sysid, 190))
        return clients[-1]

    await start()
    try:
        config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{5760 + 10 * instance}", sysid=SYSID)
        async with Daemon(config) as daemon:
            took_s = await survives_restarts(daemon, connect, start, running.aclose)
            for client in clients:
                client.close()
    finally:
        await running.aclose()
    print("heard again after", ", ".join(f"{s:.2f}" for s in took_s), "s")
    assert max(took_s) < RECONNECT_S  # its start included
