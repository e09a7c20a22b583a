"""Parameters that PX4 said it does not have, and those that ArduPilot's log does not list."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest

from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario
from fdm.model.airframe import AIRFRAMES_DIR, load_airframe
from lostlink.flight.parameters import unknown_parameters

LOG = """\
ERROR [param] Parameter UXRCE_DDS_KEY not found.
  MPC_XY_CRUISE: curr: 5.0000 -> new: 3.0000
\x1b[31mERROR [param] Parameter COM_DL_LOSS_TT not found.\x1b[0m
ERROR [param] Parameter WPNAV_SPEED not found.
"""
"""As PX4 v1.16 writes it."""
FLEET = {"COM_DL_LOSS_TT": 5, "MPC_XY_CRUISE": 3, "WPNAV_SPEED": 300}
OF_UA_1 = "UA 1: its PX4 has no parameter "


@pytest.mark.parametrize(
    ("autopilots", "own", "expected"),
    [
        (("px4", "px4"), {}, [f"{OF_UA_1}COM_DL_LOSS_TT, WPNAV_SPEED; nothing was set"]),
        (("standin", "px4"), {}, [f"{OF_UA_1}COM_DL_LOSS_TT, WPNAV_SPEED; nothing was set"]),
        (("ardupilot", "px4"), {}, []),
        (("ardupilot", "px4"), {"COM_DL_LOSS_TT": 5}, [f"{OF_UA_1}COM_DL_LOSS_TT; nothing was set"]),
        (("ardupilot", "ardupilot"), {}, []),
    ],
)
def test_names_that_px4_does_not_have_are_told_unless_they_may_be_meant_for_ardupilot(
    tmp_path: Path, autopilots: tuple[str, str], own: dict[str, Any], expected: list[str]
) -> None:
    changes = {"parameters": FLEET, "nodes.1.parameters": own}
    changes |= {f"nodes.{number}.autopilot": name for number, name in enumerate(autopilots)}
    scenario = read_scenario("separation", changes)
    run = RunDirectory.create(tmp_path, "run")
    run.log_path("autopilot-1").parent.mkdir(exist_ok=True)
    run.log_path("autopilot-1").write_text(LOG)
    assert list(unknown_parameters(scenario, run)) == expected


OF_AIRFRAMES = [
    name for airframe in ("aerosonde", "f450") for name in load_airframe(airframe).ardupilot_parameters
]
SWITCHED_OFF = "; this version has none, or its group is switched off"


def dataflash(names: list[str], *, is_whole: bool = True) -> bytes:
    """The beginning of a log: formats, parameters, and what comes after them."""

    def described(kind: int, length: int, name: bytes, letters: bytes, columns: bytes) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, name, letters, columns)

    out = described(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    out += described(64, 35, b"PARM", b"QNff", b"TimeUS,Name,Value,Default")
    out += described(65, 11, b"VER", b"Q", b"TimeUS")
    for name in [*names, *OF_AIRFRAMES]:
        out += b"\xa3\x95\x40" + struct.pack("<Q16sff", 1_930_072, name.encode(), 1.0, 0.0)
    return out + (b"\xa3\x95\x41" + struct.pack("<Q", 1_930_072) if is_whole else b"")


def flown(tmp_path: Path, logs: dict[int, bytes]) -> RunDirectory:
    run = RunDirectory.create(tmp_path, "run")
    for number, log in logs.items():
        folder = run.path / f"autopilot-{number}/logs"
        folder.mkdir(parents=True)
        (folder / "00000001.BIN").write_bytes(log)
    return run


def lines(run: RunDirectory, own: dict[str, int], fleet: dict[str, int] | None = None) -> list[str]:
    changes = {"autopilot": "ardupilot", "parameters": fleet or {}, "nodes.1.parameters": own}
    changes |= {"nodes.0.airframe": "aerosonde"}
    return list(unknown_parameters(read_scenario("separation", changes), run))


def test_names_that_ardupilot_does_not_log_are_told(tmp_path: Path) -> None:
    """As those of another version: 4.7 has MAV_GCS_SYSID and MAV2_EXTRA1."""
    run = flown(tmp_path, {1: dataflash(["RTL_ALT", "MAV_GCS_SYSID", "A_NAME_OF_SIXTEE"])})
    own = {"SYSID_MYGCS": 255, "SR1_EXTRA1": 4, "RTL_ALT": 3000, "A_NAME_OF_SIXTEE": 1}
    told = "UA 1: its ArduPilot lists no parameter SR1_EXTRA1, SYSID_MYGCS"
    assert lines(run, own) == [told + SWITCHED_OFF]


def test_parameters_of_the_fleet_that_a_plane_alone_has_are_meant_for_planes(tmp_path: Path) -> None:
    run = flown(tmp_path, {0: dataflash(["RTL_ALTITUDE"]), 1: dataflash(["RTL_ALT"])})
    assert lines(run, {}, {"RTL_ALT": 3000, "RTL_ALTITUDE": 100}) == []
    told = f"its ArduPilot lists no parameter SYSID_MYGCS{SWITCHED_OFF}"
    assert lines(run, {}, {"RTL_ALT": 3000, "SYSID_MYGCS": 1}) == [f"UA 0: {told}", f"UA 1: {told}"]


@pytest.mark.parametrize("log", [b"", b"none of ArduPilot's", dataflash(["RTL_ALT"], is_whole=False)])
def test_a_log_without_all_parameters_says_nothing(tmp_path: Path, log: bytes) -> None:
    assert lines(flown(tmp_path, {1: log}), {"SYSID_MYGCS": 255}) == []


def test_where_there_is_no_log_nothing_is_told(tmp_path: Path) -> None:
    assert lines(flown(tmp_path, {}), {"SYSID_MYGCS": 255}) == []


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_names_that_an_airframe_has_and_its_autopilot_lacks_are_told(tmp_path: Path, autopilot: str) -> None:
    """A slip in an airframe of one's own, or another version of the autopilot: the UA would fly with its default."""
    run = flown(tmp_path, {1: dataflash(["WPNAV_SPEED"])})
    run.log_path("autopilot-1").parent.mkdir(exist_ok=True)
    run.log_path("autopilot-1").write_text(LOG)
    text = (AIRFRAMES_DIR / "f450.yaml").read_text(encoding="utf-8")
    text = text.replace("root: jsbsim", f"root: {AIRFRAMES_DIR / 'jsbsim'}")
    slips = {"ardupilot": ("FRAME_CLASS:", "FRAME_CLAS:"), "px4": ("MPC_THR_HOVER:", "WPNAV_SPEED:")}
    (tmp_path / "own.yaml").write_text(text.replace(*slips[autopilot]), encoding="utf-8")
    changes = {"autopilot": autopilot, "nodes.1.airframe": str(tmp_path / "own.yaml")}
    told = {
        "ardupilot": f"UA 1: its ArduPilot lists no parameter FRAME_CLAS{SWITCHED_OFF}",
        "px4": f"{OF_UA_1}WPNAV_SPEED; nothing was set",
    }
    assert list(unknown_parameters(read_scenario("separation", changes), run)) == [told[autopilot]]
