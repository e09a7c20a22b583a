"""Real ArduPlane flies the Aerosonde on ``python -m fdm``: take-off, a rectangle in AUTO, a loiter, home."""

import contextlib
import math
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pymavlink import mavutil

from fdm.airframe import load_airframe
from fdm.geodesy import GeodeticPosition, geodetic_from_ned

pytestmark = pytest.mark.ardupilot

HOME = GeodeticPosition(47.3977, 8.5456, 488.0)
PARAMETERS = Path(__file__).parents[2] / "sitl_configs" / "params" / "plane.parm"
TIMEOUT_S = 100.0
HEIGHT_M = 80.0
CORNERS = ((1000.0, 0.0), (1000.0, 500.0), (0.0, 500.0), (0.0, 0.0))
CORNER_CUT_M = 220.0
"""Part of a leg at either end where the turn is flown."""
MAV = mavutil.mavlink


@pytest.fixture
def arduplane():
    root = os.environ.get("ARDUPILOT_HOME", "")
    for place in (Path(root, part, "arduplane") for part in ("", "bin", "build/sitl/bin") if root):
        if os.access(place, os.X_OK):
            return place
    found = shutil.which("arduplane")
    if found is None:
        pytest.skip("no arduplane: neither ARDUPILOT_HOME nor PATH leads to one")
    return Path(found)


@contextlib.contextmanager
def ended(process):
    with process:
        try:
            yield process
        finally:
            process.kill()


@contextlib.contextmanager
def flying(arduplane, slot, directory, wind):
    """fdm and ArduPlane, each as a user would start it; gives a MAVLink connection."""
    own = directory / "own.parm"
    parameters = load_airframe("aerosonde").ardupilot_parameters
    own.write_text("".join(f"{name} {value:g}\n" for name, value in parameters.items()))
    home = f"{HOME.lat_deg},{HOME.lon_deg},{HOME.alt_amsl_m},0"
    served = [sys.executable, "-m", "fdm", "--index", str(slot), "--airframe", "aerosonde", "--home", home]
    flown = [str(arduplane), "--wipe", "--model", "JSON:127.0.0.1", f"-I{slot}", "--home", home]
    flown += ["--defaults", f"{PARAMETERS},{own}", "--serial0", "tcp:0", "--speedup", "20"]
    with (
        ended(
            subprocess.Popen([*served, "--speed", "max", "--wind", wind], stdout=subprocess.PIPE, text=True)
        ) as fdm,
        (directory / "sitl.log").open("wb") as log,
    ):
        assert fdm.stdout.readline().startswith("ready:")
        with (
            ended(subprocess.Popen(flown, cwd=directory, stdout=log, stderr=log)),
            contextlib.closing(
                mavutil.mavlink_connection(f"tcp:127.0.0.1:{5760 + 10 * slot}", source_system=250, retries=30)
            ) as link,
        ):
            assert link.wait_heartbeat(timeout=TIMEOUT_S) is not None
            yield link


def command(link, number, *parameters):
    link.mav.command_long_send(link.target_system, 1, number, 0, *parameters, *(0,) * (7 - len(parameters)))
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        ack = link.recv_match(type="COMMAND_ACK", blocking=True, timeout=1.0)
        if ack is not None and ack.command == number:
            return ack.result
    raise AssertionError(f"command {number} was never acknowledged")


def mission():
    """(command, param1, north, east, height) of each item, home first."""
    yield (MAV.MAV_CMD_NAV_WAYPOINT, 0, 0, 0, 0)
    yield (MAV.MAV_CMD_NAV_TAKEOFF, 8, 300, 0, HEIGHT_M)
    for _ in range(2):
        for corner in CORNERS:
            yield (MAV.MAV_CMD_NAV_WAYPOINT, 0, *corner, HEIGHT_M)
    yield (MAV.MAV_CMD_NAV_LOITER_TURNS, 2, 0, 0, HEIGHT_M)
    yield (MAV.MAV_CMD_NAV_RETURN_TO_LAUNCH, 0, 0, 0, 0)


def upload(link):
    """Upload the mission; early in its boot ArduPlane has no place for one yet."""
    deadline = time.monotonic() + TIMEOUT_S
    while not offer(link, items := list(mission())):
        assert time.monotonic() < deadline
        link.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=1.0)
    return len(items)


def offer(link, items):
    link.mav.mission_count_send(link.target_system, 1, len(items))
    while True:
        message = link.recv_match(
            type=["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"], blocking=True, timeout=TIMEOUT_S
        )
        assert message is not None
        if message.get_type() == "MISSION_ACK":
            return message.type == MAV.MAV_MISSION_ACCEPTED
        number, first, north, east, height = items[message.seq]
        place = geodetic_from_ned(HOME, (north, east, 0.0))
        link.mav.mission_item_int_send(
            *(link.target_system, 1, message.seq, MAV.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, number, 0, 1),
            *(first, 0, 0, 0, round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), height),
        )


def arm(link):
    deadline = time.monotonic() + TIMEOUT_S
    while command(link, MAV.MAV_CMD_COMPONENT_ARM_DISARM, 1) != 0:
        assert time.monotonic() < deadline
        link.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=1.0)


def cross_track_m(position, begin, end):
    """Distance from the leg's line, or None near its ends."""
    length = math.dist(begin, end)
    along = [(b - a) / length for a, b in zip(begin, end, strict=True)]
    offset = [p - a for p, a in zip(position, begin, strict=True)]
    done = offset[0] * along[0] + offset[1] * along[1]
    if not CORNER_CUT_M < done < length - 60.0:
        return None
    return abs(offset[0] * along[1] - offset[1] * along[0])


@pytest.mark.parametrize(("wind", "limit_m"), [("calm", 30.0), ("breeze", 50.0)])
def test_arduplane_flies_a_rectangle(arduplane, free_slot, tmp_path, wind, limit_m):
    with flying(arduplane, free_slot(1), tmp_path, wind) as link:
        for number in (32, 42, 74, 168):
            command(link, MAV.MAV_CMD_SET_MESSAGE_INTERVAL, number, 200_000)
        last_item = upload(link) - 1
        arm(link)
        assert command(link, MAV.MAV_CMD_DO_SET_MODE, 1, 10) == 0
        worst_m, heights, airspeeds, winds = fly(link, last_item)
    print(f"{wind}: cross-track {max(worst_m):.1f} m on {len(worst_m)} fixes, wind {winds[-1]:.1f} m/s east")
    print(
        f"height {min(heights):.1f} to {max(heights):.1f} m, airspeed {min(airspeeds):.1f} to {max(airspeeds):.1f} m/s"
    )
    assert len(worst_m) > 100
    assert max(worst_m) < limit_m
    assert all(abs(height - HEIGHT_M) < 20.0 for height in heights)
    east_mps = sum(winds[-20:]) / 20
    assert east_mps == pytest.approx(8.0 if wind == "breeze" else 0.0, abs=2.0)


def fly(link, last_item):
    """Until the mission's last item: (cross-track errors, heights, airspeeds, eastward winds) on the legs."""
    deadline = time.monotonic() + TIMEOUT_S
    item, errors, heights, airspeeds, winds = 0, [], [], [], []
    while item < last_item:
        message = link.recv_match(
            type=["LOCAL_POSITION_NED", "MISSION_CURRENT", "VFR_HUD", "WIND"], blocking=True, timeout=10.0
        )
        assert message is not None
        assert time.monotonic() < deadline, (item, errors[-5:])
        kind = message.get_type()
        if kind == "MISSION_CURRENT":
            item = message.seq
        elif kind == "WIND":
            winds.append(-message.speed * math.sin(math.radians(message.direction)))
        elif 4 <= item <= 9:  # from the second corner on: both ends of the leg are waypoints
            begin, end = CORNERS[(item - 3) % 4], CORNERS[(item - 2) % 4]
            if kind == "VFR_HUD":
                airspeeds.append(message.airspeed)
                continue
            error = cross_track_m((message.x, message.y), begin, end)
            if error is not None:
                errors.append(error)
                heights.append(-message.z)
    return errors, heights, airspeeds, winds
