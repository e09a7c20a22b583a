"""A whole flight with pymavlink over a slow radio: parameters, a mission up and down, GUIDED, home.

    python pymavlink_on_air.py tcp:127.0.0.1:5790

Over telemetry modems an answer takes half a second, and now and then it or its question is lost: all is asked for until
it is there.
"""

import argparse
import math
import threading

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

DEG_PER_M = 1 / 111_320
AGAIN_S = 3.0
TIMES = 20
AT_ONCE = 5
"""Parameters asked for by number before their answers come; more than that fills the modem's buffer."""


def say(*words):
    print(*words, flush=True)


class Station:
    """A ground station, which sends heartbeats all the time: without them the autopilot's failsafe acts."""

    def __init__(self, address):
        self.link = mavutil.mavlink_connection(address, source_system=255, retries=60)
        threading.Thread(target=self._beat, daemon=True).start()

    def _beat(self):
        over = threading.Event()
        while not over.wait(1.0):
            self.link.mav.heartbeat_send(mav.MAV_TYPE_GCS, mav.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def hear(self, kinds, condition=None, timeout_s=AGAIN_S):
        return self.link.recv_match(type=kinds, condition=condition, blocking=True, timeout=timeout_s)

    def ask(self, message, kinds, condition=None):
        """Say something until it is answered."""
        for _ in range(TIMES):
            self.link.mav.send(message)
            answer = self.hear(kinds, condition)
            if answer is not None:
                return answer
            say("again:", message.get_type())
        raise RuntimeError(f"no {kinds}")

    def command(self, number, *values):
        message = mav.MAVLink_command_long_message(1, 1, number, 0, *values, *[0.0] * (7 - len(values)))
        accepted = f"COMMAND_ACK.command=={number} and COMMAND_ACK.result==0"
        self.ask(message, "COMMAND_ACK", accepted)

    def mode(self, name):
        number = self.link.mode_mapping()[name]
        self.command(mav.MAV_CMD_DO_SET_MODE, 1, number)
        while (
            self.hear("HEARTBEAT", f"HEARTBEAT.autopilot==3 and HEARTBEAT.custom_mode=={number}", 60) is None
        ):
            pass
        say("mode:", name)


def all_parameters(station):
    """The list, and then what is missing of it, some at a time."""
    first = station.ask(mav.MAVLink_param_request_list_message(1, 1), "PARAM_VALUE")
    missing = set(range(first.param_count)) - {first.param_index}
    while missing:
        value = station.hear("PARAM_VALUE")
        if value is not None:
            missing.discard(value.param_index)
            continue
        for index in sorted(missing)[:AT_ONCE]:
            station.link.mav.param_request_read_send(1, 1, b"", index)
    return first.param_count


def items_around(home, count):
    """Home, a take-off and waypoints on a circle, as ArduPilot numbers them."""
    places = [(16, 0, 0.0, 0.0, home.altitude / 1e3), (22, 3, 0.0, 0.0, 15.0)]
    for number in range(2, count):
        angle = 2 * math.pi * number / count
        places.append((16, 3, 40 * math.cos(angle), 40 * math.sin(angle), 15.0 + number))
    east = math.cos(math.radians(home.latitude / 1e7))
    return [
        mav.MAVLink_mission_item_int_message(
            *(1, 1, seq, frame, command, 0, 1, 0, 0, 0, 0),
            home.latitude + round(north_m * DEG_PER_M * 1e7),
            home.longitude + round(east_m * DEG_PER_M / east * 1e7),
            height_m,
        )
        for seq, (command, frame, north_m, east_m, height_m) in enumerate(places)
    ]


def upload(station, items):
    """Say the item that the autopilot asks for, until it asks for another.

    It refuses one that comes twice and goes on asking; after the last one it knows of no mission that is under way.
    """
    said = mav.MAVLink_mission_count_message(1, 1, len(items))
    for _ in range(TIMES * len(items)):
        station.link.mav.send(said)
        answer = station.hear(["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"])
        while answer is not None and getattr(answer, "type", None) == mav.MAV_MISSION_INVALID_SEQUENCE:
            answer = station.hear(["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"])
        if answer is None:
            say("again:", said.get_type())
        elif answer.get_type() != "MISSION_ACK":
            said = items[answer.seq]
        elif answer.type == mav.MAV_MISSION_ACCEPTED or said is items[-1]:
            return
        else:
            raise RuntimeError(f"mission: MAV_MISSION_RESULT {answer.type}")
    raise RuntimeError("the upload stands still")


def download(station):
    count = station.ask(mav.MAVLink_mission_request_list_message(1, 1), "MISSION_COUNT").count
    items = []
    for seq in range(count):
        request = mav.MAVLink_mission_request_int_message(1, 1, seq)
        items.append(station.ask(request, "MISSION_ITEM_INT", f"MISSION_ITEM_INT.seq=={seq}"))
    station.link.mav.mission_ack_send(1, 1, mav.MAV_MISSION_ACCEPTED)
    return items


def where(item):
    return item.command, item.x, item.y, round(item.z, 2)


def fly(station):
    """Arm, take off in GUIDED, fly to a point, loiter, return."""
    station.link.mav.request_data_stream_send(1, 1, mav.MAV_DATA_STREAM_POSITION, 2, 1)
    station.mode("GUIDED")
    station.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    say("armed")
    station.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
    here = None
    while here is None:
        here = station.hear("GLOBAL_POSITION_INT", "GLOBAL_POSITION_INT.relative_alt>9000", 10)
        station.link.mav.request_data_stream_send(1, 1, mav.MAV_DATA_STREAM_POSITION, 2, 1)
    say(f"height: {here.relative_alt / 1e3:.0f} m")
    goal = here.lat + round(30 * DEG_PER_M * 1e7)
    away = f"abs(GLOBAL_POSITION_INT.lat-{goal})<{round(2 * DEG_PER_M * 1e7)}"
    there = None
    while there is None:
        station.link.mav.set_position_target_global_int_send(
            *(0, 1, 1, 6, 0b110111111000, goal, here.lon, 10.0), *[0] * 8
        )
        there = station.hear("GLOBAL_POSITION_INT", away, 10)
    say(f"north: {(there.lat - here.lat) / 1e7 / DEG_PER_M:.0f} m")
    station.mode("LOITER")
    station.mode("RTL")


def main(address, count):
    station = Station(address)
    while station.hear("HEARTBEAT", "HEARTBEAT.autopilot==3", 60) is None:
        pass
    station.link.target_system = station.link.target_component = 1
    say("parameters:", all_parameters(station))
    home = None
    while home is None:  # it has none before it knows where it is
        request = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_REQUEST_MESSAGE, 0, 242, *[0.0] * 6)
        home = station.ask(request, ["HOME_POSITION", "COMMAND_ACK"])
        home = home if home.get_type() == "HOME_POSITION" else station.hear("HOME_POSITION")
    items = items_around(home, count)
    upload(station, items)
    kept = download(station)
    same = [where(item) for item in kept[1:]] == [where(item) for item in items[1:]]
    say(f"mission: {len(items)} up, {len(kept)} down, the same: {same}")
    fly(station)


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("address", nargs="?", default="tcp:127.0.0.1:5790")
parser.add_argument("--items", type=int, default=20)
arguments = parser.parse_args()
main(arguments.address, arguments.items)
