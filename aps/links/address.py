"""Where links go: ``tcp-server:127.0.0.1:6760``, ``serial:/dev/ttyACM0:57600,read-only``, read and checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from aps.links.link import CLIENT_OPENING, Opening, Role
from aps.links.rules import Filter, LinkRules
from aps.wire.signing import read_key

DEFAULT_BAUD: Final = 57600
LOOPBACK: Final = "127.0.0.1"
KINDS: Final = {
    "tcp": "connect to a TCP server, again and again",
    "tcp-server": "serve TCP clients",
    "udp-out": "send to a UDP port, and take what comes back",
    "udp-in": "wait on a UDP port for whoever sends",
    "serial": "a serial line, DEVICE[:BAUD]",
}
"""Kinds of links, as they are written before the first colon."""


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """One place to open links at."""

    kind: str
    """One of ``KINDS``."""
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int = DEFAULT_BAUD
    opening: Opening = CLIENT_OPENING

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"serial:{self.device}:{self.baud}"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}:{host}:{self.port}"


def parse_host_port(text: str, *, lowest_port: int = 1) -> tuple[str, int]:
    """``HOST:PORT`` (``[::1]:PORT`` for IPv6).

    Raises:
        ValueError: with the text and what is allowed.
    """
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or not lowest_port <= int(port) <= 65535:
        raise ValueError(f"{text!r} is not HOST:PORT with a port in {lowest_port}..65535")
    host = host.removeprefix("[").removesuffix("]")
    try:
        host.encode("idna")  # as it is done when the name is looked up
        if "\0" in host:
            raise ValueError("it holds a zero byte")
    except ValueError as error:
        raise ValueError(f"{host!r} is not the name of a host: {error}") from error
    return host, int(port)


def parse_address(text: str, role: Role = Role.CLIENT) -> LinkAddress:
    """``KIND:PLACE[,RULE...]``, see ``KINDS``; ``:PORT`` alone is on loopback.

    Rules: ``read-only``; ``block-in=30/33``, ``allow-out=0/1``, and the same with ``-systems`` or ``-components``
    after in or out; ``max-hz=30:5/33:2`` (message id or ``*``: rate); ``key=FILE``: sign and verify with the key
    in a file.

    Raises:
        ValueError: with the text and what is allowed.
    """
    place, *rules = text.split(",")
    kind, _, where = place.partition(":")
    opening = Opening(role, _rules(rules, text))
    if kind not in KINDS:
        raise ValueError(f"{text!r} is no link: it begins with none of {', '.join(KINDS)}")
    if kind == "serial":
        return _serial(where, opening, text)
    if where.startswith(":"):
        where = LOOPBACK + where
    listens = kind in ("tcp-server", "udp-in")
    try:
        host, port = parse_host_port(where, lowest_port=0 if listens else 1)
    except ValueError as error:
        raise ValueError(f"{text!r} is not {kind}:HOST:PORT: {error}") from error
    return LinkAddress(kind, host, port, opening=opening)


def _serial(where: str, opening: Opening, text: str) -> LinkAddress:
    device, _, baud = where.partition(":")
    if not device or (baud and not baud.isdecimal()):
        raise ValueError(f"{text!r} is not serial:DEVICE[:BAUD]")
    return LinkAddress("serial", device=device, baud=int(baud or DEFAULT_BAUD), opening=opening)


def parse_autopilot(text: str) -> LinkAddress:
    """The way to an autopilot: any kind but a TCP server.

    Raises:
        ValueError: with the text and what is allowed.
    """
    kind = text.partition(":")[0]
    if kind not in KINDS or kind == "tcp-server":
        others = ", ".join(f"{kind}:..." for kind in KINDS if kind not in ("tcp", "tcp-server"))
        raise ValueError(f"autopilot {text!r} is not tcp:HOST:PORT (or {others})")
    return parse_address(text, Role.AUTOPILOT)


# Rules.


def _numbers(text: str) -> frozenset[int]:
    return frozenset(int(number) for number in text.split("/"))


def _rates(text: str) -> dict[int, float]:
    pairs = (item.split(":") for item in text.split("/"))
    return {-1 if msg_id == "*" else int(msg_id): float(rate_hz) for msg_id, rate_hz in pairs}


def _filter_field(which: str, what: str) -> Callable[[Filter, frozenset[int]], Filter]:
    return lambda old, numbers: replace(old, **{f"{which}_{what}": numbers})


_FILTERS: Final = {
    f"{which}-{way}{suffix}": (way, _filter_field(which, what))
    for which in ("allow", "block")
    for way in ("in", "out")
    for suffix, what in (("", "messages"), ("-systems", "systems"), ("-components", "components"))
}


def _rules(words: list[str], text: str) -> LinkRules:
    filters = {"in": Filter(), "out": Filter()}
    read_only, rates_hz, key = False, {}, None
    for word in words:
        name, _, value = word.partition("=")
        try:
            if name == "read-only" and not value:
                read_only = True
            elif name == "max-hz":
                rates_hz = _rates(value)
            elif name == "key" and value:
                key = read_key(Path(value))
            elif name in _FILTERS:
                way, change = _FILTERS[name]
                filters[way] = change(filters[way], _numbers(value))
            else:
                raise ValueError(f"no such rule; there are: read-only, max-hz, key, {', '.join(_FILTERS)}")
        except (ValueError, OSError) as error:
            raise ValueError(f"rule {word!r} of link {text!r}: {error}") from error
    incoming, outgoing = (None if filters[way] == Filter() else filters[way] for way in ("in", "out"))
    return LinkRules(read_only, incoming, outgoing, rates_hz, key)
