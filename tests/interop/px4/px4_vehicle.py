"""A real PX4 on its own simulation (simulator_sih), in a directory of its own: no physics of ours."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import shutil
import socket
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from aps.daemon import Daemon, DaemonConfig
from tests.interop.builtin_vehicles import until

INSTANCES = range(3, 10)
"""PX4 gives those up to 9 MAVLink ports of their own."""
QUADROTOR = "10040"


def px4_build() -> Path:
    """The build directory of a real PX4 with simulator_sih, or the test is skipped."""
    home, on_path = os.environ.get("PX4_HOME"), shutil.which("px4")
    places = [Path(home), Path(home) / "build" / "px4_sitl_default"] if home else []
    places += [Path(on_path).resolve().parent.parent] if on_path else []
    for place in places:
        if (place / "bin" / "px4").is_file() and (place / "bin" / "px4-simulator_sih").exists():
            return place
    pytest.skip("no px4 with simulator_sih: neither PX4_HOME nor PATH leads to one")


def free_instance() -> int:
    """A value for ``-i`` whose UDP ports are free; test processes begin at others."""
    first = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) * 3
    for instance in (*INSTANCES[first:], *INSTANCES[:first]):
        with contextlib.suppress(OSError), contextlib.ExitStack() as stack:
            for base in (14540, 14580, 18570, 14280, 13030, 19450):
                probe = stack.enter_context(socket.socket(type=socket.SOCK_DGRAM))
                probe.bind(("127.0.0.1", base + instance))
            return instance
    raise AssertionError("no free instance")


@contextlib.asynccontextmanager
async def sih(
    build: Path, directory: Path, airframe: str = QUADROTOR, speed: float = 1.0
) -> AsyncIterator[int]:
    """PX4 on its own simulation; gives its instance I: system I + 1, MAVLink to UDP port 14540 + I."""
    instance = free_instance()
    log = (directory / "px4.log").open("wb")
    own = {"PX4_SYS_AUTOSTART": airframe, "PX4_SIMULATOR": "sihsim", "PX4_SIM_SPEED_FACTOR": f"{speed:g}"}
    process = await asyncio.create_subprocess_exec(
        str(build / "bin" / "px4"),
        *("-i", str(instance), "-d", str(build / "etc"), "-w", str(directory), "-s", "etc/init.d-posix/rcS"),
        cwd=directory,
        env=os.environ | own,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=log,
        stderr=log,
    )
    try:
        yield instance
    finally:
        process.kill()
        await process.wait()
        log.close()


@contextlib.asynccontextmanager
async def copter_with_daemon(directory: Path) -> AsyncIterator[Daemon]:
    """A daemon on a PX4 that is ready to arm, at twice real time."""
    async with sih(px4_build(), directory, speed=2.0) as instance:
        config = DaemonConfig(autopilot=f"udp-in:127.0.0.1:{14540 + instance}", sysid=instance + 1)
        async with Daemon(config) as daemon:
            await asyncio.wait_for(daemon.wait_heard(), 60)
            await until(daemon, lambda state: state.ready_to_arm and state.position_ok)
            await until(daemon, lambda state: math.isfinite(state.home_alt_amsl_m))
            yield daemon
