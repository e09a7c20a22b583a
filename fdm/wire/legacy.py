"""The legacy scheme: the datagrams of ArduPilot's SITL of 2014-15, as the paper's plugin spoke them.

For peers of one's own: current firmware no longer speaks it. Seen from the autopilot, the state comes in at UDP port
5501 + 3 I and the servo outputs go out to 5502 + 3 I, where the exchange listens. Little-endian, no padding.

    servos, 28 bytes    uint16[11] pulse widths us, 0 = no output
                        uint16[3]  wind speed m/s, direction deg, turbulence, each times 100: not used, the wind is
                                   the exchange's
    state, 148 bytes    uint64     time since the first packet, us
                        double[17] latitude deg, longitude deg, altitude m (mean sea level), heading deg,
                                   velocity north, east, down m/s, specific force x, y, z m/s^2 (FRD),
                                   turn rate x, y, z deg/s (FRD), roll, pitch, yaw deg, airspeed m/s (equivalent)
                        uint32     magic, 0x4c56414f

There is no frame count: each servo packet asks for one frame of a rate that both sides know. A repeated packet cannot
be distinguished from the next one, and a peer that boots anew goes on where the UA is.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from math import degrees

from fdm.errors import ModelDivergedError
from fdm.model.geodesy import Home, measured_place
from fdm.wire.sensor_frame import PLAUSIBLE_MAX, Encoder
from fdm.wire.servo_packet import FRAME_COUNT_MODULUS, FRAME_RATE_MIN_HZ, Fields

STATE_PORT_BASE, SERVO_PORT_BASE, PORT_STRIDE = 5501, 5502, 3
STATE_MAGIC = 0x4C56414F
_SERVOS = struct.Struct("<14H")
_STATE = struct.Struct("<Q17dI")
_CHANNELS = 11


def legacy_ports(index: int) -> tuple[int, int]:
    """UDP ports of UA `index`: where its state goes to, and where its servo outputs come to."""
    return STATE_PORT_BASE + PORT_STRIDE * index, SERVO_PORT_BASE + PORT_STRIDE * index


def make_legacy_unpacker(rate_hz: int) -> Callable[[bytes], Fields | str]:
    """What takes the servo datagrams of one peer apart, counting frames at `rate_hz` itself.

    Returns:
        A function like fdm.wire.servo_packet.unpack_servo_packet.

    Raises:
        ValueError: a rate below 10 Hz.
    """
    if not FRAME_RATE_MIN_HZ <= rate_hz <= 65535:
        raise ValueError(f"rate_hz = {rate_hz}: must be from {FRAME_RATE_MIN_HZ} to 65535")
    count = -1

    def unpack(datagram: bytes) -> Fields | str:
        nonlocal count
        if len(datagram) != _SERVOS.size:
            return "bad_length"
        count = (count + 1) % FRAME_COUNT_MODULUS
        pwm = _SERVOS.unpack(datagram)[:_CHANNELS]
        return (0, rate_hz, count, *pwm, *(0,) * (16 - _CHANNELS))

    return unpack


def make_legacy_encoder(home: Home) -> Encoder:
    """What makes the state datagram from a frame's numbers (in the order of fdm.wire.sensor_frame)."""

    def encode(values: tuple[float, ...]) -> bytes:
        if not -PLAUSIBLE_MAX < sum(values) < PLAUSIBLE_MAX:
            raise ModelDivergedError("the flight model gave " + ", ".join(f"{value:g}" for value in values))
        place = measured_place(home.position, (values[7], values[8], values[9]))
        roll, pitch, yaw = (degrees(value) for value in values[10:13])
        return _STATE.pack(
            round(values[0] * 1e6),
            *(place.lat_deg, place.lon_deg, place.alt_amsl_m, yaw % 360.0),
            *values[13:16],
            *values[4:7],
            *(degrees(value) for value in values[1:4]),
            *(roll, pitch, yaw),
            values[16],
            STATE_MAGIC,
        )

    return encode
