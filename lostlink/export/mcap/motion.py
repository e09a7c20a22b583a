"""From the tables of truth and states: where everybody is, as our messages and as viewers know it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import AircraftState, Truth
from bridge.record.tables.schema import FRD, NED, Columns
from bridge.record.tables.states import AGES, STATES
from bridge.record.tables.truth import ATTITUDE, NUMBERS, TRUTH
from lostlink.export.mcap.file import Channel, McapFile
from lostlink.export.mcap.rounding import rounded
from lostlink.export.mcap.rows import Part, Rows, doubles, floats, header, stamps
from lostlink.export.mcap.source import Item, Slices, Thinning, picked, rows_of_nodes
from lostlink.export.mcap.topics import MAP

_ROOT_HALF: Final = np.sqrt(0.5)


class _Topic(NamedTuple):
    channel: Channel
    pace: Thinning
    rows: Rows
    columns: Callable[[Columns], Columns]


class TruthSource:
    """Truth, pose, fix and frames of all nodes, and the clock.

    Args:
        run: the run directory.
        file: where to.
        prefixes: of topics and frames, by node.
    """

    def __init__(self, run: Path, file: McapFile, prefixes: dict[str, str]) -> None:
        self._file, self._prefixes = file, prefixes
        self._nodes = tuple(prefixes)
        self._slices = Slices(run, TRUTH, {"node": self._nodes})
        self._topics: dict[str, list[_Topic]] = {}
        self._clock = self._clock_topic()

    def until(self, time_ns: int) -> Iterator[Item]:
        """The messages up to ``time_ns``."""
        columns = self._slices.until(time_ns)
        if columns is None:
            return
        yield from self._clock_items(np.unique(columns["tick_ns"]))
        columns = {name: rounded(name, values) for name, values in columns.items()}
        for node, rows in rows_of_nodes(columns, self._nodes):
            if node not in self._topics:
                self._topics[node] = list(self._topics_of(node))
            for topic in self._topics[node]:
                chosen = picked(rows, topic.pace.chosen(rows["tick_ns"]))
                values = stamps(chosen["sim_time_ns"]) | topic.columns(chosen)
                yield from _items(chosen["tick_ns"], topic.channel, topic.rows, values)

    def _clock_topic(self) -> _Topic | None:
        if not self._file.settings.has("clock"):
            return None
        channel = self._file.channel("/clock", "rosgraph_msgs/msg/Clock", "clock")
        return _Topic(channel, Thinning(None), Rows([("sec", "<i4"), ("nanosec", "<u4")]), dict)

    def _clock_items(self, ticks_ns: NDArray[np.int64]) -> Iterator[Item]:
        if self._clock is not None:
            yield from _items(ticks_ns, self._clock.channel, self._clock.rows, stamps(ticks_ns))

    def _topics_of(self, node: str) -> Iterator[_Topic]:
        name, settings = self._prefixes[node], self._file.settings
        shapes: tuple[tuple[str, str, str, Sequence[Part], Callable[[Columns], Columns]], ...] = (
            ("truth", f"/{name}/truth", Truth.TYPE, (*header(node), *_truth_parts()), _as_it_is),
            ("pose", f"/{name}/pose", "geometry_msgs/msg/PoseStamped", (*header(MAP), *_POSE), _pose),
            ("fix", f"/{name}/fix", "sensor_msgs/msg/NavSatFix", (*header(name), *_FIX), _fix),
            ("tf", "/tf", "tf2_msgs/msg/TFMessage", (("count", "<u4"), *header(MAP), name, *_POSE), _frame),
        )
        for kind, topic, type_name, parts, columns in shapes:
            if settings.has(kind):
                channel = self._file.channel(topic, type_name, kind)
                yield _Topic(channel, Thinning(settings.rate_hz(kind)), Rows(parts), columns)


_POSE: Final = (*doubles("x", "y", "z"), *doubles("qx", "qy", "qz", "qw"))
_FIX: Final = (
    ("status", "<i1"),
    ("service", "<u2"),
    *doubles("latitude", "longitude", "altitude"),
    ("covariance", "9<f8"),
    ("covariance_type", "<u1"),
)


def _truth_parts() -> tuple[Part, ...]:
    """As in Truth.msg: the table's order, but the quaternion has w last."""
    names = list(NUMBERS)
    begin = names.index(ATTITUDE[0])
    names[begin : begin + 4] = [*ATTITUDE[1:], ATTITUDE[0]]
    return doubles(*names)


def _as_it_is(columns: Columns) -> Columns:
    return {name: columns[name] for name in NUMBERS}


def _pose(columns: Columns) -> Columns:
    """East, north, up; body forward, left, up: what REP 103 asks for."""
    w, x, y, z = (columns[name] for name in ATTITUDE)
    r = _ROOT_HALF
    return {
        "x": columns["position_east_m"],
        "y": columns["position_north_m"],
        "z": -columns["position_down_m"],
        "qw": r * (w + z),
        "qx": r * (x + y),
        "qy": r * (x - y),
        "qz": r * (w - z),
    }


def _frame(columns: Columns) -> Columns:
    return {"count": np.ones(len(columns["tick_ns"]), dtype=np.uint32), **_pose(columns)}


def _fix(columns: Columns) -> Columns:
    """Height above mean sea level, where the message wants the ellipsoid: the flight dynamics know no other."""
    names = {"latitude": "latitude_deg", "longitude": "longitude_deg", "altitude": "altitude_amsl_m"}
    return {name: columns[column] for name, column in names.items()}


def _items(times_ns: NDArray[np.int64], channel: Channel, rows: Rows, values: Columns) -> Iterator[Item]:
    for time_ns, data in zip(times_ns.tolist(), rows.messages(len(times_ns), **values), strict=True):
        yield time_ns, channel, data


class StateSource:
    """Table I of all nodes. Arguments as of `TruthSource`."""

    def __init__(self, run: Path, file: McapFile, prefixes: dict[str, str]) -> None:
        self._file, self._prefixes = file, prefixes
        self._nodes = tuple(prefixes)
        self._slices = Slices(run, STATES, {"node": self._nodes})
        self._paces: dict[str, Thinning] = {}
        self._rows: dict[tuple[str, str, str, bool], Rows] = {}

    def until(self, time_ns: int) -> Iterator[Item]:
        """The messages up to ``time_ns``."""
        columns = self._slices.until(time_ns)
        if columns is None:
            return
        columns = {name: rounded(name, values) for name, values in columns.items()}
        for node, rows in rows_of_nodes(columns, self._nodes):
            channel = self._file.channel(f"/{self._prefixes[node]}/state", AircraftState.TYPE, "state")
            pace = self._paces.setdefault(node, Thinning(self._file.settings.rate_hz("state")))
            chosen = picked(rows, pace.chosen(rows["tick_ns"]))
            modes = chosen["mode"].astype(str)
            base_modes = chosen["base_mode"].astype(str)
            for mode, base_mode in sorted(set(zip(modes.tolist(), base_modes.tolist(), strict=True))):
                same = picked(chosen, np.flatnonzero((modes == mode) & (base_modes == base_mode)))
                shape = self._shape(node, mode, base_mode, has_ages=not np.isnan(same[_AGES[0]]).all())
                yield from _items(same["tick_ns"], channel, shape, _state(same))

    def _shape(self, node: str, mode: str, base_mode: str, *, has_ages: bool) -> Rows:
        key = (node, mode, base_mode, has_ages)
        if key not in self._rows:
            ages = floats(*_AGES) if has_ages else ()
            self._rows[key] = Rows(
                (*header(node), *_STATE_BEGIN, mode, base_mode, *_STATE_END, ("ages", "<u4"), *ages)
            )
        return self._rows[key]


_AGES: Final = tuple(f"age_{name}_s" for name in AGES)
_SPEEDS: Final = ("indicated_airspeed_mps", "groundspeed_mps", "airspeed_mps")
_BATTERY: Final = ("heartbeat_age_s", "flight_time_s", "voltage_v", "current_a")
_STATE_BEGIN: Final = (
    ("mav_id", "<u4"),
    *doubles("roll_rad", "pitch_rad", "yaw_rad"),
    *doubles("longitude_deg", "latitude_deg", "altitude_amsl_m", "altitude_rel_m"),
    *doubles(*(f"position_{axis}_m" for axis in NED), *(f"velocity_{axis}_mps" for axis in NED)),
    *floats(*_SPEEDS),
)
_STATE_END: Final = (
    *floats(*_BATTERY),
    *doubles(*(f"wind_{axis}_mps" for axis in FRD)),
    *floats("throttle_percent"),
    ("armed", "|b1"),
    ("ready_to_arm", "|b1"),
)


def _state(columns: Columns) -> Columns:
    """The columns of a message; a node without an autopilot has no ages."""
    names = [part[0] for part in (*_STATE_BEGIN, *_STATE_END)]
    found = stamps(columns["tick_ns"]) | {name: columns[name] for name in names}
    if np.isnan(columns[_AGES[0]]).all():
        return found | {"ages": np.zeros(len(columns["tick_ns"]), dtype=np.uint32)}
    ages = np.full(len(columns["tick_ns"]), len(_AGES), dtype=np.uint32)
    return found | {"ages": ages} | {name: columns[name] for name in _AGES}
