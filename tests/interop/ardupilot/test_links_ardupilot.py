"""Real ArduCopter on lines that are counted: two links to one autopilot, its reboot, its new system id."""

import asyncio

import pytest

from aps.daemon import Daemon, DaemonConfig
from tests.interop.ardupilot.test_serial_ardupilot import serial_line
from tests.interop.builtin_vehicles import COPTER, SYSID, sitl, until

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow]


def lost(daemon):
    """Frames that were lost, by link to the autopilot."""
    return [link["lost_in"] for link in daemon.statistics()["autopilot_links"]]


async def test_what_the_autopilot_hands_on_from_link_to_link_is_not_lost(arducopter, tmp_path):
    async with sitl(arducopter, "quad", COPTER, tmp_path, 1) as port:
        config = DaemonConfig(
            autopilot=f"tcp:127.0.0.1:{port}", more_autopilots=(f"tcp:127.0.0.1:{port + 2}",), sysid=SYSID
        )
        async with Daemon(config) as daemon:
            await asyncio.wait_for(daemon.wait_heard(), 30)
            begin_ms = daemon.state.time_boot_ms
            await until(daemon, lambda state: state.time_boot_ms > begin_ms + 8000)
            assert lost(daemon) == [0, 0]
            frames = [link["frames_in"] for link in daemon.statistics()["autopilot_links"]]
            assert min(frames) > 10


async def test_a_reboot_on_a_line_loses_nothing_and_its_mode_is_known_with_its_first_heartbeat(
    arducopter, tmp_path
):
    with serial_line() as (theirs, ours):
        config = DaemonConfig(autopilot=f"serial:{ours}:57600", sysid=SYSID)
        async with (
            sitl(arducopter, "quad", COPTER, tmp_path, 1, f"uart:{theirs}:57600"),
            Daemon(config) as daemon,
        ):
            await asyncio.wait_for(daemon.wait_heard(), 30)
            await until(daemon, lambda state: state.gps_fix_type >= 3)
            assert lost(daemon) == [0]
            modes = []
            daemon.subscribe(lambda state: modes.append(state.mode))
            assert (await daemon.commands.run("reboot")).reached
            assert daemon.telemetry.reboots == 1
            await until(daemon, lambda state: state.gps_fix_type >= 3)
            assert lost(daemon) == [0]
            assert set(modes) == {"STABILIZE"}


async def test_a_new_system_id_is_set(arducopter, tmp_path):
    async with sitl(arducopter, "quad", COPTER, tmp_path, 1) as port:
        daemon = Daemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=SYSID))
        async with daemon:
            await asyncio.wait_for(daemon.wait_heard(), 30)
            result = await daemon.commands.run("parameter_set", "MAV_SYSID", SYSID + 6)
            assert result.reached, result
