"""The other end of the legacy scheme: an autopilot of 2014-15, by the table in `fdm.wire.legacy`."""

import struct
from typing import NamedTuple

STATE = struct.Struct("<Q17dI")


def servos(pwm):
    """The datagram of 11 pulse widths."""
    return struct.pack("<14H", *pwm, 0, 0, 0)


class State(NamedTuple):
    """What it looks at of a state."""

    time_us: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


def state_of(datagram):
    """The beginning of a state datagram."""
    return State(*STATE.unpack(datagram)[:4])
