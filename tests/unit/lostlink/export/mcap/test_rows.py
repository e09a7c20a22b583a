"""Messages made of columns are those that the codec makes one by one; poses are what REP 103 says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bridge.bus.messages import AircraftState, Header, Quaternion, Truth, Vector3, decode
from lostlink.export.mcap.mavlink import end_of_frames
from lostlink.export.mcap.motion import _STATE_BEGIN, _STATE_END, _pose, _truth_parts
from lostlink.export.mcap.rows import Rows, doubles, floats, header, stamps
from lostlink.export.mcap.source import Thinning
from lostlink.export.mcap.values import ValueType, field_name, type_name


@pytest.mark.parametrize("frame_id", ["", "0", "12", "gcs", "gcs-1", "a-long-name"])
def test_rows_are_what_the_codec_reads(frame_id: str) -> None:
    names = [part[0] for part in _truth_parts()]
    columns = {name: np.arange(3) + i / 100 for i, name in enumerate(names)}
    times_ns = np.array([0, 1_500_000_000, 2_000_000_001])
    rows = Rows((*header(frame_id), *_truth_parts()))
    found = [decode(data, Truth) for data in rows.messages(3, **stamps(times_ns), **columns)]
    assert [each.header for each in found] == [Header.at(t, frame_id) for t in times_ns.tolist()]
    last = found[-1]
    assert last.longitude_deg == columns["longitude_deg"][-1]
    assert last.attitude == Quaternion(*(columns[f"attitude_{axis}"][-1] for axis in "xyzw"))
    assert last.wind_ned_mps.z == columns["wind_down_mps"][-1]


def test_text_between_numbers() -> None:
    numbers = {part[0]: np.array([float(i)]) for i, part in enumerate((*_STATE_BEGIN, *_STATE_END))}
    ages = (("ages", "<u4"), *floats("age_a", "age_b"))
    numbers |= {"ages": np.array([2]), "age_a": np.array([0.5]), "age_b": np.array([math.inf])}
    rows = Rows((*header("10"), *_STATE_BEGIN, "GUIDED", "A|B", *_STATE_END, *ages))
    (data,) = rows.messages(1, **stamps(np.array([50_000_000])), **numbers)
    state = decode(data, AircraftState)
    assert (state.mode, state.base_mode, state.header.frame_id) == ("GUIDED", "A|B", "10")
    assert state.euler_rad == Vector3(1.0, 2.0, 3.0)
    assert state.throttle_percent == numbers["throttle_percent"][0]
    assert state.armed
    assert tuple(state.age_s) == (0.5, math.inf)


@pytest.mark.parametrize(
    ("yaw_deg", "expected"),
    [
        (0.0, (0.0, 1.0, 0.0)),  # north is y
        (90.0, (1.0, 0.0, 0.0)),  # east is x
        (180.0, (0.0, -1.0, 0.0)),
    ],
)
def test_a_pose_looks_where_the_aircraft_does(yaw_deg: float, expected: tuple[float, ...]) -> None:
    half = math.radians(yaw_deg) / 2
    places = {"north": 1.0, "east": 2.0, "down": -3.0}
    columns = {f"position_{axis}_m": np.array([value]) for axis, value in places.items()}
    values = (math.cos(half), 0.0, 0.0, math.sin(half))
    columns |= {f"attitude_{axis}": np.array([value]) for axis, value in zip("wxyz", values, strict=True)}
    pose = {name: float(each[0]) for name, each in _pose(columns).items()}
    assert (pose["x"], pose["y"], pose["z"]) == (2.0, 1.0, 3.0)
    forward = rotated((1.0, 0.0, 0.0), pose)
    up = rotated((0.0, 0.0, 1.0), pose)
    assert forward == pytest.approx(expected, abs=1e-12)
    assert up == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)


def test_a_climbing_aircraft_looks_up() -> None:
    half = math.radians(30.0) / 2  # pitch up is about +y (right) in front-right-down
    columns = {f"position_{axis}_m": np.zeros(1) for axis in ("north", "east", "down")}
    values = (math.cos(half), 0.0, math.sin(half), 0.0)
    columns |= {f"attitude_{a}": np.array([v]) for a, v in zip("wxyz", values, strict=True)}
    pose = {name: float(each[0]) for name, each in _pose(columns).items()}
    assert rotated((1.0, 0.0, 0.0), pose) == pytest.approx((0.0, math.cos(math.pi / 6), 0.5), abs=1e-12)
    assert rotated((0.0, 1.0, 0.0), pose) == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)  # left is west


def rotated(vector: tuple[float, float, float], pose: dict[str, float]) -> tuple[float, ...]:
    """A vector of the body in the frame of the map, by the rotation matrix of the quaternion."""
    w, x, y, z = (pose[name] for name in ("qw", "qx", "qy", "qz"))
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return tuple((matrix @ np.array(vector)).tolist())


def test_the_first_of_each_period_is_written_across_calls() -> None:
    pace = Thinning(10.0)
    times_ns = np.arange(0, 1_000_000_000, 50_000_000)
    chosen = [times_ns[:3][pace.chosen(times_ns[:3])], times_ns[3:][pace.chosen(times_ns[3:])]]
    assert np.concatenate(chosen).tolist() == list(range(0, 1_000_000_000, 100_000_000))
    assert Thinning(None).chosen(times_ns).size == times_ns.size


def test_whole_frames_end_where_they_say() -> None:
    v2, v1 = b"\xfd\x02\x00" + bytes(11), b"\xfe\x03" + bytes(9)
    signed = b"\xfd\x01\x01" + bytes(23)
    assert end_of_frames(v2 + v1 + signed) == len(v2 + v1 + signed)
    for data in (v2, v1, signed):
        assert [end_of_frames(v1 + data[:n]) for n in range(len(data))] == [len(v1)] * len(data)
    assert end_of_frames(b"noise" + v2) == 5 + len(v2)


def test_names_are_what_ros_allows() -> None:
    assert [field_name(key) for key in ("a", "errorM", "a__b", "x_", "2nd", "_")] == [
        "a",
        "errorm",
        "a_b",
        "x",
        "v_2nd",
        "v",
    ]
    assert [type_name(name) for name in ("error_m", "plan-b.1", "2d")] == ["ErrorM", "PlanB1", "V2d"]
    kinds = {"a": "number", "A": "text", "header": "bool"}
    assert [f.name for f in ValueType("p/msg/T", kinds).fields] == ["a", "a2", "header2"]
    assert doubles("x") == (("x", "<f8"),)
