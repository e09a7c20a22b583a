"""Schemas as MCAP embeds them: a ROS 2 definition, and behind it those that it uses."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from bridge.bus.messages.definitions import definitions

ENCODING: Final = "ros2msg"
_SEPARATOR: Final = "=" * 80
_ROS: Final = {
    "rosgraph_msgs/msg/Clock": "builtin_interfaces/Time clock\n",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    "geometry_msgs/msg/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "sensor_msgs/msg/NavSatStatus": "int8 status\nuint16 service\n",
    "sensor_msgs/msg/NavSatFix": (
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n"
        "float64 altitude\nfloat64[9] position_covariance\nuint8 position_covariance_type\n"
    ),
    "rcl_interfaces/msg/Log": (
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\n"
        "string file\nstring function\nuint32 line\n"
    ),
}
"""Definitions of ROS 2 itself (Jazzy) that viewers know."""
_USED: Final = re.compile(r"^\s*([a-z]\w*/[A-Z]\w*)", re.MULTILINE)


class Schemas:
    """Texts of schemas by type name."""

    def __init__(self) -> None:
        self._texts: dict[str, str] = definitions() | _ROS

    def add(self, texts: Mapping[str, str]) -> None:
        """Take definitions that only this run has."""
        self._texts |= texts

    def schema_of(self, name: str) -> bytes:
        """The definition of ``name`` with all that it uses, as ``ros2msg`` wants it.

        Raises:
            KeyError: there is no such type.
        """
        used: dict[str, None] = {}
        self._collect(name, used)
        parts = [self._texts[name]]
        for other in used:
            parts += [f"{_SEPARATOR}\nMSG: {other.replace('/msg/', '/')}\n{self._texts[other]}"]
        return "".join(parts).encode()

    def _collect(self, name: str, used: dict[str, None]) -> None:
        for found in _USED.findall(self._texts[name]):
            other = found.replace("/", "/msg/")
            if other not in used:
                used[other] = None
                self._collect(other, used)
