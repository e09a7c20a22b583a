"""The stand-in autopilot on the F450 of fdm, flown through the daemon: real processes, real sockets."""

import asyncio
import math
import re
import sys

import pytest

from aps.daemon import Daemon, DaemonConfig

HOME = "47.3977,8.5456,488,90"
FDM_PORT = r"UDP 127\.0\.0\.1:(\d+)"
STANDIN_PORT = r"tcp:127\.0\.0\.1:(\d+)"


class Processes:
    """Child processes and the port that each names in its ready line."""

    def __init__(self):
        self._started = []
        self._draining = []

    async def start(self, *arguments, port_in):
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
        )
        self._started.append(process)
        async with asyncio.timeout(30):
            told = ""
            while (found := re.search(port_in, told)) is None:
                line = await process.stdout.readline()
                assert line, f"{arguments[0]} ended: {told}"
                told += line.decode()
        self._draining.append(asyncio.create_task(process.stdout.read()))
        return found.group(1)

    async def kill_last(self):
        process = self._started.pop()
        process.kill()
        await process.wait()

    async def stop(self):
        for process in self._started:
            if process.returncode is None:
                process.kill()
            await process.wait()
        await asyncio.gather(*self._draining)


@pytest.fixture
async def processes():
    processes = Processes()
    yield processes
    await processes.stop()


@pytest.fixture
async def daemon(processes):
    fdm_port = await processes.start("fdm", "--home", HOME, "--port=0", "--speed=max", port_in=FDM_PORT)
    port = await processes.start(
        "standin",
        "--sysid=2",
        f"--fdm-port={fdm_port}",
        "--mavlink-port=0",
        "--home",
        HOME,
        port_in=STANDIN_PORT,
    )
    async with Daemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=2)) as daemon:
        yield daemon


@pytest.mark.slow
async def test_arm_takeoff_goto_rtl_and_takeoff_land_again(daemon, connect, eventually):
    alice, bob = await connect(daemon.listen_port), await connect(daemon.listen_port, 254)
    await eventually(lambda: daemon.state.ready_to_arm, 30)
    home = daemon.state
    commands = daemon.commands
    for result in (await commands.set_mode("GUIDED"), await commands.arm(), await commands.takeoff(12.0)):
        assert result.reached, result
    for client in (alice, bob):
        assert (await client.next("HEARTBEAT", lambda m: m.get_srcComponent() == 1)).get_srcSystem() == 2
        await client.next("GLOBAL_POSITION_INT", lambda m: m.relative_alt > 9_000)
    north_deg = home.lat_deg + math.degrees(25.0 / 6_378_137.0)
    result = await commands.goto(north_deg, home.lon_deg, 15.0)
    assert result.reached, result
    assert daemon.state.position_ned_m[0] == pytest.approx(25.0, abs=3.0)
    assert daemon.state.alt_rel_m == pytest.approx(15.0, abs=1.5)
    result = await commands.rtl()
    assert result.reached, result
    state = daemon.state
    assert math.hypot(*state.position_ned_m[:2]) < 3.0
    assert state.flight_time_s > 20.0
    await eventually(lambda: not daemon.state.armed, 20)
    for result in (await commands.set_mode("GUIDED"), await commands.arm(), await commands.takeoff(5.0)):
        assert result.reached, result
    result = await commands.set_mode("BRAKE")
    assert result.reached, result
    assert str(await commands.takeoff(20.0)) == "takeoff refused: it flies already"
    result = await commands.land()
    assert result.reached, result
    assert daemon.hub.primary.framer.counters.bad_crc == 0
    assert daemon.hub.primary.framer.counters.skipped_bytes == 0


async def test_takeoff_without_arming_is_refused_with_a_reason(daemon, eventually):
    await eventually(lambda: daemon.state.ready_to_arm, 30)
    result = await daemon.commands.takeoff(20.0)
    assert not result.reached
    assert result.reason
