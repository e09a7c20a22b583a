"""A `lostlink view` in the background, and plain questions to it."""

from __future__ import annotations

import http.client
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.warm import Command


@dataclass(frozen=True)
class View:
    """Where a view is served."""

    address: str
    port: int

    def get(self, path: str = "/", **headers: str) -> http.client.HTTPResponse:
        """Ask for a page; `_` in names of headers stands for `-`."""
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)) as connection:
            connection.request("GET", path, headers={k.replace("_", "-"): v for k, v in headers.items()})
            reply = connection.getresponse()
            reply.body = reply.read().decode()  # type: ignore[attr-defined]
            return reply


@contextmanager
def serving(run: Path, *arguments: str) -> Iterator[View]:
    """Serve a view of ``run`` at any free port."""
    process = Command("view", run, "--port", "0", *arguments, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("view: http://"), line
        address = line.removeprefix("view: ").strip()
        yield View(address, int(address.split(":")[2].split("/")[0]))
    finally:
        process.terminate()
        process.communicate(timeout=20)
