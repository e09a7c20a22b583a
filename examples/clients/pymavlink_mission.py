"""Parameters, a mission and a flight in AUTO with pymavlink's own helpers (pip install pymavlink).

    python pymavlink_mission.py tcp:127.0.0.1:6760 mission.txt

The file is one of waypoints, as MAVProxy and Mission Planner write it; it begins with home and a take-off.
"""

import argparse
import time

from pymavlink import mavparm, mavutil, mavwp

AGAIN_S = 2.0


def say(*words):
    print(*words, flush=True)


def ask(link, request, *kinds, until=lambda _: True):
    """Send a request until an answer of some kind comes that is the one wanted."""
    request()
    asked_s = time.monotonic()
    while True:
        message = link.recv_match(type=list(kinds), blocking=True, timeout=AGAIN_S)
        if message is not None and until(message):
            return message
        if time.monotonic() - asked_s > AGAIN_S:
            request()
            asked_s = time.monotonic()


def all_parameters(link):
    """Fetch the list, and whatever is missing of it one by one."""
    values, missing = mavparm.MAVParmDict(), {-1}
    link.param_fetch_all()
    while missing:
        message = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=AGAIN_S)
        if message is None:
            for index in sorted(missing)[:50]:
                link.param_fetch_one(index) if index >= 0 else link.param_fetch_all()
        elif message.param_index < message.param_count:
            missing = set(range(message.param_count)) if missing == {-1} else missing
            missing.discard(message.param_index)
            values[message.param_id] = message.param_value
    return values


def upload(link, mission):
    asked = ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK")
    link.waypoint_clear_all_send()
    link.recv_match(type="MISSION_ACK", blocking=True)
    answer = ask(link, lambda: link.waypoint_count_send(mission.count()), *asked)
    while answer.get_type() != "MISSION_ACK":
        item = mission.wp(answer.seq)
        item.target_system, item.target_component = link.target_system, link.target_component
        answer = ask(link, lambda item=item: link.mav.send(item), *asked)
    return answer.type == mavutil.mavlink.MAV_MISSION_ACCEPTED


def download(link):
    mission = mavwp.MAVWPLoader()
    count = ask(link, link.waypoint_request_list_send, "MISSION_COUNT").count
    for seq in range(count):

        def request(seq=seq):
            link.waypoint_request_send(seq)

        mission.add(ask(link, request, "MISSION_ITEM", until=lambda item, seq=seq: item.seq == seq))
    return mission


def fly(link, last):
    """Arm, and follow the mission to its last item."""
    if link.flightmode in ("RTL", "LAND"):
        # a flight before this one ended so, and a copter cannot be armed in these
        ask(link, lambda: link.set_mode("GUIDED"), "HEARTBEAT", until=lambda _: link.flightmode == "GUIDED")
    ask(link, link.arducopter_arm, "HEARTBEAT", until=lambda _: link.motors_armed())
    say("armed in", link.flightmode)
    link.set_mode("AUTO")
    start = mavutil.mavlink.MAV_CMD_MISSION_START
    link.mav.command_long_send(link.target_system, link.target_component, start, 0, 0, 0, 0, 0, 0, 0, 0)
    reached = 0
    while reached < last:
        reached = link.recv_match(type="MISSION_ITEM_REACHED", blocking=True).seq
        say("reached item", reached)


def main(address, file):
    link = mavutil.mavlink_connection(address, source_system=253)
    link.wait_heartbeat()
    say("system:", link.target_system)
    parameters = all_parameters(link)
    say("parameters:", len(parameters))
    name = "WPNAV_RADIUS" if "WPNAV_RADIUS" in parameters else "RTL_RADIUS"
    before = parameters[name]
    parameters.mavset(link, name, before + 10.0)
    told = ask(link, lambda: link.param_fetch_one(name), "PARAM_VALUE", until=lambda p: p.param_id == name)
    say(f"{name}: {before:g}, then {told.param_value:g}")
    mission = mavwp.MAVWPLoader()
    mission.load(file)
    say("accepted:", upload(link, mission))
    kept = download(link)
    same = all(kept.wp(seq).command == mission.wp(seq).command for seq in range(1, mission.count()))
    say("downloaded:", kept.count(), "the same:", same)
    fly(link, mission.count() - 2)
    link.set_mode("RTL")
    ask(link, lambda: None, "HEARTBEAT", until=lambda _: link.flightmode == "RTL")
    say("mode:", link.flightmode)
    link.close()


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("address", nargs="?", default="tcp:127.0.0.1:6760")
parser.add_argument("file")
arguments = parser.parse_args()
main(arguments.address, arguments.file)
