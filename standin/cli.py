"""Command line of the stand-in autopilot: ``OPTIONS [+ OPTIONS]...``, the options of one autopilot after the other."""

from __future__ import annotations

import argparse
import gc
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from standin.autopilot import Autopilot
from standin.called import CalledStandIn
from standin.control.mixer import UnknownFrameError
from standin.process import Process, StandinError
from standin.sockets import AutopilotSockets
from standin.vehicle.location import Location
from standin.vehicle.parameters import StandinParameters, UnknownParameterError

EXIT_FAILED, EXIT_ERROR = 1, 2
SEPARATOR = "+"
GC_THRESHOLD = 50_000
START_TIME_UNIX_S = 1_700_000_000
RATE_HZ_MIN, RATE_HZ_MAX = 100, 2000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the autopilots until SIGTERM or SIGINT; return the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    options = [_parser().parse_args(one) for one in _split(words)]
    try:
        served = [_prepare(one) for one in options]
    except (OSError, UnknownFrameError) as error:
        print(f"standin: {error}", file=sys.stderr)
        return EXIT_ERROR
    process = Process(served)
    process.stop_on_signals()
    for one, sockets in zip(options, served, strict=True):
        _tell(one, _ready(one, sockets))
    gc.collect()
    gc.freeze()
    gc.set_threshold(GC_THRESHOLD)  # the frames' tuples would set it off every few of them, for nothing
    try:
        process.run()
    except StandinError as error:
        failed = options[[one.name for one in served].index(error.autopilot)]
        _tell(failed, traceback.format_exc())
        print(f"{error}; its log is {failed.log}" if failed.log else error, file=sys.stderr)
        return EXIT_FAILED
    finally:
        process.close()
    return 0


def called_standins(options: Sequence[Sequence[str]]) -> list[CalledStandIn]:
    """Stand-ins to be called, from the options of each; ports and logs do not matter.

    Raises:
        UnknownFrameError: one has a frame that the stand-in cannot fly.
    """
    parsed = [_parser().parse_args(_split(words)[0]) for words in options]
    return [CalledStandIn(_autopilot(one), one.name or f"system {one.sysid}") for one in parsed]


def _split(words: Sequence[str]) -> list[list[str]]:
    """The options of each autopilot."""
    groups: list[list[str]] = [[]]
    for word in words:
        if word == SEPARATOR:
            groups.append([])
        elif groups[-1][-1:] == ["--home"]:
            groups[-1][-1] = f"--home={word}"  # argparse would take a home south of the equator for an option
        else:
            groups[-1].append(word)
    return groups


def _ready(options: argparse.Namespace, sockets: AutopilotSockets) -> str:
    return (
        f"ready: sysid {options.sysid}, MAVLink tcp:{options.host}:{sockets.mavlink_port}, "
        f"physics udp:{options.fdm_host}:{options.fdm_port}\n"
    )


def _tell(options: argparse.Namespace, text: str) -> None:
    """Write to an autopilot's own log."""
    if options.log is None:
        print(text, end="", flush=True)
    else:
        with options.log.open("a", encoding="utf-8") as log:
            log.write(text)


def _autopilot(options: argparse.Namespace) -> Autopilot:
    parameters = StandinParameters()
    for name, value in options.parameter:
        parameters.set(name, value)
    parameters.set("MAV_SYSID", options.sysid)
    return Autopilot(
        options.home,
        parameters,
        frame_rate_hz=options.rate_hz,
        boot_unix_us=options.start_time * 1_000_000,
        serials={number: baud for number, _, baud in options.serial},
    )


def _prepare(options: argparse.Namespace) -> AutopilotSockets:
    autopilot = _autopilot(options)
    physics, mavlink = (options.fdm_host, options.fdm_port), (options.host, options.mavlink_port)
    ports = {number: port for number, port, _ in options.serial}
    return AutopilotSockets(autopilot, physics, mavlink, options.name or f"system {options.sysid}", ports)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m standin",
        usage="%(prog)s OPTIONS [+ OPTIONS]...",
        description="A small multirotor autopilot with ArduPilot SITL's interfaces. It is not ArduPilot. "
        "Several fly in one process if the options of each, but the first, come after a +.",
    )
    parser.add_argument("--name", help="what messages call it (default: its system id)")
    parser.add_argument("--log", type=Path, help="file for what it has to say (default: standard output)")
    parser.add_argument("--sysid", type=_bounded_int(1, 255), default=1, help="MAVLink system id (default 1)")
    parser.add_argument("--fdm-host", default="127.0.0.1", help="host of the physics")
    parser.add_argument("--fdm-port", type=_bounded_int(1, 65535), default=9002, help="its UDP port")
    parser.add_argument("--host", default="127.0.0.1", help="address that the MAVLink server binds to")
    parser.add_argument(
        "--mavlink-port", type=_bounded_int(0, 65535), default=5760, help="its TCP port; 0 takes any free one"
    )
    parser.add_argument(
        "--serial",
        type=_serial,
        action="append",
        default=[],
        metavar="N:PORT:BAUD",
        help="a further MAVLink port: its number, TCP port and baud rate (0: no limit)",
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


def _serial(text: str) -> tuple[int, int, int]:
    words = text.split(":")
    if len(words) != 3 or not all(word.isdecimal() for word in words):
        raise argparse.ArgumentTypeError(f"{text!r} is not N:PORT:BAUD")
    number, port, baud = (int(word) for word in words)
    if port > 65535:
        raise argparse.ArgumentTypeError(f"{text!r}: port {port} is beyond 65535")
    return number, port, baud


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
        number = StandinParameters().set(name, float(value))
    except (UnknownParameterError, ValueError):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not the name of a parameter, '=' and a number"
        ) from None
    return name, number
