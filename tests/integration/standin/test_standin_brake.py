"""BRAKE beside ArduCopter: the stand-in's core on JSBSim's F450, without sockets or a clock."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel
from fdm.wire.sensor_frame import make_encoder
from fdm.wire.servo_packet import unpack_servo_packet
from standin.autopilot import Autopilot
from standin.vehicle.location import Location
from standin.vehicle.parameters import StandinParameters
from standin.wire.sensors import parse_sensor_frame

RATE_HZ = 400
BRAKED_AT_S, WATCHED_S = 27, 9
GUIDED, BRAKE = 4.0, 17.0
REAL_M = {
    10.0: {1: 9.18, 2: 14.38, 3: 16.90, 4: 18.23, 5: 18.96, 9: 19.65},
    5.0: {1: 4.25, 2: 6.34, 3: 7.38, 4: 7.96, 5: 8.29, 9: 8.58},
}
"""Speed, m/s -> how far real ArduCopter (4.7-dev) flew the F450 in BRAKE, m, by the second: in still air, counted from
the tick after the command, when its heartbeat was heard."""
HEARD_FRAMES = RATE_HZ // 20


def command(number: int, *parameters: float) -> Any:
    padded = [*parameters, *[0.0] * (7 - len(parameters))]
    return dialect.MAVLink_command_long_message(1, 1, number, 0, *padded)


def northwards(speed_mps: float) -> Any:
    rest = (speed_mps, *[0.0] * 7)
    return dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0x0DC7, 0, 0, 0, *rest)


def braking_way_m(speed_mps: float) -> dict[int, float]:
    """Return how far it flies from BRAKE on, m, by the second."""
    airframe = load_airframe("f450")
    model = JsbsimModel(airframe, Home(GeodeticPosition(45.0, 10.0, 100.0), 0.0))
    encode = make_encoder(airframe.sensors)
    core = Autopilot(Location(45.0, 10.0, 100.0), StandinParameters(), frame_rate_hz=RATE_HZ, boot_unix_us=0)
    client = dialect.MAVLink(None, 255, 190)
    script = {second: [northwards(speed_mps)] for second in range(15, BRAKED_AT_S)}
    script |= {4: [command(176, 1.0, GUIDED), command(400, 1.0)], 5: [command(22, *[0.0] * 6, 10.0)]}
    script |= {BRAKED_AT_S: [command(176, 1.0, BRAKE)]}
    north_m = []
    for frame in range(1, (BRAKED_AT_S + WATCHED_S + 1) * RATE_HZ):
        fields = unpack_servo_packet(core.fdm.packet)
        assert not isinstance(fields, str)
        model.step(fields, RATE_HZ)
        if frame % RATE_HZ == 0:
            for message in script.get(frame // RATE_HZ, ()):
                core.mavlink.receive(message.pack(client))
        assert core.take_frame(parse_sensor_frame(encode((frame / RATE_HZ, *model.sense()))))
        core.step()
        north_m.append(model.truth(0, 0).position_ned_m[0])
    heard = BRAKED_AT_S * RATE_HZ + HEARD_FRAMES
    return {second: north_m[heard + second * RATE_HZ] - north_m[heard] for second in REAL_M[speed_mps]}


@pytest.mark.slow
@pytest.mark.parametrize("speed_mps", REAL_M)
def test_it_brakes_as_arducopter(speed_mps: float) -> None:
    assert braking_way_m(speed_mps) == pytest.approx(REAL_M[speed_mps], abs=0.3)
