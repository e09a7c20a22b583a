"""Real autopilots on SITL's built-in vehicles, in directories of their own."""

import asyncio
import contextlib
import os
import socket
from pathlib import Path

HOME = "-35.363262,149.165237,584,353"
SYSID = 4
COPTER_PARAMETERS = Path(__file__).parents[2] / "sitl_configs" / "params" / "copter.parm"
# The built-in vehicles count as uncalibrated without offsets of the accelerometers.
CALIBRATED = "".join(
    f"INS_ACC{n}OFFS_{axis} 0.001\nINS_ACC{n}SCAL_{axis} 1.001\n" for n in ("", 2) for axis in "XYZ"
)
COPTER = "FRAME_CLASS 1\nFRAME_TYPE 0\nBATT_MONITOR 4\n" + CALIBRATED
PLANE = CALIBRATED + (
    "FS_GCS_ENABL 0\nTHR_FAILSAFE 0\nRTL_RADIUS 80\nRTL_ALTITUDE 100\nAIRSPEED_CRUISE 22\nAIRSPEED_MIN 10\n"
    "COMPASS_OFS_X 5\nCOMPASS_OFS_Y 13\nCOMPASS_OFS_Z -18\nARSPD_TYPE 2\nARSPD_USE 1\nARSPD_BUS 2\n"
    "TRIM_THROTTLE 50\nROLL_LIMIT_DEG 65\nPTCH_LIM_MAX_DEG 25\nPTCH_LIM_MIN_DEG -25\nSIM_RATE_HZ 400\n"
    "RC3_MIN 1000\nRC3_TRIM 1000\nTKOFF_LVL_ALT 20\n"
)


def free_instance():
    """A value for ``-I`` with free TCP ports. SITL keeps it in 8 bits."""
    for number in range(100):
        instance = 100 + (os.getpid() + number) % 150
        with contextlib.suppress(OSError), contextlib.ExitStack() as stack:
            for serial in (0, 2, 3):
                stack.enter_context(socket.create_server(("127.0.0.1", 5760 + 10 * instance + serial)))
            return instance
    raise AssertionError("no free instance")


@contextlib.asynccontextmanager
async def sitl(binary, model, parameters, directory, speedup, serial0="tcp:0", instance=None):
    """A real autopilot in a directory of its own; gives its MAVLink port (that of serial1 is higher by 2)."""
    instance = free_instance() if instance is None else instance
    own = directory / "own.parm"
    own.write_text(parameters)
    log = (directory / "sitl.log").open("wb")
    defaults = f"{COPTER_PARAMETERS},{own}" if model == "quad" else str(own)
    process = await asyncio.create_subprocess_exec(
        str(binary),
        *("-w", "--model", model, "-I", str(instance), "--sysid", str(SYSID), "--home", HOME),
        *("--defaults", defaults, "--serial0", serial0, "--speedup", str(speedup)),
        cwd=directory,
        stdout=log,
        stderr=log,
    )
    try:
        yield 5760 + 10 * instance
    finally:
        process.kill()
        await process.wait()
        log.close()


async def until(daemon, condition, timeout_s=60.0):
    """Wait for a state."""
    there = asyncio.Event()
    subscription = daemon.subscribe(lambda state: there.set() if condition(state) else None)
    try:
        await asyncio.wait_for(there.wait(), timeout_s)
    finally:
        subscription.cancel()
