"""Autopilots for benchmarks of the daemon, each in processes of its own: a clock, the stand-in, a real arducopter."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bridge.fleet.autopilots.ardupilot import ArduPilot

SYSID: Final = 4
RATE_HZ: Final = 50
HOME: Final = "47.3977,8.5456,488,90"
PARAMETERS: Final = Path(__file__).parents[2] / "sitl_configs" / "params" / "copter.parm"
_SYSTEM_TIME: Final = 2
_ATTITUDE: Final = 30


@dataclass(frozen=True)
class Source:
    """An autopilot that runs."""

    port: int
    """Where the daemon connects."""
    direct_port: int | None
    """Where a witness may connect to the same autopilot without a daemon; ``None``: nowhere."""
    msg_id: int
    """The message that the witness looks at."""


def before_others(pid: int) -> None:
    """Have a process run before all that the machine does beside, if we may: that is not what is measured."""
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(pid, os.SCHED_FIFO, os.sched_param(1))


@contextlib.contextmanager
def process(
    *arguments: str, first: bool = False, module: bool = True, cwd: str | None = None
) -> Iterator[subprocess.Popen[str]]:
    """A process, ended for sure; ``first``: see ``before_others``."""
    command = [sys.executable, "-m", *arguments] if module else list(arguments)
    stderr = None if module else subprocess.DEVNULL
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=stderr, text=True, cwd=cwd) as child:
        try:
            if first:
                before_others(child.pid)
            yield child
        finally:
            child.kill()


def line_of(child: subprocess.Popen[str]) -> str:
    """The next line that it prints."""
    assert child.stdout is not None
    return child.stdout.readline().strip()


def _port_of(child: subprocess.Popen[str], pattern: str) -> int:
    while found := line_of(child):
        match = re.search(pattern, found)
        if match is not None:
            return int(match[1])
    raise RuntimeError(f"a process ended without naming {pattern}")


def clock() -> None:
    """The process of the clock: the time of day 50 times a second, and a heartbeat every second, to two who connect."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        connections = [server.accept()[0] for _ in range(2)]
    for connection in connections:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
    mav = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
    due_s = time.monotonic()
    for number in range(1_000_000):
        message = mavlink.MAVLink_system_time_message(time.time_ns() // 1000, number * 20)
        data = bytes(message.pack(mav))
        if number % RATE_HZ == 0:
            data += bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 4, 4, 3).pack(mav))
        for connection in connections:
            connection.send(data)
            with contextlib.suppress(BlockingIOError):
                while connection.recv(1 << 16):
                    pass
        due_s += 1.0 / RATE_HZ
        time.sleep(max(0.0, due_s - time.monotonic()))


@contextlib.contextmanager
def _clock() -> Iterator[Source]:
    with process("benchmarks.aps.bench_aps_fairness", "--role", "clock", first=True) as child:
        port = int(line_of(child))
        yield Source(port, port, _SYSTEM_TIME)


@contextlib.contextmanager
def _standin() -> Iterator[Source]:
    with process("fdm", "--home", HOME, "--port=0", "--speed=1", first=True) as fdm:
        fdm_port = _port_of(fdm, r"UDP 127\.0\.0\.1:(\d+)")
        arguments = ("--sysid", str(SYSID), "--fdm-port", str(fdm_port), "--mavlink-port=0", "--home", HOME)
        with process("standin", *arguments, first=True) as standin:
            yield Source(_port_of(standin, r"tcp:127\.0\.0\.1:(\d+)"), None, _ATTITUDE)


def _is_free(port: int) -> bool:
    with contextlib.suppress(OSError), contextlib.ExitStack() as stack:
        for serial in (0, 2, 3):
            stack.enter_context(socket.create_server(("127.0.0.1", port + serial)))
        return True
    return False


@contextlib.contextmanager
def _arducopter() -> Iterator[Source]:
    binary = ArduPilot(os.environ).binary("arducopter")
    instance = next(number for number in range(100, 250) if _is_free(5760 + 10 * number))
    port = 5760 + 10 * instance
    with tempfile.TemporaryDirectory(prefix="bench-aps-") as directory:
        command = [str(binary), "-w", "--model", "quad", "-I", str(instance), "--sysid", str(SYSID)]
        command += ["--home", HOME, "--serial0", "tcp:0", "--serial1", "tcp:2", "--defaults", str(PARAMETERS)]
        with process(*command, first=True, module=False, cwd=directory):
            yield Source(port, port + 2, _ATTITUDE)


SOURCES: Final[dict[str, Callable[[], AbstractContextManager[Source]]]] = {
    "clock": _clock,
    "standin": _standin,
    "arducopter": _arducopter,
}
