"""What autopilots have on board, by records of their MAVLink made with pymavlink: while they grow, at any instant."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bridge.agents.frames import Frames
from bridge.record.names import from_autopilot, to_autopilot
from bridge.record.streams import StreamWriter
from fdm.model.geodesy import GeodeticPosition
from lostlink.view.page.onboard_tables import onboard_words, plan_rows, plan_words, text_rows
from lostlink.view.picture.onboard import Onboard
from lostlink.view.picture.plan import PlanDrawing
from lostlink.view.sources.onboard import OnboardLog, Onboards

S = 1_000_000_000
ORIGIN = GeodeticPosition(40.0, -105.0, 1600.0)
M_PER_DEG = 111318.84502145034
"""ArduPilot's LOCATION_SCALING_FACTOR, 0.011131884502145034 m per 1e-7 degree."""
COS = 0.7660444431
"""Of 40 degrees."""


class Link:
    """A UA's recorded MAVLink; a ground station is system 255."""

    def __init__(self, run: Path, node: str = "1") -> None:
        self._streams = {
            to: StreamWriter(stream(node).path(run))
            for to, stream in ((False, from_autopilot), (True, to_autopilot))
        }
        self._mavs = {
            to: mavlink.MAVLink(None, srcSystem=255 if to else 2, srcComponent=190 if to else 1)
            for to in (False, True)
        }

    def says(self, time_s: float, *messages: Any) -> None:
        """The autopilot says something."""
        self._write(time_s, messages, to=False)

    def hears(self, time_s: float, *messages: Any) -> None:
        """The autopilot is told something."""
        self._write(time_s, messages, to=True)

    def _write(self, time_s: float, messages: tuple[Any, ...], *, to: bool) -> None:
        data = b"".join(bytes(message.pack(self._mavs[to])) for message in messages)
        self._streams[to].write(round(time_s * S), data)

    def flush(self, *sides: bool) -> None:
        """Have it read; ``sides``: those of which it is."""
        for side in sides or (False, True):
            self._streams[side].flush()

    def close(self) -> None:
        for stream in self._streams.values():
            stream.close()

    def upload(self, time_s: float, kind: int, items: list[tuple[int, float, float, float, float]]) -> None:
        """An item: command, first parameter, north and east of the origin, m, height, m."""
        self.hears(time_s, mavlink.MAVLink_mission_count_message(2, 1, len(items), kind))
        for seq, (command, first, north, east, height) in enumerate(items):
            is_placed = (north, east) != (0, 0)
            place = (north / M_PER_DEG + 40.0, east / M_PER_DEG / COS - 105.0) if is_placed else (0.0, 0.0)
            at = [round(1e7 * degrees) for degrees in place]
            head = (2, 1, seq, 3, command, 0, 1, first, 0, 0, 0)
            self.hears(time_s + 0.1, mavlink.MAVLink_mission_item_int_message(*head, *at, height, kind))
        accepted = mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED, kind)
        self.says(time_s + 0.2, accepted)


def home(lat_e7: int = 400_000_000, alt_mm: int = 1_610_000) -> Any:
    return mavlink.MAVLink_home_position_message(
        lat_e7, -1_050_000_000, alt_mm, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
    )


def text(words: str, severity: int = 6, number: int = 0, chunk: int = 0) -> Any:
    return mavlink.MAVLink_statustext_message(severity, words.encode(), number, chunk)


def read(log: OnboardLog, time_s: float = 1e6) -> Onboard:
    while log.read():
        pass
    return log.at(round(time_s * S))


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """A UA that says where it is at home, gets a plan, flies, and is sent elsewhere."""
    link = Link(tmp_path)
    link.says(
        1.0, mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3), home(), text("EKF3 IMU0 is using GPS")
    )
    link.says(1.0, mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 9))
    link.upload(2.0, 0, [(16, 0, 1, 1, 0), (22, 0, 0, 0, 20), (16, 0, 100, 50, 30), (20, 0, 0, 0, 0)])
    link.upload(
        3.0, 1, [(5001, 3, 10, 0, 0), (5001, 3, 10, 20, 0), (5001, 3, 90, 0, 0), (5004, 15, 40, 40, 0)]
    )
    link.upload(4.0, 2, [(5100, 0, -20, 5, 12)])
    for tick in range(10):
        state = mavlink.MISSION_STATE_ACTIVE
        link.says(5.0 + tick, mavlink.MAVLink_mission_current_message(1 + tick // 5, 3, state, 1))
    link.says(14.5, text("a" * 50, 4, 7, 0), text("nd more", 4, 7, 1))
    goal = (40.0 + 7.0 / M_PER_DEG, -105.0)
    command = (2, 1, 3, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0, 0)
    link.hears(16.0, mavlink.MAVLink_command_int_message(*command, *(round(1e7 * d) for d in goal), 30.0))
    link.close()
    return tmp_path


def test_what_is_on_board_at_each_instant(flight: Path) -> None:
    log = OnboardLog(flight, "1")
    end = read(log)
    assert (end.current, end.mission_state, end.gps_fix, end.satellites) == (2, "ACTIVE", 3, 9)
    assert [(each.sim_time_ns, each.severity, each.text) for each in end.texts] == [
        (S, 6, "EKF3 IMU0 is using GPS"),
        (14_500_000_000, 4, "a" * 50 + "nd more"),
    ]
    assert end.changes < 30  # what was repeated is not kept
    early = log.at(6 * S)
    assert (early.current, len(early.texts), early.target) == (1, 1, None)
    assert log.at(2 * S).items("mission") is None
    assert len(log.at(round(2.3 * S)).items("mission") or ()) == 3
    assert log.at(round(2.3 * S)).items("fence") is None
    log.close()


def test_what_the_map_is_sent_is_in_decimetres_from_the_origin(flight: Path) -> None:
    log = OnboardLog(flight, "1")
    drawing = PlanDrawing(Frames(ORIGIN))
    content = drawing.content(read(log), is_guided=True)
    assert content == {
        "home": [0, 0, -100],  # 10 m above the origin
        "target": [70, 0],
        "items": [
            {"number": 1, "at": [0, 0, -100], "way": True, "beside": True},  # climbs at home
            {"number": 2, "at": [1000, 500, -400], "way": True},  # 30 m above home
            {"number": 3, "at": [0, 0, -100], "way": True, "beside": True},  # comes back
        ],
        "current": 2,
        "fence": [
            {"inside": True, "polygon": [100, 0, 100, 200, 900, 0]},
            {"inside": False, "circle": [400, 400, 150]},
        ],
        "rally": [[-200, 50, -220]],
    }
    assert drawing.content(log.at(20 * S), is_guided=False)["target"] is None
    assert drawing.content(None, is_guided=False) == {}
    log.close()


def test_items_with_numbers_that_are_none_are_not_drawn(tmp_path: Path) -> None:
    nan = math.nan
    link = Link(tmp_path)
    link.says(1.0, mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3), home())
    link.upload(2.0, 0, [(16, 0, 1, 1, 0), (16, 0, 100, 50, nan)])
    corners = [(5001, nan, 10, 0, 0), (5003, nan, 40, 40, 0), (5004, 5, 40, 40, 0)]
    link.upload(3.0, 1, corners)
    link.close()
    log = OnboardLog(tmp_path, "1")
    content = PlanDrawing(Frames(ORIGIN)).content(read(log), is_guided=False)
    log.close()
    assert content["fence"] == [{"inside": False, "circle": [400, 400, 50]}]
    assert [item["at"] for item in content["items"]] == [[1000, 500, -100]]


def test_an_item_that_gives_no_place_is_in_the_table_and_not_drawn(tmp_path: Path) -> None:
    link = Link(tmp_path)
    link.says(1.0, mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3), home())
    link.hears(2.0, mavlink.MAVLink_mission_count_message(2, 1, 3, 0))
    places = [(16, 400_000_000, -1_050_000_000), (16, 400_010_000, -1_050_000_000), (21, *[2**31 - 1] * 2)]
    for seq, (command, *at) in enumerate(places):
        head = (2, 1, seq, 3, command, 0, 1, 0, 0, 0, 0)
        link.hears(2.1, mavlink.MAVLink_mission_item_int_message(*head, *at, 30, 0))
    link.says(2.2, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED, 0))
    link.close()
    log = OnboardLog(tmp_path, "1")
    onboard = read(log)
    log.close()
    content = PlanDrawing(Frames(ORIGIN)).content(onboard, is_guided=False)
    assert [item["number"] for item in content["items"]] == [1]
    assert [(row["what"], row["latitude"], row["longitude"]) for row in plan_rows(onboard)] == [
        ("waypoint", "40.001000", "-105.000000"),
        ("land", "-", "-"),
    ]


def test_what_is_on_board_in_words(flight: Path) -> None:
    log = OnboardLog(flight, "1")
    onboard = read(log)
    assert onboard_words(onboard) == (
        "GPS 3D FIX, 9 satellites; home 40.000000, -105.000000, 1610.0 m above mean sea level"
    )
    assert (
        plan_words(onboard) == "mission: 3 items, item 2 is current (active); fence: 4 items; rally: 1 item"
    )
    assert [(row["number"], row["what"], row["height"], row["more"]) for row in plan_rows(onboard)] == [
        ("1", "takeoff", "20.0", ""),
        ("2", "waypoint", "30.0", "current"),
        ("3", "return to launch", "-", ""),
        *((f"fence {n}", "fence polygon vertex inclusion", "-", "") for n in range(3)),
        ("fence 3", "fence circle exclusion", "-", "radius 15 m"),
        ("rally 0", "rally point", "12.0", ""),
    ]
    assert [(row["time"], row["severity"]) for row in text_rows(onboard)] == [
        ("14.50", "warning"),
        ("1.00", "info"),
    ]
    assert plan_words(Onboard()) == "; ".join(
        f"{kind}: not transferred in this run" for kind in ("mission", "fence", "rally")
    )
    log.close()


def test_a_record_is_read_as_it_grows_even_if_one_direction_comes_late(tmp_path: Path) -> None:
    link, log = Link(tmp_path), OnboardLog(tmp_path, "1")
    assert not log.read()
    link.upload(2.0, 2, [(5100, 0, -20, 5, 12)])
    link.says(3.0, home())
    link.flush(False)
    assert read(log).items("rally") is None
    assert log.at(4 * S).home == (40.0, -105.0, 1610.0)
    link.flush()
    assert len(read(log).items("rally") or ()) == 1
    link.says(9.0, home(alt_mm=1_700_000))
    link.close()
    assert read(log).home == (40.0, -105.0, 1700.0)
    assert log.at(4 * S).home == (40.0, -105.0, 1610.0)
    log.close()


async def test_only_what_is_asked_for_is_read_and_damage_is_told_once(flight: Path) -> None:
    told: list[tuple[str, str]] = []
    damaged = from_autopilot("7").path(flight)
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"no stream of this kind")
    onboards = Onboards(flight, lambda: 20 * S, lambda node, why: told.append((node, why)))
    await onboards.read_wanted()
    assert (onboards.of("1"), onboards.of("7")) == (None, None)
    await onboards.read_wanted()
    onboard = onboards.of("1")
    assert onboard is not None
    assert onboard.current == 2
    onboards.of("7")
    await onboards.read_wanted()
    assert set(onboards._logs) == {"1", "7"}
    ((node, why),) = told
    assert node == "7"
    assert "not a stream file" in why
    onboards.close()


@pytest.mark.parametrize(
    "said",
    [
        lambda ms: mavlink.MAVLink_system_time_message(0, ms),
        lambda ms: mavlink.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0),
    ],
)
def test_nothing_of_the_boot_before_is_shown_but_its_texts(tmp_path: Path, said: Any) -> None:
    run = tmp_path / "rebooted"
    link = Link(run)
    beat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
    link.says(1.0, beat, home(), text("EKF3 IMU0 is using GPS"), said(60_000))
    link.says(1.0, mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 9))
    link.upload(2.0, 0, [(16, 0, 1, 1, 0), (22, 0, 0, 0, 20)])
    link.upload(3.0, 1, [(5001, 3, 10, 0, 0), (5001, 3, 10, 20, 0), (5001, 3, 90, 0, 0)])
    link.says(4.0, said(63_000), said(61_500))  # the second is late
    link.says(5.0, beat, home(), text("ArduCopter"), said(900))
    link.says(6.0, home(), said(1_900))
    link.close()
    log = OnboardLog(run, "1")
    read(log)
    before = log.at(round(4.5 * S))
    assert (before.home is not None, len(before.items("fence") or ())) == (True, 3)
    rebooted = log.at(round(5.5 * S))
    assert (rebooted.home, rebooted.items("fence"), rebooted.items("mission")) == (None, None, None)
    assert (rebooted.gps_fix, rebooted.satellites, rebooted.current) == (-1, 0, -1)
    assert [each.text for each in rebooted.texts] == ["EKF3 IMU0 is using GPS", "ArduCopter"]
    assert log.at(6 * S).home is not None  # the same again, and said by this boot
    log.close()
