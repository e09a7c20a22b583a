"""The stand-in killed and started again under three clients."""

import socket

import pytest

from aps.daemon import Daemon, DaemonConfig
from tests.integration.aps.restarts import RECONNECT_S, survives_restarts
from tests.integration.aps.test_aps_standin import FDM_PORT, HOME, STANDIN_PORT, Processes


@pytest.fixture
async def processes():
    processes = Processes()
    yield processes
    await processes.stop()


@pytest.mark.slow
@pytest.mark.long
async def test_standin_killed_ten_times(processes, connect):
    fdm_port = await processes.start("fdm", "--home", HOME, "--port=0", "--speed=1", port_in=FDM_PORT)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    arguments = (
        "standin",
        "--sysid=2",
        f"--fdm-port={fdm_port}",
        f"--mavlink-port={port}",
        "--home",
        HOME,
    )

    async def start():
        await processes.start(*arguments, port_in=STANDIN_PORT)

    await start()
    async with Daemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=2)) as daemon:
        took_s = await survives_restarts(daemon, connect, start, processes.kill_last)
    print("heard again after", ", ".join(f"{s:.2f}" for s in took_s), "s")
    assert max(took_s) < RECONNECT_S
