"""``python -m aps``: the daemon of one UA from the command line."""

from __future__ import annotations

import argparse
import asyncio
import errno
import json
import logging
import math
import signal
import sys
from dataclasses import asdict
from typing import Any

from aps.daemon import Daemon, DaemonConfig
from aps.links.address import parse_autopilot, parse_host_port
from aps.vehicle.telemetry import AircraftState

EXAMPLES = """\
examples:
  python -m aps --autopilot tcp:127.0.0.1:5760 --sysid 1 --listen 127.0.0.1:6760
  python -m aps --index 1                    # the same for UA 1: sysid 2, ports 5770 and 6770
  python -m aps --json --rate-hz 5 | jq .alt_rel_m
then, for one:
  mavproxy.py --master tcp:127.0.0.1:6760
  QGroundControl: Application Settings, Comm Links, TCP, 127.0.0.1 port 6760
"""
AUTOPILOT_PORT = 5760
LISTEN_PORT = 6760
PORT_STRIDE = 10


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m aps",
        description="MAVLink daemon of one UA: connects to its autopilot, owns the stream rates, "
        "and serves any number of MAVLink clients over TCP.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--index", type=int, default=0, metavar="I", help="UA index: sets the defaults below (0)"
    )
    parser.add_argument("--autopilot", metavar="tcp:HOST:PORT", help="autopilot (tcp:127.0.0.1:5760 + 10 I)")
    parser.add_argument("--sysid", type=int, metavar="N", help="system id of the UA (I + 1)")
    parser.add_argument(
        "--listen",
        metavar="HOST:PORT",
        help="where clients connect (127.0.0.1:6760 + 10 I); port 0: any free one",
    )
    parser.add_argument("--json", action="store_true", help="print the state as JSON lines on stdout")
    parser.add_argument(
        "--rate-hz", type=float, default=1.0, metavar="R", help="rate of --json, in the autopilot's time (1)"
    )
    parser.add_argument("--quiet", action="store_true", help="log warnings only")
    return parser


def _config(arguments: argparse.Namespace) -> DaemonConfig:
    index = arguments.index
    if not 0 <= index <= 254:
        raise ValueError(f"--index must be in 0..254, not {index}")
    if not arguments.rate_hz > 0.0:
        raise ValueError(f"--rate-hz must be positive, not {arguments.rate_hz}")
    listen = arguments.listen or f"127.0.0.1:{LISTEN_PORT + PORT_STRIDE * index}"
    host, port = parse_host_port(listen, lowest_port=0)
    sysid = arguments.sysid if arguments.sysid is not None else index + 1
    if not 1 <= sysid <= 255:
        raise ValueError(f"--sysid must be in 1..255, not {sysid}")
    autopilot = arguments.autopilot or f"tcp:127.0.0.1:{AUTOPILOT_PORT + PORT_STRIDE * index}"
    parse_autopilot(autopilot)
    return DaemonConfig(autopilot=autopilot, sysid=sysid, listen_host=host, listen_port=port)


def state_line(state: AircraftState) -> str:
    """The state as one line of JSON; what is not known is null."""
    values = asdict(state) | {"wind_body_mps": state.wind_body_mps}
    return json.dumps({"event": "state", **{name: _jsonable(value) for name, value in values.items()}})


def _jsonable(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_jsonable(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


async def _serve(config: DaemonConfig, *, as_json: bool, rate_hz: float) -> BaseException | None:
    """Serve until a signal; returns what the daemon failed of, if it did."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    async with Daemon(config) as daemon:
        daemon.on_failure = lambda _: stop.set()
        listen = f"{config.listen_host}:{daemon.listen_port}"
        if as_json:
            ready = {"event": "ready", "sysid": config.sysid, "listen": listen, "autopilot": config.autopilot}
            print(json.dumps(ready), flush=True)
            daemon.subscribe(lambda state: print(state_line(state), flush=True), rate_hz)
        else:
            print(f"READY aps sysid={config.sysid} listen={listen} autopilot={config.autopilot}", flush=True)
        await stop.wait()
        return daemon.failure


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM or SIGINT; returns the exit status."""
    arguments = _arguments().parse_args(argv)
    logging.basicConfig(
        level=logging.WARNING if arguments.quiet else logging.INFO,
        format="%(asctime)s %(name)s: %(message)s",
        stream=sys.stderr,
    )
    try:
        config = _config(arguments)
    except ValueError as error:
        print(f"aps: {error}", file=sys.stderr)
        return 2
    try:
        failure = asyncio.run(_serve(config, as_json=arguments.json, rate_hz=arguments.rate_hz))
    except BrokenPipeError:
        return 0
    except OSError as error:
        print(f"aps: {_explain(error, config)}", file=sys.stderr)
        return 2
    if failure is not None:
        print(f"aps: the daemon failed: {failure}", file=sys.stderr)
    return 0 if failure is None else 1


def _explain(error: OSError, config: DaemonConfig) -> str:
    where = f"{config.listen_host}:{config.listen_port}"
    if error.errno == errno.EADDRINUSE:
        return f"port {config.listen_port} is in use on {config.listen_host}: choose another with --listen HOST:PORT"
    return f"cannot listen on {where}: {error.strerror or error} (see --listen)"


if __name__ == "__main__":
    sys.exit(main())
