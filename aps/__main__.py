"""``python -m aps``, ``lostlink aps``: the daemons of one or several UA from the command line."""

from __future__ import annotations

import argparse
import asyncio
import errno
import gc
import json
import logging
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path

from aps.api.guard import TOKEN_VARIABLE, ApiConfig
from aps.config import DaemonConfig
from aps.daemon import Daemon
from aps.logs.printable import PrintableForm, printable
from aps.logs.repeats import Repeats
from aps.settings import LINK_KINDS, DaemonSettings, SettingsError, read_settings
from aps.status import plain_state
from aps.vehicle.telemetry import VehicleState

EXAMPLES = """\
examples:
  python -m aps --autopilot tcp:127.0.0.1:5760 --sysid 1 --listen 127.0.0.1:6760
  python -m aps --index 1                    # the same for UA 1: sysid 2, ports 5770 and 6770
  python -m aps --autopilot serial:/dev/ttyACM0:115200 --udp-out 127.0.0.1:14550 --tlog logs
  python -m aps --udp-out 192.168.1.7:14550,max-hz=*:2    # thinned for a slow way
  python -m aps --config daemons.yaml        # several daemons in one process
  python -m aps status                       # a live table of the running daemons and their links
  python -m aps --json --rate-hz 5 | jq .alt_rel_m
then, for one:
  mavproxy.py --master tcp:127.0.0.1:6760
  QGroundControl: Application Settings, Comm Links, TCP, 127.0.0.1 port 6760 (with --udp-out ...:14550: nothing)
"""
_log = logging.getLogger("aps")

STATISTICS_PERIOD_S = 60.0
LONGEST_PERIOD_S = 86_400.0
"""Between two looks of ``status``."""
API_STEP = 10
_HELP = {
    "tcp_server": "serve MAVLink clients there, too (127.0.0.1:6760 + 10 I); :PORT is on loopback, port 0 any free one",
    "tcp": "connect to a ground station's TCP server",
    "udp_out": "send to a ground station's UDP port, and hear what comes back",
    "udp_in": "wait for ground stations on a UDP port",
    "serial": "a serial line to a ground station, DEVICE:BAUD",
}


def _arguments(prog: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=prog,
        description="MAVLink daemon of one UA: connects to its autopilot, owns the stream rates, "
        "and serves any number of MAVLink clients.",
        epilog=EXAMPLES.replace("python -m aps", prog),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--index", type=int, default=0, metavar="I", help="UA index: sets the defaults below (0)"
    )
    parser.add_argument(
        "--autopilot",
        action="append",
        metavar="LINK",
        help="way to the autopilot: tcp:HOST:PORT, udp-in:HOST:PORT, udp-out:HOST:PORT or serial:DEVICE:BAUD "
        "(tcp:127.0.0.1:5760 + 10 I); repeated: further ways to the same one",
    )
    parser.add_argument("--sysid", type=int, metavar="N", help="system id of the UA (I + 1)")
    for kind in LINK_KINDS:
        names = [f"--{kind.replace('_', '-')}", *(["--listen"] if kind == "tcp_server" else [])]
        place = "DEVICE:BAUD" if kind == "serial" else "HOST:PORT"
        parser.add_argument(
            *names, dest=kind, action="append", metavar=place, help=f"{_HELP[kind]}; repeatable"
        )
    parser.add_argument("--tlog", type=Path, metavar="DIR", help="record every frame in .tlog files there")
    parser.add_argument(
        "--api",
        metavar="HOST:PORT",
        help="serve the HTTP API there (127.0.0.1:8760, say; further daemons 10 higher each); beyond loopback with the "
        f"token in the environment variable {TOKEN_VARIABLE}",
    )
    parser.add_argument("--config", type=Path, metavar="FILE", help="daemons from a YAML file instead")
    parser.add_argument("--json", action="store_true", help="print the state as JSON lines on stdout")
    parser.add_argument(
        "--rate-hz", type=float, default=1.0, metavar="R", help="rate of --json, in the autopilot's time (1)"
    )
    parser.add_argument("--quiet", action="store_true", help="log warnings only")
    return parser


def _configs(arguments: argparse.Namespace) -> list[DaemonConfig]:
    if not arguments.rate_hz > 0.0:
        raise ValueError(f"--rate-hz must be positive, not {arguments.rate_hz}")
    if arguments.config is not None:
        try:
            return [daemon.config() for daemon in read_settings(arguments.config).daemons]
        except SettingsError:
            raise
        except ValueError as error:
            raise SettingsError(f"{arguments.config}: {error}") from error
    if not 0 <= arguments.index <= 254:
        raise ValueError(f"--index must be in 0..254, not {arguments.index}")
    if arguments.sysid is not None and not 1 <= arguments.sysid <= 255:
        raise ValueError(f"--sysid must be in 1..255, not {arguments.sysid}")
    given = {kind: tuple(getattr(arguments, kind) or ()) for kind in (*LINK_KINDS, "autopilot")}
    settings = DaemonSettings(index=arguments.index, sysid=arguments.sysid, tlog=arguments.tlog, **given)
    return [settings.config()]


def state_line(state: VehicleState) -> str:
    """The state as one line of JSON; what is not known is null."""
    return json.dumps({"event": "state", **plain_state(state)})


def _ready(daemon: Daemon, *, as_json: bool) -> str:
    config = daemon.config
    listen = f"{config.listen_host}:{daemon.listen_port}"
    if as_json:
        ready = {"event": "ready", "sysid": config.sysid, "listen": listen, "autopilot": config.autopilot}
        return json.dumps(ready | {"more_autopilots": list(config.more_autopilots)})
    autopilots = " ".join(f"autopilot={each}" for each in (config.autopilot, *config.more_autopilots))
    return f"READY aps sysid={config.sysid} listen={listen} {autopilots}"


def _api_config(text: str | None) -> ApiConfig | None:
    if text is None:
        return None
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or not 0 <= int(port) <= 65_535:
        raise ValueError(f"--api must be HOST:PORT, not {text!r}")
    token = os.environ.get(TOKEN_VARIABLE, "")
    return ApiConfig(host=host.strip("[]") or "127.0.0.1", port=int(port), token=token)


async def _serve_api(
    daemons: Sequence[Daemon],
    first: ApiConfig,
    stack: AsyncExitStack,
    on_failure: Callable[[BaseException], None],
) -> list[str]:
    """Serve each daemon's API; returns where."""
    from aps.api.backend import DaemonBackend  # FastAPI takes its time, and most daemons do without
    from aps.api.server import ApiServer

    host, places = first.host, []
    for number, daemon in enumerate(daemons):
        config = replace(first, port=first.port + API_STEP * number if first.port else 0)
        server = await stack.enter_async_context(ApiServer(DaemonBackend(daemon), config, on_failure))
        shown = f"[{host}]" if ":" in host else host
        places.append(f"http://{shown}:{server.port}/")
    return places


async def _serve(
    configs: Sequence[DaemonConfig], *, as_json: bool, rate_hz: float, api: ApiConfig | None = None
) -> BaseException | None:
    """Serve until a signal; returns what a daemon or its API failed of, if one did."""
    stop = asyncio.Event()
    failures: list[BaseException] = []

    def failed(error: BaseException) -> None:
        failures.append(error)
        stop.set()

    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    async with AsyncExitStack() as stack:
        daemons = [await stack.enter_async_context(Daemon(config)) for config in configs]
        places = [] if api is None else await _serve_api(daemons, api, stack, failed)
        for daemon in daemons:
            daemon.on_failure = failed
            print(_ready(daemon, as_json=as_json), flush=True)
            if as_json:
                _print_states(daemon, rate_hz)
        for daemon, place in zip(daemons, places, strict=False):
            told = {"event": "api", "sysid": daemon.config.sysid, "url": place}
            print(json.dumps(told) if as_json else f"API aps sysid={daemon.config.sysid} {place}", flush=True)
        gc.collect()
        gc.freeze()  # what is there now stays: to look through it again and again would take 10 to 30 ms each time
        while not stop.is_set():
            try:
                async with asyncio.timeout(STATISTICS_PERIOD_S):
                    await stop.wait()
            except TimeoutError:
                _log_statistics(daemons)
        _log_statistics(daemons)
        return next(iter(failures), None)


def _print_states(daemon: Daemon, rate_hz: float) -> None:
    """Print the state of a daemon for as long as somebody reads; it serves its clients longer."""

    def tell(state: VehicleState) -> None:
        try:
            print(state_line(state), flush=True)
        except OSError as error:
            subscription.cancel()
            _reader_is_gone()
            _log.warning("the state is printed no more (%s); links are served on", error)

    subscription = daemon.subscribe(tell, rate_hz)


def _log_statistics(daemons: Sequence[Daemon]) -> None:
    """What happened on the links, one line per daemon."""
    for daemon in daemons:
        told = daemon.statistics()
        totals = {name: count for name, count in told["client_totals"].items() if count}
        up = [link["peer"] for link in told["autopilot_links"] if link["up"]]
        _log.info(
            "system %d: autopilot %s, %d clients, %s",
            daemon.config.sysid,
            f"on {', '.join(up)}" if up else "not heard",
            len(told["clients"]),
            ", ".join(f"{name} {count}" for name, count in totals.items()) or "nothing from or to them yet",
        )


def main(argv: list[str] | None = None, prog: str = "python -m aps") -> int:
    """Run until SIGTERM or SIGINT; returns the exit status."""
    given = sys.argv[1:] if argv is None else argv
    if given[:1] == ["status"]:
        return _status(given[1:], prog)
    arguments = _arguments(prog).parse_args(given)
    handler = Repeats(logging.StreamHandler(sys.stderr), "aps", "uvicorn")
    handler.setFormatter(PrintableForm("%(asctime)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.WARNING if arguments.quiet else logging.INFO, handlers=[handler])
    try:
        configs = _configs(arguments)
        api = _api_config(arguments.api)
        failure = asyncio.run(_serve(configs, as_json=arguments.json, rate_hz=arguments.rate_hz, api=api))
    except ValueError as error:
        return _refuse(str(error))
    except BrokenPipeError:
        return _reader_is_gone()
    except OSError as error:
        return _refuse(_explain(error))
    if failure is not None:
        print(printable(f"aps: the daemon failed: {failure}"), file=sys.stderr)
    return 0 if failure is None else 1


def _status(argv: Sequence[str], prog: str) -> int:
    """Show the running daemons."""
    parser = argparse.ArgumentParser(
        prog=f"{prog} status",
        description="Show the running daemons of this user on this machine, and their links; or those of --url.",
    )
    parser.add_argument(
        "--url",
        action="append",
        default=[],
        metavar="URL",
        help="ask the API of a daemon instead, http://HOST:PORT, also on another machine; repeatable. A token is taken "
        f"from the environment variable {TOKEN_VARIABLE}",
    )
    parser.add_argument("--once", action="store_true", help="look once, instead of every second until Ctrl-C")
    parser.add_argument("--json", action="store_true", help="print JSON, with all counters")
    parser.add_argument("--period", type=float, default=1.0, metavar="S", help="between two looks (1)")
    arguments = parser.parse_args(argv)
    if not 0.0 < arguments.period <= LONGEST_PERIOD_S:
        return _refuse(f"--period must be above 0 and at most {LONGEST_PERIOD_S:g} s, not {arguments.period}")
    from aps.status_view import watch  # a daemon does without rich

    try:
        return watch(
            arguments.period,
            once=arguments.once,
            as_json=arguments.json,
            urls=arguments.url,
            token=os.environ.get(TOKEN_VARIABLE, ""),
        )
    except BrokenPipeError:
        return _reader_is_gone()
    except OSError as error:
        return _refuse(str(error))


def _reader_is_gone() -> int:
    """Whoever reads our output has seen enough; Python shall not find that out again when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _refuse(text: str) -> int:
    for line in text.splitlines():
        print(printable(f"aps: {line}"), file=sys.stderr)
    return 2


_ADDRESS = re.compile(r"\('([^']*)', (\d+)")
"""How asyncio names the address that it could not bind."""


def _explain(error: OSError) -> str:
    text = error.strerror or str(error)
    place = _ADDRESS.search(text)
    if error.errno == errno.EADDRINUSE and place is not None:
        return (
            f"port {place[2]} is in use on {place[1]}: choose another with --listen HOST:PORT "
            "(or the option that named it)"
        )
    if place is not None:
        return f"cannot listen on {place[1]}:{place[2]}: {text} (see --listen)"
    return text if error.filename is None else f"{error.filename}: {text}"


if __name__ == "__main__":
    sys.exit(main())
