"""``lostlink aps status``: a live table of the running daemons and their links."""

from __future__ import annotations

import contextlib
import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from http.client import HTTPException
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from rich import markup
from rich.console import Console, Group
from rich.live import Live
from rich.table import Column, Table
from rich.text import Text

from aps.logs.printable import printable
from aps.status import SUFFIX, remove_stale, status_directory

TIMEOUT_S: Final = 1.0
WIDE: Final = 1000
"""Columns where the output is no terminal: a table is as wide as it needs."""
HTTP_TIMEOUT_S: Final = 5.0
BUSY_TRIES: Final = 5
"""How often a daemon is asked that has too many requests ..."""
BUSY_WAIT_S: Final = 5.0
"""... and how long it is waited for at most each time, whatever it says."""
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


LEGEND: Final = "\n".join(
    (
        "turned away: clients beyond the most that there may be. loops: messages that came back, or in the autopilot's "
        "name from elsewhere. no route: messages for a system that no link has seen.",
        "up: heartbeats come. ms: to the autopilot and back (median). in/s, in, out: messages. "
        "lost: of those that came in, by their numbers.",
        "throttled, dropped_rate: the peer sends more than it may, and waits, or loses datagrams. "
        "dropped_full, stalls: it reads too slowly. bad_crc, skipped_bytes: what it sends is not MAVLink. "
        "dropped_in, dropped_out: by the link's rules.",
    )
)
"""What the columns mean."""


def ask(directory: Path) -> Iterator[dict[str, Any]]:
    """What each daemon says, in the order of their names; sockets that nobody serves any more are removed."""
    remove_stale(directory)
    for path in sorted(directory.glob(f"*{SUFFIX}")):
        try:
            yield _answer_of(path)
        except (ConnectionRefusedError, FileNotFoundError):
            continue  # it begins, or has just ended
        except (OSError, ValueError) as error:
            yield {"name": path.stem, "error": str(error)}


def _answer_of(path: Path) -> dict[str, Any]:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(TIMEOUT_S)
        connection.connect(str(path))
        with connection.makefile("rb") as answer:
            return _named(path.stem, json.loads(answer.readline()))


def _named(name: str, told: Any) -> dict[str, Any]:
    if not isinstance(told, dict):
        raise ValueError("its answer is not a JSON object")
    return {"name": name, **told}


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """The token is for the daemon that was named, and for nobody that it names."""

    def redirect_request(self, *_: Any) -> None:
        """Follow none: the answer counts as an error."""


def ask_over_http(urls: Sequence[str], token: str) -> Iterator[dict[str, Any]]:
    """What daemons say of themselves at their APIs, in the order of ``urls`` (``http://HOST:PORT``).

    Of one that does not answer, or not so, ``error`` says why.
    """
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), _NoRedirects)
    for url in urls:
        whole = url if "://" in url else f"http://{url}"
        name = url
        try:
            place = urlsplit(whole)
            name = place.netloc or url
            if place.scheme not in ("http", "https"):
                raise ValueError(f"http:// or https:// is expected, not {place.scheme}:")
            headers = {"Authorization": f"Bearer {token}"} if token else {}
            request = urllib.request.Request(f"{whole.rstrip('/')}/status", headers=headers)
            with _opened(opener, request) as reply:
                yield _named(name, json.load(reply))
        except urllib.error.HTTPError as error:
            with error:
                refusal = _refusal(error)
            yield {"name": name, "error": refusal}
        except urllib.error.URLError as error:
            yield {"name": name, "error": str(error.reason)}
        except (OSError, ValueError) as error:
            yield {"name": name, "error": str(error)}
        except HTTPException as error:
            yield {"name": name, "error": f"this is not HTTP: {error!r}"}


def _opened(opener: urllib.request.OpenerDirector, request: urllib.request.Request) -> Any:
    """The reply; of an API that has too many requests (429) once it has time, if it says when that is."""
    for _ in range(BUSY_TRIES - 1):
        try:
            return opener.open(request, timeout=HTTP_TIMEOUT_S)
        except urllib.error.HTTPError as error:
            after = error.headers.get("Retry-After", "")
            if error.code != 429 or not (after.isascii() and after.isdecimal() and len(after) < 10):
                raise
            error.close()
            time.sleep(min(int(after), BUSY_WAIT_S))
    return opener.open(request, timeout=HTTP_TIMEOUT_S)


def _refusal(error: urllib.error.HTTPError) -> str:
    if error.code == 401:
        return "it wants its token"
    elsewhere = error.headers.get("Location") if 300 <= error.code < 400 else None
    return f"it sends elsewhere, which is not followed: {elsewhere}" if elsewhere else str(error)


def tables(answers: Sequence[dict[str, Any]]) -> Group | str:
    """The answers for people: a table of the daemons, and one of all their links."""
    if not answers:
        return "no daemon of yours is running on this machine"
    daemons = _table(
        "daemon", "system", "mode", "armed", "autopilot", "heartbeat", "turned away", "loops", "no route"
    )
    links = _table("daemon", "link", "peer", "up", "ms", "in/s", "in", "lost", "out", "troubles")
    for told in answers:
        name = _shown(told["name"])
        if "error" in told:
            daemons.add_row(name, f"[red]{_shown(str(told['error']))}")
            continue
        try:
            row, link_rows = _daemon_row(told), [_link_row(link) for link in _links(told)]
        except (KeyError, TypeError, ValueError, AttributeError):
            daemons.add_row(name, "[red]its answer is not that of a daemon of this version")
            continue
        daemons.add_row(name, *row)
        for link_row in link_rows:
            links.add_row(name, *link_row)
    return Group(daemons, links, Text(LEGEND, style="dim"))


def _shown(text: str) -> str:
    """A text that others wrote, as it is shown: nothing in it is markup, or moves the cursor."""
    return markup.escape(printable(text))


def _links(told: dict[str, Any]) -> list[dict[str, Any]]:
    return [*told["statistics"]["autopilot_links"], *told["statistics"]["clients"]]


def _table(*names: str) -> Table:
    """A table whose cells are whole also in a narrow terminal."""
    return Table(*(Column(name, overflow="fold") for name in names))


def _daemon_row(told: dict[str, Any]) -> list[str]:
    state, statistics = told["state"], told["statistics"]
    routes = statistics["routes"]
    peers = [link["peer"] for link in statistics["autopilot_links"]]
    others = ", ".join(map(str, statistics["other_systems"]))
    age_s = state["heartbeat_age_s"]
    return [
        f"{told['sysid']} [red](there is {others})" if others else str(told["sysid"]),
        _shown(state["mode"]) or "-",
        "yes" if state["armed"] else "no",
        _shown(", ".join(peers)) or "[red]none",
        "-" if age_s is None else f"{age_s:.1f} s",
        str(statistics["turned_away"]),
        str(routes.get("loop", 0)),
        str(routes.get("no_route", 0)),
    ]


def _link_row(link: dict[str, Any]) -> list[str]:
    counters = {**link, **link["framer"], **link["outbox"]}
    latency_ms = link.get("latency", {}).get("median_ms")
    troubles = [f"{name} {counters[name]}" for name in TROUBLES if counters[name]]
    return [
        f"{link['role']} {link['link']}",
        _shown(link["peer"]),
        "[green]yes" if link["up"] else "no",
        "-" if latency_ms is None else f"{latency_ms:.1f}",
        f"{link['rate_in_hz']:g}",
        str(link["frames_in"]),
        str(link["lost_in"]),
        str(link["outbox"]["written_frames"]),
        ", ".join(troubles) or "-",
    ]


def watch(period_s: float, *, once: bool, as_json: bool, urls: Sequence[str] = (), token: str = "") -> int:
    """Show daemons until interrupted; returns the exit status: 1 if one of them did not answer as it should.

    Args:
        period_s: between two looks.
        once: look once.
        as_json: print one JSON array per look.
        urls: APIs to ask, also on other machines; without any, all daemons of this user on this machine are shown.
        token: of these APIs.
    """
    look: Callable[[], Iterator[dict[str, Any]]]
    look = partial(ask_over_http, urls, token) if urls else partial(ask, status_directory())
    told = list(look())
    console = Console()
    if as_json or not console.is_terminal:
        show = _print_json if as_json else _print_tables
        with contextlib.suppress(KeyboardInterrupt):
            show(told)
            while not once:
                time.sleep(period_s)
                told = list(look())
                show(told)
        return _status_of(told)
    with (
        Live(tables(told), console=console, auto_refresh=False) as live,
        contextlib.suppress(KeyboardInterrupt),
    ):
        while not once:
            time.sleep(period_s)
            told = list(look())
            live.update(tables(told), refresh=True)
    return _status_of(told)


def _print_json(told: Sequence[dict[str, Any]]) -> None:
    print(json.dumps(told), flush=True)


def _print_tables(told: Sequence[dict[str, Any]]) -> None:
    Console(width=WIDE).print(tables(told))


def _status_of(told: Sequence[dict[str, Any]]) -> int:
    return int(any("error" in daemon for daemon in told))
