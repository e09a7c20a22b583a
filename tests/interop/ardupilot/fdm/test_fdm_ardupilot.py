"""Real ArduCopter on the exchange: ``python -m fdm`` and the binary, each started as a user would."""

import contextlib
import math
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pymavlink import mavutil

from fdm.model.airframe import load_airframe

pytestmark = pytest.mark.ardupilot

HOME = "47.3977,8.5456,488,90"
PARAMETERS = Path(__file__).parents[4] / "sitl_configs" / "params"
GUIDED, RTL = 4, 6
MESSAGES = {"LOCAL_POSITION_NED": 32, "GLOBAL_POSITION_INT": 33, "ATTITUDE": 30, "EXTENDED_SYS_STATE": 245}
TIMEOUT_S = 90.0


@contextlib.contextmanager
def ended(process):
    with process:
        try:
            yield process
        finally:
            process.kill()


class Pilot:
    """A ground station of a few lines; durations are in the autopilot's own time."""

    def __init__(self, port):
        self.link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=250, retries=30)
        assert self.link.wait_heartbeat(timeout=TIMEOUT_S) is not None
        for number in MESSAGES.values():
            self.command(mavutil.mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 100_000)

    def close(self):
        self.link.close()

    def command(self, number, *parameters):
        """Send a COMMAND_LONG; gives its result."""
        self.link.mav.command_long_send(
            self.link.target_system, 1, number, 0, *parameters, *(0,) * (7 - len(parameters))
        )
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            ack = self.link.recv_match(type="COMMAND_ACK", blocking=True, timeout=1.0)
            if ack is not None and ack.command == number:
                return ack.result
        raise AssertionError(f"command {number} was never acknowledged")

    def set_mode(self, number):
        assert self.command(mavutil.mavlink.MAV_CMD_DO_SET_MODE, 1, number) == 0

    def position(self):
        """The newest local position."""
        message = self.link.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=TIMEOUT_S)
        assert message is not None
        return message

    def until(self, condition):
        """Wait for a local position that meets `condition`."""
        deadline = time.monotonic() + TIMEOUT_S
        while not condition(message := self.position()):
            assert time.monotonic() < deadline, message
        return message

    def arm(self):
        deadline = time.monotonic() + TIMEOUT_S
        while self.command(mavutil.mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) != 0:
            assert time.monotonic() < deadline
            self.position()

    def goto(self, north, east, down):
        """Fly to a place in GUIDED and wait until it is there."""
        self.link.mav.set_position_target_local_ned_send(
            0,
            self.link.target_system,
            1,
            mavutil.mavlink.MAV_FRAME_LOCAL_NED,
            0b110111111000,
            north,
            east,
            down,
            *(0,) * 8,
        )
        return self.until(lambda p: math.dist((p.x, p.y, p.z), (north, east, down)) < 0.5)


@pytest.mark.parametrize(
    ("airframe_name", "wind", "coupling", "hover_limit_m"),
    [
        ("f450", "calm", "serial", 0.3),
        ("f450", "breeze", "serial", 1.5),
        ("f450", "calm", "parallel", 0.3),
        ("f450", "breeze", "parallel", 1.5),
        ("hexa550", "calm", "serial", 0.3),
        ("hexa550", "breeze", "parallel", 1.5),
    ],
)
def test_arducopter_takes_off_holds_flies_a_square_and_returns(
    arducopter, free_slot, tmp_path, airframe_name, wind, coupling, hover_limit_m
):
    slot = free_slot(1)
    own = tmp_path / "own.parm"
    parameters = load_airframe(airframe_name).ardupilot_parameters
    own.write_text("".join(f"{name} {value:g}\n" for name, value in parameters.items()))
    served = [sys.executable, "-m", "fdm", "--index", str(slot), "--airframe", airframe_name]
    served += ["--wind", wind, "--coupling", coupling]
    flown = [str(arducopter), "-w", "--model", "JSON:127.0.0.1", f"-I{slot}", "--home", HOME]
    flown += ["--defaults", f"{PARAMETERS / 'copter.parm'},{own}", "--serial0", "tcp:0", "--speedup", "20"]
    with (
        ended(
            subprocess.Popen([*served, "--home", HOME, "--speed", "max"], stdout=subprocess.PIPE, text=True)
        ) as fdm,
        (tmp_path / "sitl.log").open("wb") as log,
    ):
        assert fdm.stdout.readline().startswith("ready:")
        with (
            ended(subprocess.Popen(flown, cwd=tmp_path, stdout=log, stderr=log)),
            contextlib.closing(Pilot(5760 + 10 * slot)) as pilot,
        ):
            hover_m = fly(pilot)
        fdm.terminate()
        counters = dict(re.findall(r"(\w+) (\d+)[,\n]", fdm.stdout.read()))
    print(f"{airframe_name}, {wind}, {coupling}: hover within {hover_m:.2f} m")
    assert hover_m < hover_limit_m
    assert int(counters.pop("frames")) > 40_000
    assert counters == {"boots": "1"}


def fly(pilot):
    """The whole flight; gives how far from its place it was at most while it hovered, m."""
    pilot.position()
    pilot.set_mode(GUIDED)
    pilot.arm()
    assert pilot.command(mavutil.mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20) == 0
    pilot.until(lambda p: p.z < -19.8)
    pilot.goto(0, 0, -20)
    pilot.until(lambda p: math.hypot(p.vx, p.vy, p.vz) < 0.2)
    held = [pilot.position() for _ in range(100)]
    for corner in ((100, 0), (100, 100), (0, 100), (0, 0)):
        pilot.goto(*corner, -20)
    pilot.set_mode(RTL)
    down = pilot.until(lambda p: p.z > -0.5)
    assert down.z < 0.5
    pilot.until(lambda _: not pilot.link.motors_armed())
    return max(math.dist((place.x, place.y, place.z), (0, 0, -20)) for place in held)
