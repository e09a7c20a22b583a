"""``lostlink aps status``: a live table of the running daemons and their links."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from rich.console import Group
from rich.live import Live
from rich.table import Table

from aps.status import SUFFIX, status_directory

__all__ = ["ask", "tables", "watch"]

TIMEOUT_S: Final = 1.0
TROUBLES: Final = (
    "throttled",
    "dropped_rate",
    "dropped_full",
    "stalls",
    "bad_crc",
    "skipped_bytes",
    "dropped_in",
    "dropped_out",
)


def ask(directory: Path) -> Iterator[dict[str, Any]]:
    """What each daemon says, in the order of their names; sockets that nobody serves any more are removed."""
    for path in sorted(directory.glob(f"*{SUFFIX}")):
        try:
            yield _answer_of(path)
        except (ConnectionRefusedError, FileNotFoundError):
            path.unlink(missing_ok=True)
        except (OSError, ValueError) as error:
            yield {"name": path.stem, "error": str(error)}


def _answer_of(path: Path) -> dict[str, Any]:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(TIMEOUT_S)
        connection.connect(str(path))
        with connection.makefile("rb") as answer:
            told: dict[str, Any] = json.loads(answer.readline())
    return {"name": path.stem, **told}


def tables(answers: Sequence[dict[str, Any]]) -> Group | str:
    """The answers for people: a table of the daemons, and one of all their links."""
    if not answers:
        return "no daemon of yours is running on this machine"
    daemons = Table(
        "daemon", "system", "mode", "armed", "autopilot", "heartbeat", "turned away", "loops", "no route"
    )
    links = Table("daemon", "link", "peer", "up", "in/s", "in", "lost", "out", "troubles")
    for told in answers:
        if "error" in told:
            daemons.add_row(told["name"], f"[red]{told['error']}")
            continue
        daemons.add_row(*_daemon_row(told))
        for link in (*told["statistics"]["autopilot_links"], *told["statistics"]["clients"]):
            links.add_row(told["name"], *_link_row(link))
    return Group(daemons, links)


def _daemon_row(told: dict[str, Any]) -> list[str]:
    state, statistics = told["state"], told["statistics"]
    routes = statistics["routes"]
    peers = [link["peer"] for link in statistics["autopilot_links"]]
    age_s = state["heartbeat_age_s"]
    return [
        told["name"],
        str(told["sysid"]),
        state["mode"] or "-",
        "yes" if state["armed"] else "no",
        ", ".join(peers) or "[red]none",
        "-" if age_s is None else f"{age_s:.1f} s",
        str(statistics["turned_away"]),
        str(routes.get("loop", 0)),
        str(routes.get("no_route", 0)),
    ]


def _link_row(link: dict[str, Any]) -> list[str]:
    counters = {**link, **link["framer"], **link["outbox"]}
    troubles = [f"{name} {counters[name]}" for name in TROUBLES if counters[name]]
    return [
        f"{link['role']} {link['link']}",
        link["peer"],
        "[green]yes" if link["up"] else "no",
        f"{link['rate_in_hz']:g}",
        str(link["frames_in"]),
        str(link["lost_in"]),
        str(link["outbox"]["written_frames"]),
        ", ".join(troubles) or "-",
    ]


def watch(period_s: float, *, once: bool, as_json: bool) -> int:
    """Show the daemons of this user until interrupted; returns the exit status.

    Args:
        period_s: between two looks.
        once: look once.
        as_json: print one JSON array per look.
    """
    directory = status_directory()
    if as_json:
        while True:
            print(json.dumps(list(ask(directory))), flush=True)
            if once:
                return 0
            time.sleep(period_s)
    with (
        Live(tables(list(ask(directory))), auto_refresh=False) as live,
        contextlib.suppress(KeyboardInterrupt),
    ):
        while not once:
            time.sleep(period_s)
            live.update(tables(list(ask(directory))), refresh=True)
    return 0
