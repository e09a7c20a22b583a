"""Take-offs with noisy sensors: the stand-in's core on JSBSim, without sockets or a clock."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel
from fdm.model.sensor_noise import SensorNoise
from fdm.wire.sensor_frame import make_encoder
from fdm.wire.servo_packet import unpack_servo_packet
from standin.autopilot import Autopilot
from standin.vehicle.location import Location
from standin.vehicle.parameters import StandinParameters
from standin.wire.sensors import parse_sensor_frame

RATE_HZ = 400
COMMANDS = {4: [(176, 1.0, 4.0), (400, 1.0)], 5: [(22, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0)]}
"""By the second: GUIDED, arm, take off to 5 m."""


def heights_of_a_takeoff(seed: int) -> list[float]:
    """Return the true heights, m, of 25 s with 0.3 m of noise on the position and 0.1 m/s on the velocity."""
    airframe = load_airframe("f450")
    model = JsbsimModel(airframe, Home(GeodeticPosition(45.0, 10.0, 100.0), 120.0))
    noise = SensorNoise(position_sigma_m=0.3, velocity_sigma_mps=0.1)
    sense, encode = noise.disturb(seed=seed, ua_id=0)(model.sense), make_encoder(airframe.sensors)
    core = Autopilot(Location(45.0, 10.0, 100.0), StandinParameters(), frame_rate_hz=RATE_HZ, boot_unix_us=0)
    client = dialect.MAVLink(None, 255, 190)
    heights_m = []
    for frame in range(1, 25 * RATE_HZ):
        fields = unpack_servo_packet(core.fdm.packet)
        assert not isinstance(fields, str)
        model.step(fields, RATE_HZ)
        if frame % RATE_HZ == 0:
            for number, *given in COMMANDS.get(frame // RATE_HZ, ()):
                parameters = [*given, *[0.0] * (7 - len(given))]
                request = dialect.MAVLink_command_long_message(1, 1, number, 0, *parameters)
                core.mavlink.receive(request.pack(client))
        assert core.take_frame(parse_sensor_frame(encode((frame / RATE_HZ, *sense()))))
        core.step()
        heights_m.append(-model.truth(0, 0).position_ned_m[2])
    return heights_m


@pytest.mark.parametrize(
    "seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (6, 11, 24))]
)
def test_noise_is_no_lift_off_and_hides_none(seed: int) -> None:
    heights_m = heights_of_a_takeoff(seed)
    # Home's height is one noisy sample, and so is where 5 m above it is.
    assert max(heights_m) < 6.2
    assert all(4.0 < height_m < 6.2 for height_m in heights_m[-5 * RATE_HZ :])
