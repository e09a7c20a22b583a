"""Command line of the stand-in autopilot."""

from __future__ import annotations

import argparse
import gc
import sys
from collections.abc import Sequence

from bridge.standin.autopilot import Autopilot
from bridge.standin.control.mixer import UnknownFrameError
from bridge.standin.process import Process
from bridge.standin.vehicle.location import Location
from bridge.standin.vehicle.parameters import Parameters, UnknownParameterError

EXIT_ERROR = 2
GC_THRESHOLD = 50_000
START_TIME_UNIX_S = 1_700_000_000
RATE_HZ_MIN, RATE_HZ_MAX = 100, 2000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the autopilot until SIGTERM or SIGINT; return the exit code."""
    options = _parser().parse_args(arguments)
    try:
        process = _prepare(options)
    except (OSError, UnknownFrameError) as error:
        print(f"standin: {error}", file=sys.stderr)
        return EXIT_ERROR
    process.stop_on_signals()
    print(
        f"ready: sysid {options.sysid}, MAVLink tcp:{options.host}:{process.mavlink_port}, "
        f"physics udp:{options.fdm_host}:{options.fdm_port}",
        flush=True,
    )
    gc.collect()
    gc.freeze()
    gc.set_threshold(GC_THRESHOLD)  # the frames' tuples would set it off every few of them, for nothing
    try:
        process.run()
    finally:
        process.close()
    return 0


def _prepare(options: argparse.Namespace) -> Process:
    parameters = Parameters()
    for name, value in options.parameter:
        parameters.set(name, value)
    parameters.set("MAV_SYSID", options.sysid)
    autopilot = Autopilot(
        options.home, parameters, frame_rate_hz=options.rate_hz, boot_unix_us=options.start_time * 1_000_000
    )
    return Process(autopilot, (options.fdm_host, options.fdm_port), (options.host, options.mavlink_port))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m bridge.standin",
        description="A small multirotor autopilot with ArduPilot SITL's interfaces. It is not ArduPilot.",
    )
    parser.add_argument("--sysid", type=_bounded_int(1, 255), default=1, help="MAVLink system id (default 1)")
    parser.add_argument("--fdm-host", default="127.0.0.1", help="host of the physics")
    parser.add_argument("--fdm-port", type=_bounded_int(1, 65535), default=9002, help="its UDP port")
    parser.add_argument("--host", default="127.0.0.1", help="address that the MAVLink server binds to")
    parser.add_argument(
        "--mavlink-port", type=_bounded_int(0, 65535), default=5760, help="its TCP port; 0 takes any free one"
    )
    parser.add_argument(
        "--home", type=_home, required=True, metavar="LAT,LON,ALT,YAW", help="degrees, m AMSL"
    )
    parser.add_argument(
        "--parameter", type=_setting, action="append", default=[], metavar="NAME=VALUE", help="one parameter"
    )
    parser.add_argument(
        "--start-time",
        type=_bounded_int(0, 2**40),
        default=START_TIME_UNIX_S,
        metavar="UNIX",
        help=f"GPS time at boot, s since 1970; never the host's (default {START_TIME_UNIX_S})",
    )
    parser.add_argument(
        "--rate-hz",
        type=_bounded_int(RATE_HZ_MIN, RATE_HZ_MAX),
        default=400,
        help="frame rate asked of the physics (default 400)",
    )
    return parser


class _bounded_int:  # noqa: N801  (argparse shows its name as the type)
    """An integer within a range."""

    def __init__(self, low: int, high: int) -> None:
        self._low, self._high = low, high

    def __call__(self, text: str) -> int:
        value = int(text)
        if not self._low <= value <= self._high:
            raise argparse.ArgumentTypeError(f"{value} is not within {self._low}..{self._high}")
        return value


def _home(text: str) -> Location:
    words = text.split(",")
    try:
        lat_deg, lon_deg, alt_m, _yaw_deg = (float(word) for word in words)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not LAT,LON,ALT,YAW") from None
    if not (-90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0 and -1e5 < alt_m < 1e5):
        raise argparse.ArgumentTypeError(f"{text!r} is not on the earth")
    return Location(lat_deg, lon_deg, alt_m)


def _setting(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        number = Parameters().set(name, float(value))
    except (UnknownParameterError, ValueError):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not the name of a parameter, '=' and a number"
        ) from None
    return name, number
