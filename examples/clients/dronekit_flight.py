"""Fly a copter with dronekit (pip install dronekit future): a mission up and down, arm, take off, go somewhere, return.

    python dronekit_flight.py tcp:127.0.0.1:6760

dronekit 2.9 was made for Python before 3.10: it wants a name that has moved since, and gets it before it is imported.
"""

import argparse
import collections
import collections.abc
import time

collections.MutableMapping = collections.abc.MutableMapping
import dronekit  # noqa: E402

DEG_PER_M = 1 / 111_320


def say(*words):
    print(*words, flush=True)


def wait_for(condition):
    while not condition():
        time.sleep(0.05)


def keep_mission(vehicle):
    """Upload waypoints, and count what the vehicle has then; dronekit does not count home."""
    commands = vehicle.commands
    commands.download()
    commands.wait_ready(timeout=60)
    home = vehicle.home_location  # known after a download, and kept by clear()
    commands.clear()
    for number in range(1, 6):
        place = (home.lat + number * 10.0 * DEG_PER_M, home.lon, 15.0)
        commands.add(dronekit.Command(0, 0, 0, 3, 16, 0, 0, 0, 0, 0, 0, *place))
    commands.upload()
    commands.download()
    commands.wait_ready(timeout=60)
    return commands.count


def watch(address):
    vehicle = dronekit.connect(address, timeout=60, source_system=252)
    while True:
        place = vehicle.location.global_frame
        say("at", place.lat, place.lon)
        time.sleep(0.2)


def fly(address):
    vehicle = dronekit.connect(address, wait_ready=True, timeout=60, source_system=254)
    vehicle.wait_ready("autopilot_version", timeout=60)
    say("system:", vehicle._master.target_system, vehicle.version)
    say("parameters:", len(vehicle.parameters), "RTL_ALT =", vehicle.parameters["RTL_ALT"])
    say("mission:", keep_mission(vehicle), "items")
    wait_for(lambda: vehicle.is_armable)
    vehicle.mode = dronekit.VehicleMode("GUIDED")
    wait_for(lambda: vehicle.mode.name == "GUIDED")
    vehicle.arm(timeout=30)
    say("armed:", vehicle.armed)
    vehicle.simple_takeoff(10.0)
    wait_for(lambda: vehicle.location.global_relative_frame.alt > 9.0)
    here = vehicle.location.global_relative_frame
    goal_deg = here.lat + 30.0 * DEG_PER_M
    vehicle.simple_goto(dronekit.LocationGlobalRelative(goal_deg, here.lon, 12.0))
    wait_for(lambda: abs(vehicle.location.global_relative_frame.lat - goal_deg) < 2.0 * DEG_PER_M)
    say(f"north: {(vehicle.location.global_relative_frame.lat - here.lat) / DEG_PER_M:.0f} m")
    vehicle.mode = dronekit.VehicleMode("RTL")
    wait_for(lambda: not vehicle.armed)
    say("landed and disarmed")
    vehicle.close()


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("address", nargs="?", default="tcp:127.0.0.1:6760")
parser.add_argument("--watch", action="store_true", help="look on only")
arguments = parser.parse_args()
(watch if arguments.watch else fly)(arguments.address)
