"""What is overheard of transfers is what the autopilot of the bench keeps, however they went."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.missions.items import MissionItem
from aps.vehicle.missions.overheard import Overheard
from aps.wire.framer import Framer
from tests.unit.aps.vehicle.peer import OURS, SYSID, Bench

ITEMS = [MissionItem.waypoint(47.0 + n * 1e-4, 8.0 - n * 3e-4, 20.0 + n) for n in range(60)]
RALLY = [MissionItem(5100, (0.0, 0.0, 0.0, 0.0, 47.0, 8.0 + n * 1e-3, 30.0)) for n in range(3)]


class Listener:
    """Hears a bench's link at the autopilot's end: what came to it, and all that it says."""

    def __init__(self, bench):
        self.overheard = Overheard()
        for link, to in ((bench.to_autopilot, True), (bench.from_autopilot, False)):
            link.carry = self._tapped(link.carry, to)

    def _tapped(self, carry, to):
        framer = Framer()

        def carried(frame):
            arrived = carry(frame)
            for heard in framer.receive(arrived if to else frame):
                self.overheard.take(heard, to_autopilot=to)
            return arrived

        return carried

    def places(self, kind):
        """Latitude and longitude, 1e-7 degrees, and height of each item; None if nothing was overheard."""
        found = self.overheard.lists.get(kind)
        return found and [
            (round(item.params[4] * 1e7), round(item.params[5] * 1e7), item.params[6]) for item in found
        ]


def kept(bench, kind):
    return [(item.x, item.y, item.z) for item in bench.autopilot.items[kind]]


@pytest.mark.parametrize(("drop", "seed"), [(0.0, 1), (0.05, 2), (0.1, 3)])
def test_uploads_and_downloads_give_what_the_autopilot_keeps(drop, seed):
    bench = Bench(drop=drop, seed=seed)
    listener = Listener(bench)
    assert bench.run("mission_upload", ITEMS).reached
    assert len(listener.places("mission")) == 61  # with home
    assert listener.places("mission") == kept(bench, 0)
    late = Listener(bench)
    assert bench.run("mission_download").reached
    assert late.places("mission") == kept(bench, 0)
    assert late.places("rally") is None
    assert bench.run("mission_upload", RALLY, kind="rally").reached
    assert listener.places("rally") == kept(bench, 2)
    assert len(kept(bench, 2)) == 3


def test_a_list_that_is_cleared_is_empty_and_one_that_was_refused_stays():
    bench = Bench()
    listener = Listener(bench)
    bench.run("mission_upload", RALLY, kind="rally")
    bench.autopilot.busy_with = (255, 190)
    assert not bench.run("mission_upload", RALLY[:1], kind="rally").reached
    assert len(listener.places("rally")) == 3
    bench.autopilot.busy_with = None
    assert bench.run("mission_clear", kind="rally").reached
    assert listener.overheard.lists["rally"] == ()
    assert bench.run("mission_upload", [], kind="fence").reached
    assert listener.overheard.lists["fence"] == ()


def say(overheard, message, *, to):
    """A message from a ground station to the autopilot, or from it."""
    source = (255, 190) if to else (SYSID, 1)
    mav = mavlink.MAVLink(None, srcSystem=source[0], srcComponent=source[1])
    for frame in Framer().receive(bytes(message.pack(mav))):
        overheard.take(frame, to_autopilot=to)


def old_item(seq, lat_deg, current=0):
    """MISSION_ITEM, as old clients send it."""
    return mavlink.MAVLink_mission_item_message(
        SYSID, 1, seq, 3, 16, current, 1, 0, 0, 0, 0, lat_deg, 8.0, 20.0, 0
    )


def test_old_clients_items_parts_of_missions_and_targets():
    overheard = Overheard()
    accepted = mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED, 0)
    say(overheard, mavlink.MAVLink_mission_count_message(SYSID, 1, 3, 0), to=True)
    say(overheard, accepted, to=False)  # late, of a transfer before
    for seq in range(3):
        say(overheard, old_item(seq, 47.0 + seq), to=True)
    say(overheard, old_item(1, 11.0, current=2), to=True)  # a target for GUIDED
    assert overheard.lists == {}
    say(overheard, accepted, to=False)
    assert [item.params[4] for item in overheard.lists["mission"]] == [47.0, 48.0, 49.0]
    say(overheard, mavlink.MAVLink_mission_write_partial_list_message(SYSID, 1, 1, 1, 0), to=True)
    say(overheard, old_item(1, 50.0), to=True)
    say(overheard, accepted, to=False)
    assert [item.params[4] for item in overheard.lists["mission"]] == [47.0, 50.0, 49.0]
    say(overheard, mavlink.MAVLink_mission_clear_all_message(SYSID, 1, 255), to=True)
    assert len(overheard.lists["mission"]) == 3
    say(overheard, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED, 255), to=False)
    assert overheard.lists == {"mission": (), "fence": (), "rally": ()}


@pytest.mark.parametrize("none", [2**31 - 1, -(2**31)])
def test_a_list_is_whole_whose_items_give_no_place(none):
    overheard = Overheard()
    say(overheard, mavlink.MAVLink_mission_count_message(SYSID, 1, 2, 0), to=True)
    say(overheard, old_item(0, 47.0), to=True)
    land = (SYSID, 1, 1, 3, 21, 0, 1, 0, 0, 0, 0, none, none, 0, 0)
    say(overheard, mavlink.MAVLink_mission_item_int_message(*land), to=True)
    say(overheard, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED, 0), to=False)
    assert [(item.command, item.is_placed) for item in overheard.lists["mission"]] == [
        (16, True),
        (21, False),
    ]


def test_somebody_elses_acknowledgement_ends_nothing():
    overheard = Overheard()
    say(overheard, mavlink.MAVLink_mission_count_message(SYSID, 1, 1, 0), to=True)
    say(overheard, old_item(0, 47.0), to=True)
    say(overheard, mavlink.MAVLink_mission_ack_message(OURS, OURS, mavlink.MAV_MISSION_DENIED, 0), to=False)
    say(overheard, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED, 0), to=False)
    assert len(overheard.lists["mission"]) == 1
