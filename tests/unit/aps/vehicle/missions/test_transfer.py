import json
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.execution import Outcome
from aps.vehicle.missions.items import MissionItem
from aps.wire.framer import Framer
from tests.unit.aps.vehicle.peer import Bench, KeepingAutopilot

ITEMS = [
    MissionItem(
        16, (n % 7, 0.0, 0.0, math.nan, round(47.0 + n * 1e-4, 7), round(-8.0 - n * 3e-4, 7), 20.0 + n)
    )
    for n in range(200)
]
RALLY_NOWHERE = {"command": 5100, "params": [0, 0, 0, 0, None, None, 9]}
FENCE_AT_47 = {"command": "NAV_FENCE_POLYGON_VERTEX_INCLUSION", "params": [2, 0, 0, 0, 47, 8, 0]}
FENCE_AT_ZERO = {"command": "NAV_FENCE_POLYGON_VERTEX_INCLUSION", "params": [3, 0, 0, 0, 0, 0, 0]}


def same(items, others):
    """NaN equals NaN here."""
    return [repr(item) for item in items] == [repr(MissionItem.from_json(other)) for other in others]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_200_items_up_and_down_unchanged_over_a_link_that_loses_and_corrupts(seed):
    bench = Bench(drop=0.05, corrupt=0.02, seed=seed)
    result = bench.run("mission_upload", ITEMS)
    assert (result.outcome, result.value) == (Outcome.REACHED, 200)
    # The autopilot has 201: home is its first.
    kept = bench.autopilot.items[0]
    assert [item.seq for item in kept] == list(range(201))
    assert [(item.x, item.y, item.z) for item in kept[1:]] == [
        (round(item.params[4] * 1e7), round(item.params[5] * 1e7), item.params[6]) for item in ITEMS
    ]
    result = bench.run("mission_download")
    assert result.reached
    assert same(ITEMS, result.value)
    for link in (bench.to_autopilot, bench.from_autopilot):
        assert link.dropped > 10
        assert link.corrupted > 3
    assert bench.heard("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_ACCEPTED


def test_a_clean_transfer_says_nothing_twice():
    bench = Bench()
    bench.run("mission_upload", ITEMS[:5])
    assert [message.seq for message in bench.heard("MISSION_ITEM_INT")] == [0, 1, 2, 3, 4, 5]
    assert [message.count for message in bench.heard("MISSION_COUNT")] == [6]
    assert [message.current for message in bench.heard("MISSION_ITEM_INT")] == [1, 0, 0, 0, 0, 0]
    bench.run("mission_download")
    assert [message.seq for message in bench.heard("MISSION_REQUEST_INT")] == [0, 1, 2, 3, 4, 5]
    assert len(bench.heard("MISSION_ACK")) == 1


@pytest.mark.parametrize("count", [1, 3])
def test_what_comes_late_of_the_upload_before_is_no_end_of_this_one(count):
    """A frame that was cut short keeps those after it back, with the last request and the acknowledgement."""
    bench = Bench()
    bench.autopilot.mute = {"MISSION_COUNT"}  # lost on its way
    results = []
    items = [MissionItem(5100, (0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 30.0))] * count
    bench.commands.start("mission_upload", items, kind="rally", on_done=results.append)
    bench.step()
    late = (
        mavlink.MAVLink_mission_request_int_message(7, 191, count - 1, 2),
        mavlink.MAVLink_mission_ack_message(7, 191, mavlink.MAV_MISSION_ACCEPTED, 2),
    )
    for frame in Framer().receive(b"".join(bytes(each.pack(bench.autopilot.mav)) for each in late)):
        bench.vehicle.receive(frame, bench.now_ns)
    bench.autopilot.mute = set()
    while not results:
        bench.step()
    assert results[0].outcome is Outcome.REACHED
    assert len(bench.autopilot.items[2]) == count


def lose_ends(bench, times):
    """Lose the acknowledgements of the next uploads that the autopilot has whole; it counts these as ``ends``."""
    accept, bench.autopilot.ends = bench.autopilot._close, 0

    def close():
        bench.autopilot.ends += 1
        bench.autopilot.lost["MISSION_ACK"] = int(bench.autopilot.ends <= times)
        accept()

    bench.autopilot._close = close


def refuse_ends(bench, kind=0):
    """Have the autopilot answer with an error to each upload that it has whole."""

    def close():
        bench.autopilot._upload = None
        bench.autopilot._mission_ack_out(mavlink.MAV_MISSION_ERROR, kind)

    bench.autopilot._close = close


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize(("kind", "number"), [("mission", 0), ("fence", 1), ("rally", 2)])
@pytest.mark.parametrize("mav_autopilot", [3, 12])
def test_an_upload_whose_acknowledgement_alone_is_lost_is_reached(mav_autopilot, kind, number, count):
    bench = Bench(mav_autopilot=mav_autopilot)
    bench.autopilot.acknowledges_again = mav_autopilot == 12
    bench.autopilot.lost["MISSION_ACK"] = 1
    items = [MissionItem(5100, (0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 30.0))] * count
    result = bench.run("mission_upload", items, kind=kind)
    assert (result.outcome, result.value) == (Outcome.REACHED, count)
    kept = [item.seq for item in bench.autopilot.items[number]]
    assert kept == list(range(count + (kind == "mission" and mav_autopilot == 3)))
    # PX4 has but to acknowledge again. A single item is no end of a list for certain: the count is repeated there.
    assert len(bench.heard("MISSION_COUNT")) == (1 if mav_autopilot == 12 and count > 1 else 2)
    assert [progress.phase for progress in bench.progress].count("accepted") <= 1
    assert bench.now_ns < 1.3e9  # one time-out of 1 s


@pytest.mark.parametrize(
    ("command", "frame"),
    [
        ("NAV_WAYPOINT", 3),
        ("NAV_RETURN_TO_LAUNCH", 2),
        ("DO_CHANGE_SPEED", 2),
        ("NAV_LAND", 3),
        ("NAV_CONTINUE_AND_CHANGE_ALT", 3),
    ],
)
def test_an_item_whose_frame_nobody_says_has_that_of_its_command(command, frame):
    """PX4 takes commands without a position in MAV_FRAME_MISSION alone, mavlink_mission.cpp.

    ArduPilot takes heights in that for heights above the sea, AP_Mission::mavlink_int_to_mission_cmd.
    """
    item = MissionItem.from_json({"command": command, "params": [0] * 7})
    assert item.frame == MissionItem(item.command, item.params).frame == frame
    assert MissionItem.from_json(item.to_json()) == item
    for wrong in (-1, None, 256):
        with pytest.raises(ValueError, match=r"frame|MAV_FRAME|whole number"):
            MissionItem.from_json({"command": command, "params": [0] * 7, "frame": wrong})


@pytest.mark.parametrize("value", ["false", 2, None, []])
def test_autocontinue_is_true_or_false(value):
    item = {"command": 16, "params": [0] * 7, "autocontinue": value}
    with pytest.raises(ValueError, match=r"^autocontinue is true or false, not "):
        MissionItem.from_json(item)
    assert not MissionItem.from_json(item | {"autocontinue": 0}).autocontinue


REFUSED_LAST = "ERROR, after item 3 of 3 (NAV_WAYPOINT, frame 3)"


def test_an_error_to_an_item_that_came_in_time_is_a_refusal():
    bench = Bench()
    refuse_ends(bench)
    result = bench.run("mission_upload", ITEMS[:3])
    assert (result.outcome, result.reason) == (Outcome.REFUSED, REFUSED_LAST)
    assert len(bench.heard("MISSION_COUNT")) == 1


@pytest.mark.parametrize("before", [True, False])
def test_a_refusal_has_the_autopilots_words(before):
    """ArduCopter's come behind its acknowledgement, as they are queued apart."""
    bench = Bench()

    def close():
        words = mavlink.MAVLink_statustext_message(4, b"Invalid vertex count (2)", 0, 0)
        told = mavlink.MAVLink_mission_ack_message(7, 191, mavlink.MAV_MISSION_ERROR, 1)
        bench.autopilot._upload = None
        check = mavlink.MAVLink_statustext_message(2, b"PreArm: Compass not healthy", 0, 0)
        for message in (check, words, told) if before else (check, told, words):
            bench.autopilot.say(message)

    bench.autopilot._close = close
    result = bench.run("mission_upload", [MissionItem.from_json(FENCE_AT_47)] * 2, kind="fence")
    place = "after item 2 of 2 (NAV_FENCE_POLYGON_VERTEX_INCLUSION, frame 3)"
    assert (result.outcome, result.reason) == (Outcome.REFUSED, f"ERROR, {place}: Invalid vertex count (2)")
    assert bench.now_ns < 0.5e9


@pytest.mark.parametrize(
    ("kind", "item", "text"),
    [
        (
            "fence",
            {"command": 5003, "params": [None, 0, 0, 0, 47, 8, 0]},
            "CIRCLE_INCLUSION needs its parameter 1",
        ),
        ("fence", {"command": 5002, "params": [None, 0, 0, 0, 47, 8, 0]}, "EXCLUSION needs its parameter 1"),
        (
            "rally",
            {"command": 5100, "params": [0, 0, 0, 0, 47, 8, None]},
            "RALLY_POINT needs its parameter 7",
        ),
    ],
)
def test_a_number_that_would_end_a_simulated_ardupilot_is_a_mistake(kind, item, text):
    with pytest.raises(ValueError, match=f"^item 1: .*{text}$"):
        Bench().commands.start("mission_upload", [item | {"params": [3, 0, 0, 0, 47, 8, 9]}, item], kind=kind)


def test_an_error_to_the_count_of_an_empty_list_that_came_again_is_a_refusal():
    bench = Bench()
    refuse_ends(bench, kind=1)
    bench.autopilot.lost["MISSION_ACK"] = 1
    result = bench.run("mission_upload", [], kind="fence")
    assert (result.outcome, result.reason) == (Outcome.REFUSED, "ERROR")
    assert len(bench.heard("MISSION_COUNT")) == 2


def test_a_refusal_that_is_lost_is_one_the_second_time():
    bench = Bench()
    refuse_ends(bench)
    bench.autopilot.lost["MISSION_ACK"] = 1
    result = bench.run("mission_upload", ITEMS[:3])
    assert (result.outcome, result.reason) == (Outcome.REFUSED, REFUSED_LAST)
    assert len(bench.heard("MISSION_COUNT")) == 2


def test_answers_to_items_that_were_said_twice_are_no_refusal_of_the_upload_that_was_begun_anew():
    """What the autopilot says comes 2.5 s late: the last item was said three times before anything of it is known."""
    bench = Bench()
    lose_ends(bench, 1)
    waiting, carry = [], bench.from_autopilot.carry

    def delayed(raw):
        waiting.append((bench.now_ns + 2_500_000_000, raw))
        return b""

    bench.from_autopilot.carry = delayed
    results = []
    bench.commands.start("mission_upload", ITEMS[:3], on_done=results.append)
    while not results:
        bench.step()
        while waiting and waiting[0][0] <= bench.now_ns:
            for frame in Framer().receive(carry(waiting.pop(0)[1])):
                bench.vehicle.receive(frame, bench.now_ns)
    assert (results[0].outcome, results[0].value) == (Outcome.REACHED, 3)
    assert bench.autopilot.ends == 2


def test_an_upload_whose_acknowledgement_is_always_lost_is_begun_three_times_and_times_out():
    bench = Bench()
    lose_ends(bench, 99)
    result = bench.run("mission_upload", ITEMS[:3])
    assert result.outcome is Outcome.TIMED_OUT
    assert result.reason == "no answer after 8 tries (mission: 4 of 4 items sent)"
    assert len(bench.heard("MISSION_COUNT")) == 3


@pytest.mark.parametrize(("kind", "number"), [("fence", 1), ("rally", 2)])
def test_fence_and_rally_have_no_home(kind, number):
    bench = Bench()
    items = [MissionItem(5100, (0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 30.0))] * 3
    assert bench.run("mission_upload", items, kind=kind).value == 3
    assert len(bench.autopilot.items[number]) == 3
    assert same(items, bench.run("mission_download", kind=kind).value)
    assert bench.run("mission_clear", kind=kind).reached
    assert bench.autopilot.items[number] == []
    assert bench.run("mission_download", kind=kind).value == []


def test_px4_keeps_no_home():
    bench = Bench(mav_autopilot=12)
    bench.run("mission_upload", ITEMS[:2])
    assert len(bench.autopilot.items[0]) == 2
    assert same(ITEMS[:2], bench.run("mission_download").value)


def test_progress_counts_the_items():
    bench = Bench()
    bench.run("mission_upload", ITEMS[:25])
    told = [(progress.phase, progress.done, progress.total) for progress in bench.progress]
    assert told == [("accepted", 0, 25), ("feedback", 9, 25), ("feedback", 19, 25), ("feedback", 25, 25)]


def test_a_denied_upload_is_refused_in_the_autopilots_words():
    bench = Bench()
    bench.autopilot.busy_with = (255, 190)
    result = bench.run("mission_upload", ITEMS)
    assert (result.outcome, result.reason) == (Outcome.REFUSED, "DENIED (another transfer is under way)")


def test_a_second_transfer_of_ours_is_refused_and_the_first_goes_on():
    bench = Bench()
    ends = []
    for verb, arguments in (("mission_upload", (ITEMS,)), ("mission_download", ())):
        bench.commands.start(verb, *arguments, on_done=ends.append)
    assert [str(end) for end in ends] == ["mission_download refused: mission_upload is under way"]
    for _ in range(1000):
        bench.step()
    assert [str(end) for end in ends[1:]] == ["mission_upload reached"]


def test_an_autopilot_that_falls_silent_ends_the_transfer_and_is_told():
    autopilot = KeepingAutopilot()
    bench = Bench(autopilot)
    autopilot.mute.add("MISSION_ITEM_INT")
    autopilot.step = lambda: None  # nor does it ask again
    result = bench.run("mission_upload", ITEMS)
    assert result.outcome is Outcome.TIMED_OUT
    assert result.reason == "no answer after 8 tries (mission: 1 of 201 items sent)"
    assert bench.heard("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_OPERATION_CANCELLED


def test_an_autopilot_that_asks_for_what_there_is_not_is_no_end_of_us():
    autopilot = KeepingAutopilot()
    bench = Bench(autopilot)
    bench.commands.start("mission_upload", ITEMS[:2], on_done=(ends := []).append)
    bench.step()
    autopilot.say(mavlink.MAVLink_mission_request_int_message(7, 191, 500, 0))
    bench.step()
    assert [str(end) for end in ends] == ["mission_upload refused: the autopilot asks for item 500 of 3"]


def test_messages_for_other_stations_are_not_ours():
    autopilot = KeepingAutopilot()
    bench = Bench(autopilot)
    bench.commands.start("mission_download", on_done=(ends := []).append)
    autopilot.mute.add("MISSION_REQUEST_LIST")
    autopilot.say(mavlink.MAVLink_mission_count_message(255, 190, 0, 0))
    for _ in range(20):
        bench.step()
    assert ends == []


LAND_HERE = MissionItem(21, (0.0, 0.0, 0.0, 0.0, math.nan, math.nan, 0.0))


def test_a_place_that_is_not_given_is_where_ardupilot_is():
    bench = Bench()
    assert bench.run("mission_upload", [*ITEMS[:1], LAND_HERE]).value == 2
    last = bench.autopilot.items[0][-1]
    assert (last.command, last.x, last.y) == (21, 0, 0)


@pytest.mark.parametrize(("mav_autopilot", "name"), [(12, "PX4"), (0, "another autopilot")])
@pytest.mark.parametrize("place", [(math.nan, math.nan), (math.nan, 8.5), (47.0, math.nan)])
@pytest.mark.parametrize(("command", "label"), [(21, "NAV_LAND"), (16, "NAV_WAYPOINT")])
def test_an_autopilot_that_has_no_place_of_its_own_for_an_item_is_told_one(
    mav_autopilot, name, place, command, label
):
    """PX4 takes INT32_MAX for a latitude of 214.7 degrees."""
    bench = Bench(mav_autopilot=mav_autopilot)
    item = MissionItem(command, (0.0, 0.0, 0.0, 0.0, *place, 0.0))
    text = f"item 1: {name} needs a latitude and a longitude for {label}"
    with pytest.raises(ValueError, match=f"^{text}$"):
        bench.commands.start("mission_upload", [*ITEMS[:1], item])
    assert bench.heard("MISSION_COUNT") == []


@pytest.mark.parametrize(("mav_autopilot", "x"), [(3, 0), (12, 2**31 - 1), (0, 2**31 - 1)])
@pytest.mark.parametrize(("command", "frame"), [(2000, 2), (20, 3)])
def test_an_item_that_is_nowhere_is_sent_without_a_place(mav_autopilot, x, command, frame):
    """INT32_MAX is none."""
    bench = Bench(mav_autopilot=mav_autopilot)
    item = MissionItem(command, (0.0, 0.0, 1.0, 0.0, math.nan, math.nan, 0.0), frame)
    assert bench.run("mission_upload", [*ITEMS[:1], item]).value == 2
    last = bench.autopilot.items[0][-1]
    assert (last.command, last.x, last.y) == (command, x, x)


@pytest.mark.parametrize("none", [2**31 - 1, -(2**31)])
@pytest.mark.parametrize(("command", "frame"), [(21, 3), (21, 6), (21, 1), (2000, 2)])
def test_a_list_is_downloaded_whose_items_give_no_place(command, frame, none):
    """INT32_MAX says so; INT32_MIN is QGroundControl's."""
    bench = Bench(mav_autopilot=12)
    item = mavlink.MAVLink_mission_item_int_message(
        7, 1, 0, frame, command, 0, 1, 0, 0, 0, 0, none, none, 0, 0
    )
    bench.autopilot.items[0] = [item]
    (found,) = bench.run("mission_download").value
    assert found["params"] == [0.0, 0.0, 0.0, 0.0, None, None, 0.0]
    json.dumps(found, allow_nan=False)


def test_a_number_that_says_that_none_is_given_is_none_to_give():
    with pytest.raises(ValueError, match="more than MAVLink can carry"):
        MissionItem(183, (0.0, 0.0, 0.0, 0.0, 2**31 - 1, 0.0, 0.0), frame=2)
    MissionItem(183, (0.0, 0.0, 0.0, 0.0, 2**31 - 2, 0.0, 0.0), frame=2)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("mission", "moon"), "items must be a list"),
        (([{"command": 16}],), "item 0: an item has 'command' and 'params'"),
        (([{"command": "FLY", "params": [0] * 7}],), "item 0: 'FLY' is no MAV_CMD"),
        (([{"command": 16, "params": [0] * 6}],), "item 0: params must be a list of 7 numbers"),
        (([{"command": 16, "params": [0, 0, 0, 0, 91, 0, 0]}],), "no latitude and longitude"),
        (([{"command": 16, "params": [1e39, 0, 0, 0, 47, 8, 0]}],), "item 0: params .* must be finite"),
        (([{"command": 16, "params": [0, 0, 0, 0, 47, 8, -1e39]}],), "item 0: params .* must be finite"),
        (([{"command": 16, "params": [10**400, 0, 0, 0, 47, 8, 0]}],), "item 0: params .* must be finite"),
        (
            ([{"command": 5100, "params": [0, 0, 0, 0, 47, 8, 9]}, RALLY_NOWHERE], "rally"),
            "item 1: a rally item",
        ),
        (([FENCE_AT_ZERO], "fence"), "item 0: a fence item needs a latitude and a longitude, not both 0"),
        (([], "moon"), "kind 'moon' is none of mission, fence, rally"),
    ],
)
def test_mistakes_of_the_caller_raise(arguments, text):
    bench = Bench()
    with pytest.raises(ValueError, match=text):
        bench.commands.start("mission_upload", *arguments)


@pytest.mark.parametrize(
    "item",
    [
        MissionItem(16, (0.0, 0.0, 0.0, math.nan, 47.1234567, -8.7654321, 12.5)),
        MissionItem(16, (0.0, 0.0, 0.0, 0.0, 12.5, -7.25, -3.0), frame=1),
        MissionItem(203, (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0), frame=2),
        MissionItem(177, (2.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0), autocontinue=False),
        MissionItem(21, (0.0, 0.0, 0.0, math.nan, math.nan, math.nan, 0.0)),
        MissionItem(21, (0.0, 0.0, 0.0, math.nan, math.nan, 8.5, 0.0)),
        MissionItem(2000, (0.0, 0.0, 1.0, 0.0, math.nan, math.nan, math.nan), frame=2),
    ],
)
def test_an_item_is_the_same_after_message_and_json(item):
    message = item.to_message(1, 3, 0)
    fields = {name: getattr(message, name) for name in message.fieldnames}
    assert repr(MissionItem.from_fields(fields)) == repr(item)
    assert repr(MissionItem.from_json(item.to_json())) == repr(item)
