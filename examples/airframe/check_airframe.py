"""See what each servo channel of an airframe does, before an autopilot does.

Run: ``python examples/airframe/check_airframe.py examples/airframe/mini.yaml 1450``. It holds all channels at that
pulse width for half a second (take one at which a multirotor climbs), then moves one after the other up by 50 us for a
tenth of a second, and prints which way the UA turns and accelerates: roll right, pitch up, yaw right and forward are
positive.
"""

import sys
from typing import Any

from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel

HOME = Home(GeodeticPosition(47.0, 8.0, 0.0), 0.0)
RATE_HZ = 400


def packet(widths: dict[int, float]) -> tuple[Any, ...]:
    """Fields of a servo packet with these pulse widths, us."""
    return (18458, RATE_HZ, 0, *(widths.get(channel, 0) for channel in range(1, 17)))


def fly(model: JsbsimModel, widths: dict[int, float], seconds: float) -> tuple[float, ...]:
    """Go on for a while; gives the numbers of the last frame (fdm.wire.sensor_frame)."""
    for _ in range(round(seconds * RATE_HZ)):
        model.step(packet(widths), RATE_HZ)
    return model.sense()


def main() -> None:
    """Print the table."""
    name, width_us = sys.argv[1], float(sys.argv[2])
    channels = {channel.channel for channel in load_airframe(name).channels}
    still = dict.fromkeys(channels, width_us)
    print(f"all at {width_us:.0f} us; turn rates in deg/s, acceleration in m/s^2, after 0.1 s at 50 us more")
    print("channel   roll  pitch    yaw  forward     up")
    for channel in sorted(channels):
        model = JsbsimModel(load_airframe(name), HOME)
        before = fly(model, still, 0.5)
        after = fly(model, still | {channel: still[channel] + 50.0}, 0.1)
        p, q, r = (57.3 * (b - a) for a, b in zip(before[0:3], after[0:3], strict=True))
        forward, up = after[3] - before[3], before[5] - after[5]
        print(f"{channel:7d} {p:6.1f} {q:6.1f} {r:6.1f} {forward:8.2f} {up:6.2f}")


if __name__ == "__main__":
    main()
