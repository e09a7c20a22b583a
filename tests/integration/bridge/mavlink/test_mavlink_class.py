"""A queue that knows MAVLink, from scenario to record: what is urgent overtakes telemetry that waits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests import warm

CLASS = f"{Path(__file__).with_name('mavlink_agent.py')}:Frames"
LINK = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
ATTITUDE = mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0).pack(LINK)
PARAM = mavlink.MAVLink_param_value_message(b"RTL_ALT", 15.0, 9, 900, 3).pack(LINK)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3).pack(LINK)


def order(tmp_path: Path, slot: int, queue: dict[str, Any]) -> list[int]:
    """Numbers of the packets in the order in which they came, from the first on."""
    frames = [each.hex() for each in (ATTITUDE, ATTITUDE, PARAM, ATTITUDE, HEARTBEAT)]
    agent = {"type": "own", "class": CLASS, "options": {"at_s": 1.0, "frames": frames}}
    scenario = {
        "schema": 1,
        "name": "classes",
        "duration_s": 2.0,
        "figure": False,
        "origin": {"lat_deg": 37.0, "lon_deg": 127.0, "alt_amsl_m": 50.0},
        "fdm": {"standin_rate_hz": 100},
        "ports": {"first_slot": slot, "zenoh": 0},
        "transmit": {"every_ticks": 100_000},
        "radio": {
            "preset": "disk",
            "bit_rate_bps": 20e3,
            "medium": {"model": "airtime", "queue": queue},
        },
        "nodes": [
            {"id": 0, "agent": {"type": "still"}},
            {"id": "g1", "kind": "ground", "place": {"north_m": 50.0}, "agent": agent},
        ],
    }
    found = warm.flown(scenario, tmp_path / "run").packets
    came = found[(found.channel == "mavlink") & (found.fate == "delivered")].sort_values("arrived_ns")
    numbers: list[int] = (came.seq - came.seq.min()).tolist()
    return numbers


@pytest.mark.parametrize(("known", "expected"), [(False, [0, 1, 2, 3, 4]), (True, [0, 4, 2, 1, 3])])
def test_heartbeats_overtake_parameters_and_these_telemetry(
    tmp_path: Path, free_slot: Callable[[int], int], known: bool, expected: list[int]
) -> None:
    """The first is on the air when the others come."""
    assert order(tmp_path, free_slot(1), {"mavlink": known}) == expected
