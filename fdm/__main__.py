"""``python -m fdm``: serve autopilots that someone starts by hand."""

from __future__ import annotations

import math
import signal
import sys

import click

from fdm.airframe import load_airframe
from fdm.errors import FdmError, PortInUseError
from fdm.events import UaEvent
from fdm.exchange import AircraftSpec, Exchange, default_port
from fdm.geodesy import GeodeticPosition, Home
from fdm.wind import load_wind

EPILOG = """\b
To fly an ArduPilot on it (index 3, ports 9032 and 5790):
  python -m fdm --index 3 --airframe f450 --home 47.3977,8.5456,488,0
  arducopter --model JSON:127.0.0.1 -I3 --sysid 4 --serial0 tcp:0 \\
      --home 47.3977,8.5456,488,0 --defaults copter.parm,f450.parm
  mavproxy.py --master tcp:127.0.0.1:5790
f450.parm holds what the airframe's ardupilot_parameters say (FRAME_CLASS 1, FRAME_TYPE 1).
Give --speedup 10 to ArduPilot too when running faster than real time.
"""


class SpeedType(click.ParamType[float]):
    """A real-time factor: a number above 0, or ``max``."""

    name = "X|max"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Convert `value`."""
        if value == "max":
            return math.inf
        try:
            speed = float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            speed = 0.0
        if not speed > 0:
            self.fail(f"{value!r} is neither a number above 0 nor max", param, ctx)
        return speed


class HomeType(click.ParamType[Home]):
    """``LAT,LON,ALT,YAW``: degrees, degrees, metres above sea level, degrees from north."""

    name = "LAT,LON,ALT,YAW"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Home:
        """Convert `value`."""
        if isinstance(value, Home):
            return value
        try:
            lat_deg, lon_deg, alt_amsl_m, yaw_deg = (float(part) for part in str(value).split(","))
            return Home(GeodeticPosition(lat_deg, lon_deg, alt_amsl_m), yaw_deg)
        except ValueError as error:
            self.fail(f"{value!r} is not LAT,LON,ALT,YAW: {error}", param, ctx)


@click.command(epilog=EPILOG)
@click.option("--index", type=click.IntRange(0, 5000), default=0, show_default=True, help="UA index I.")
@click.option("--airframe", default="f450", show_default=True, help="Name or YAML file of the airframe.")
@click.option("--home", type=HomeType(), required=True, help="Where the UA starts, and its heading.")
@click.option("--speed", type=SpeedType(), default="1", show_default=True, help="Real-time factor.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to bind to.")
@click.option("--port", type=click.IntRange(0, 65535), help="UDP port; 9002 + 10 I if not given, 0 = any.")
@click.option("--wind", default="calm", show_default=True, help="Name or YAML file of the wind.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the turbulence.")
def main(
    index: int, airframe: str, home: Home, speed: float, host: str, port: int | None, wind: str, seed: int
) -> None:
    """Serve the flight dynamics of one UA to an ArduPilot started by hand (UDP, JSON scheme)."""
    try:
        air = load_wind(wind).build(seed=seed, ua_id=index)
        number = default_port(index) if port is None else port
        spec = AircraftSpec(index, load_airframe(airframe), home, number, air)
        exchange = Exchange([spec], host=host, speed=speed, on_event=_print_event)
    except FdmError as error:
        hint = "; another port: --port" if isinstance(error, PortInUseError) else ""
        click.echo(f"error: {error}{hint}", err=True)
        sys.exit(2)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: exchange.stop())
    click.echo(f"ready: UA {index}, {spec.airframe.name}, UDP {host}:{exchange.ports[index]}")
    sys.stdout.flush()
    try:
        exchange.run()
    finally:
        counters = exchange.counters(index)
        exchange.close()
    click.echo(f"served: {', '.join(f'{name} {count}' for name, count in sorted(counters.items()))}")


def _print_event(event: UaEvent) -> None:
    click.echo(
        f"UA {event.ua_id} {event.kind.value} at {event.sim_time_ns / 1e9:.3f} s: {event.detail}", err=True
    )
    if event.kind.name == "DIVERGED":
        click.echo(f"  last frame: {event.last_frame}", err=True)


if __name__ == "__main__":
    main(prog_name="python -m fdm")
