"""Our messages: ROS 2 messages in CDR. defined in `msg/*.msg`, mirrored in `types`, coded by `codec`."""

from bridge.bus.messages.codec import DecodeError, decode, encode, encoding_of
from bridge.bus.messages.types import (
    AgentStatus,
    AircraftState,
    Clock,
    CommandEvent,
    CommandGoal,
    CommunicationStatus,
    DataPackage,
    Header,
    Link,
    Message,
    Quaternion,
    Time,
    Truth,
    Vector3,
    Waypoint,
)

__all__ = [
    "AgentStatus",
    "AircraftState",
    "Clock",
    "CommandEvent",
    "CommandGoal",
    "CommunicationStatus",
    "DataPackage",
    "DecodeError",
    "Header",
    "Link",
    "Message",
    "Quaternion",
    "Time",
    "Truth",
    "Vector3",
    "Waypoint",
    "decode",
    "encode",
    "encoding_of",
]
