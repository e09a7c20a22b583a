"""Autopilots of other systems on the link to ours."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.vehicle import Vehicle
from aps.wire.framer import Framer

SYSID = 7
OURS = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
OTHER = mavlink.MAVLink(None, srcSystem=SYSID + 1, srcComponent=1)


@pytest.fixture
def told():
    return []


@pytest.fixture
def vehicle(told):
    vehicle = Vehicle(SYSID, {}, lambda _: None, lambda: 0, lambda: None)
    vehicle.on_foreign = told.append
    vehicle.link_up()
    return vehicle


def hear(vehicle, *senders):
    for sender in senders:
        (frame,) = Framer().receive(bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(sender)))
        vehicle.receive(frame, 0)


def test_an_autopilot_of_another_system_alone_is_told_once(vehicle, told):
    hear(vehicle, OTHER, OTHER)
    assert told == []
    hear(vehicle, *[OTHER] * 5)
    assert told == [SYSID + 1]


def test_one_that_hands_on_others_heartbeats_is_not(vehicle, told):
    hear(vehicle, OTHER, OURS, *[OTHER] * 5)
    vehicle.link_down()
    vehicle.link_up()
    hear(vehicle, *[OTHER] * 5)
    assert told == []
    assert vehicle.statistics()["other_systems"] == [SYSID + 1]
