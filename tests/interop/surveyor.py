"""An agent with all that ground stations show: a mission, a fence of two polygons and two circles, rally points."""

SCENARIO = """\
schema: 1
name: survey
seed: 3
speed: {speed}
duration_s: {duration_s}
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
radio: moon2020
ports: {{zenoh: 0, first_slot: {slot}}}
nodes:
  - {{id: 0, home: {{north_m: 30}}, agent: {{type: hold, altitude_m: 15}}}}
  - {{id: 1, agent: {{type: own, class: "surveyor.py:Surveyor"}}}}
"""
AGENT = """\
import math

from lostlink import Agent

SCALE = 111318.845  # ArduPilot's metres per degree


def item(command, north_m, east_m, height_m=0.0, first=0.0):
    lat_deg, lon_deg = 40.1331 + north_m / SCALE, -105.2404 + east_m / SCALE / math.cos(math.radians(40.1331))
    return {"command": command, "params": [first, 0, 0, 0, lat_deg, lon_deg, height_m]}


MISSION = [
    {"command": "NAV_TAKEOFF", "params": [0, 0, 0, 0, 0, 0, 20]},
    *(item("NAV_WAYPOINT", *place, 20.0) for place in ((60, 0), (60, 80), (100, 80), (100, 0))),
    {"command": "NAV_RETURN_TO_LAUNCH", "params": [0] * 7},
]
INSIDE = ((-40, -60), (150, -60), (150, 140), (-40, 95))
FENCE = [
    *(item("NAV_FENCE_POLYGON_VERTEX_INCLUSION", *place, first=4) for place in INSIDE),
    *(item("NAV_FENCE_POLYGON_VERTEX_EXCLUSION", *p, first=3) for p in ((20, 30), (45, 30), (45, 60))),
    item("NAV_FENCE_CIRCLE_EXCLUSION", 80, 40, first=12.0),
    item("NAV_FENCE_CIRCLE_INCLUSION", 50, 40, first=130.0),
]
RALLY = [item("NAV_RALLY_POINT", 0, 110, 25.0), item("NAV_RALLY_POINT", 130, -30, 25.0)]


class Surveyor(Agent):
    async def fly(self):
        await self.ua.wait_for(lambda state: state.ready_to_arm)
        for kind, items in (("fence", FENCE), ("rally", RALLY), ("mission", MISSION)):
            await self.ua.missions.upload(items, kind)
        await self.take_off(20.0)
        await self.ua.missions.fly()
"""
