"""``python -m fdm``: serve autopilots that someone starts by hand."""

from __future__ import annotations

import math
import signal
import sys
from dataclasses import dataclass
from typing import Any, NoReturn, get_args

import click

from fdm.air.weather import OFFSET_MAX_K, QNH_RANGE_HPA, SEA_LEVEL_PRESSURE_HPA, WeatherConfig, in_weather
from fdm.air.wind import load_wind
from fdm.clock.events import UaEvent
from fdm.clock.status import check_speed
from fdm.errors import FdmError, PortInUseError, WorkerError
from fdm.exchange.aircraft_spec import AircraftSpec, LegacyPeer, Px4Peer, default_port, px4_port
from fdm.exchange.settings import Coupling, Placement, Workers
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.px4_sensors import Px4Sensors
from fdm.model.sensor_noise import load_sensor_noise
from fdm.wire.legacy import legacy_ports
from fdm.workers.fleet_exchange import open_exchange

EPILOG = """\b
To fly an ArduPilot on it (index 3, ports 9032 and 5790):
  python -m fdm --index 3 --airframe f450 --home 47.3977,8.5456,488,0
  arducopter --model JSON:127.0.0.1 -I3 --sysid 4 --serial0 tcp:0 \\
      --home 47.3977,8.5456,488,0 --defaults copter.parm,f450.parm
  mavproxy.py --master tcp:127.0.0.1:5790
f450.parm holds what the airframe's ardupilot_parameters say (FRAME_CLASS 1, FRAME_TYPE 1,
SIM_VIB_MOT_MASK 15).
Give --speedup 10 to ArduPilot too when running faster than real time.
\b
To fly a PX4 on it (index 3, port 4563):
  python -m fdm --px4 --index 3 --airframe f450 --home 47.3977,8.5456,488,0
  PX4_SYS_AUTOSTART=10016 px4 -i 3 -d BUILD/etc -w DIR -s etc/init.d-posix/rcS
"""


COMMANDLINE = click.core.ParameterSource.COMMANDLINE


class SpeedType(click.ParamType[float]):
    """A real-time factor, or ``max``."""

    name = "X|max"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Convert `value`."""
        if value == "max":
            return math.inf
        try:
            speed = float(value)  # type: ignore[arg-type]
            check_speed(speed)
        except (TypeError, ValueError) as error:
            self.fail(f"{value!r} is neither a real-time factor nor max: {error}", param, ctx)
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


class WorkersType(click.ParamType[Workers]):
    """A number of processes, or ``auto``."""

    name = "N|auto"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Workers:
        """Convert `value`."""
        if value == "auto":
            return "auto"
        if not str(value).isdecimal() or int(str(value)) < 1:
            self.fail(f"{value!r} is neither a number from 1 nor auto", param, ctx)
        return int(str(value))


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the command line says; see the options' help."""

    index: int
    count: int
    airframe: str
    home: Home
    speed: float
    host: str
    port: int | None
    ports: str
    px4: bool
    imu_rate: int
    legacy_rate: int
    wind: str
    temperature_offset: float
    qnh: float
    noise: str | None
    seed: int
    workers: Workers
    coupling: Coupling
    placement: Placement


def specs_of(options: Options) -> list[AircraftSpec]:
    """The UA that the options ask for.

    Raises:
        FdmError: an airframe, wind or sensor noise cannot be used.
    """
    weather = WeatherConfig(temperature_offset_k=options.temperature_offset, qnh_hpa=options.qnh)
    airframe = in_weather(load_airframe(options.airframe), weather, options.home)
    wind = load_wind(options.wind)
    noise = load_sensor_noise(options.noise) if options.noise is not None else None
    specs = []
    for ua_id in range(options.index, options.index + options.count):
        state_port, servo_port = legacy_ports(ua_id)
        legacy = LegacyPeer(state_port, options.legacy_rate) if options.ports == "legacy" else None
        px4 = Px4Peer(Px4Sensors(imu_rate_hz=options.imu_rate), options.seed) if options.px4 else None
        port = px4_port(ua_id) if px4 else servo_port if legacy else default_port(ua_id)
        specs.append(
            AircraftSpec(
                ua_id,
                airframe,
                options.home,
                port if options.port is None else options.port,
                wind.build(seed=options.seed, ua_id=ua_id),
                noise.disturb(seed=options.seed, ua_id=ua_id) if noise else None,
                legacy,
                px4,
            )
        )
    return specs


def _check_together(options: Options) -> None:
    """See that the options are numbers where they have to be, and fit each other.

    Raises:
        click.BadOptionUsage: they do not.
    """
    if options.count > 1 and options.port:
        raise click.BadOptionUsage(
            "port", "--port is for one UA; with --count it can only be 0 (any free ones)"
        )
    if options.coupling == "parallel" and (options.ports == "legacy" or options.px4):
        raise click.BadOptionUsage("coupling", "--coupling parallel is for ArduPilot, with --ports json")
    given = click.get_current_context().get_parameter_source
    for_ardupilot = {"ports": options.ports == "legacy", "legacy_rate": given("legacy_rate") is COMMANDLINE}
    for name, is_asked in for_ardupilot.items():
        if options.px4 and is_asked:
            text = f"--{name.replace('_', '-')} is for ArduPilot: PX4 has one scheme, see --imu-rate"
            raise click.BadOptionUsage(name, text)
    for name, value in (("temperature_offset", options.temperature_offset), ("qnh", options.qnh)):
        if math.isnan(value):  # which is outside no range
            raise click.BadOptionUsage(name, f"--{name.replace('_', '-')} nan: must be a number")
    if options.px4 and options.imu_rate % 50:
        raise click.BadOptionUsage("imu_rate", f"--imu-rate {options.imu_rate}: must be a multiple of 50")
    if not options.px4 and given("imu_rate") is COMMANDLINE:
        raise click.BadOptionUsage("imu_rate", "--imu-rate is for --px4: ArduPilot says its own rate")


@click.command(epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--index", type=click.IntRange(0, 5000), default=0, show_default=True, help="First UA's index I."
)
@click.option("--count", type=click.IntRange(1, 500), default=1, show_default=True, help="How many UA.")
@click.option("--airframe", default="f450", show_default=True, help="Name or YAML file of the airframe.")
@click.option("--home", type=HomeType(), required=True, help="Where the UA start, and their heading.")
@click.option("--speed", type=SpeedType(), default="1", show_default=True, help="Real-time factor.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to bind to.")
@click.option(
    "--ports",
    type=click.Choice(["json", "legacy"]),
    default="json",
    show_default=True,
    help="json: UDP 9002 + 10 I. legacy: servos to UDP 5502 + 3 I, state to 5501 + 3 I of their sender, binary.",
)
@click.option(
    "--px4",
    is_flag=True,
    help="Serve PX4 in place of ArduPilot: its simulator interface, MAVLink at TCP 4560 + I, to which PX4 connects.",
)
@click.option(
    "--imu-rate",
    type=click.IntRange(100, 1000),
    default=250,
    show_default=True,
    help="Frames per second of sim time for PX4; a multiple of 50.",
)
@click.option("--port", type=click.IntRange(0, 65535), help="Port instead of the scheme's; 0 = any free one.")
@click.option(
    "--legacy-rate",
    type=click.IntRange(10, 65535),
    default=400,
    show_default=True,
    help="Frames per second of sim time in the legacy scheme, which does not say.",
)
@click.option("--wind", default="calm", show_default=True, help="Name or YAML file of the wind.")
@click.option(
    "--temperature-offset",
    type=click.FloatRange(-OFFSET_MAX_K, OFFSET_MAX_K),
    default=0.0,
    show_default=True,
    help="How much warmer than the standard atmosphere the air is, K.",
)
@click.option(
    "--qnh",
    type=click.FloatRange(*QNH_RANGE_HPA),
    default=SEA_LEVEL_PRESSURE_HPA,
    show_default=True,
    help="Pressure at home, reduced to sea level, hPa.",
)
@click.option(
    "--noise",
    help="YAML file of sensor errors beyond those of SITL (docs/reference/fdm-weather.md); none if not given.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=1,
    show_default=True,
    help="Seed of turbulence and sensor errors.",
)
@click.option(
    "--workers",
    type=WorkersType(),
    default="auto",
    show_default=True,
    help="Processes to spread the UA over.",
)
@click.option(
    "--coupling",
    type=click.Choice(get_args(Coupling)),
    default="serial",
    show_default=True,
    help="serial: the autopilot waits while physics flies a frame. parallel: both compute at the same time, which is "
    "faster, and servo outputs take effect one frame later (--ports json only).",
)
@click.option(
    "--placement",
    type=click.Choice(get_args(Placement)),
    default="auto",
    show_default=True,
    help="With --speed max, shared: keep autopilots and physics on one core. spread: leave that to the system. auto: "
    "try both for a lone UA in serial coupling, and keep the faster one.",
)
def main(**arguments: Any) -> None:
    """Serve the flight dynamics of one UA, or of several, to autopilots started by hand (ArduPilot, PX4)."""
    options = Options(**arguments)
    _check_together(options)
    try:
        specs = specs_of(options)
        exchange = open_exchange(
            specs,
            workers=options.workers,
            coupling=options.coupling,
            placement=options.placement,
            host=options.host,
            speed=options.speed,
            on_event=_print_event,
        )
    except FdmError as error:
        hint = "; another port: --port" if isinstance(error, PortInUseError) else ""
        _fail(f"{error}{hint}")
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: exchange.stop())
    wire = "TCP" if options.px4 else "UDP"
    for spec in specs:
        click.echo(
            f"ready: UA {spec.ua_id}, {spec.airframe.name}, {wire} {options.host}:{exchange.ports[spec.ua_id]}"
        )
    sys.stdout.flush()
    try:
        exchange.run()
    except WorkerError as error:
        _fail(str(error))
    finally:
        counters = {spec.ua_id: exchange.counters(spec.ua_id) for spec in specs}
        exchange.close()
    for ua_id, counts in counters.items():
        name = f"UA {ua_id} " if options.count > 1 else ""
        click.echo(f"served: {name}{', '.join(f'{name} {count}' for name, count in sorted(counts.items()))}")


def _fail(message: str) -> NoReturn:
    click.echo(f"error: {message}", err=True)
    sys.exit(2)


def _print_event(event: UaEvent) -> None:
    click.echo(
        f"UA {event.ua_id} {event.kind.value} at {event.sim_time_ns / 1e9:.3f} s: {event.detail}", err=True
    )
    if event.kind.name == "DIVERGED":
        click.echo(f"  last frame: {event.last_frame}", err=True)


if __name__ == "__main__":
    main(prog_name="python -m fdm")
