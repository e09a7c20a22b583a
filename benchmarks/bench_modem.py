"""What `lostlink modem` carries on SiK radios, and what it takes of a core: one end busy, and both.

    python -m benchmarks.bench_modem [--duration 30] [--baud 57600]

Hosts on TCP send more than their lines carry, 200 bytes a frame, beside each other at 50 m. Rates are those of bytes
that came out; CPU time is the process's, without its start. The last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import re
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from threading import Event, Thread
from time import monotonic
from typing import Any

import psutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

BITS_PER_BYTE = 10
FRAME = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [1] * 185 + [0] * 66)
SAYS_ITS_PORT = re.compile(r"(ground station|autopilot) at tcpin:127\.0\.0\.1:(\d+)")
SETTLES_S = 3.0


@contextmanager
def link(baud: int) -> Iterator[tuple[psutil.Process, dict[str, int]]]:
    """A link that is up, and the ports of its hosts."""
    words = ["modem", "--gcs", "tcpin::0", "--autopilot", "tcpin::0", "--radio", "sik-433", "--json"]
    words += ["--distance", "50", "--baud", str(baud)]
    command = [sys.executable, "-m", "lostlink", *words]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            ports: dict[str, int] = {}
            while len(ports) < 2:
                line = process.stderr.readline()
                if not line:
                    raise RuntimeError("the link did not come up")
                ports |= {host: int(port) for host, port in SAYS_ITS_PORT.findall(line)}
            yield psutil.Process(process.pid), ports
        finally:
            process.terminate()


class Host:
    """Sends without an end, or not, and counts what comes."""

    def __init__(self, port: int, *, sends: bool) -> None:
        self.came_bytes = 0
        self._socket = socket.create_connection(("127.0.0.1", port))
        self._over = Event()
        self._threads = [Thread(target=each) for each in (self._hear, self._say)[: 1 + sends]]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop."""
        self._over.set()
        self._socket.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        self._socket.close()

    def _hear(self) -> None:
        while data := self._socket.recv(65536):
            self.came_bytes += len(data)

    def _say(self) -> None:
        mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        while not self._over.is_set():
            try:
                self._socket.sendall(FRAME.pack(mav))
            except OSError:
                break
            mav.seq = (mav.seq + 1) % 256


def busy(baud: int, duration_s: float, *, both: bool) -> dict[str, Any]:
    """Bytes a second that came down and up, and CPU seconds a second."""
    with link(baud) as (process, ports), ExitStack() as stack:
        ground = Host(ports["ground station"], sends=both)
        stack.callback(ground.close)
        air = Host(ports["autopilot"], sends=True)
        stack.callback(air.close)
        Event().wait(SETTLES_S)
        began_s, times, came = monotonic(), process.cpu_times(), (ground.came_bytes, air.came_bytes)
        Event().wait(duration_s)
        span_s, now = monotonic() - began_s, process.cpu_times()
        cores = (now.user + now.system - times.user - times.system) / span_s
        rates = ((ground.came_bytes - came[0]) / span_s, (air.came_bytes - came[1]) / span_s)
        return {"down_bytes_per_s": rates[0], "up_bytes_per_s": rates[1], "cores": cores}


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure both cases, and print them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--duration", type=float, default=30.0, metavar="SECONDS")
    parser.add_argument("--baud", type=int, default=57_600)
    args = parser.parse_args(arguments)
    print(f"a line carries {args.baud / BITS_PER_BYTE:.0f} B/s")
    found = {}
    for name, both in (("one end", False), ("both ends", True)):
        found[name] = row = busy(args.baud, args.duration, both=both)
        print(
            f"{name + ' busy':<16}{row['down_bytes_per_s']:>7.0f} B/s down{row['up_bytes_per_s']:>7.0f} B/s up"
            f"{row['cores']:>7.3f} of a core"
        )
    print(json.dumps(found))
    return found


if __name__ == "__main__":
    main()
