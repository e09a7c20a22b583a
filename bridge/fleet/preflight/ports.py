"""The ports that a run needs, looked at before anything is started."""

from __future__ import annotations

import socket
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

from bridge.fleet.how import calls_standins, has_bus
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft

HOST = "127.0.0.1"
PORT_MAX = 65535


TOLD_MAX = 3
"""Ports that are told each for itself, of those of which the same is to be done."""


@dataclass(frozen=True, slots=True)
class PortUse:
    """A port and what for; ``setting`` is the key of the scenario that moves it."""

    port: int
    transport: str
    purpose: str
    setting: str

    @property
    def is_free(self) -> bool:
        """Whether it can be bound on loopback at this moment."""
        kind = socket.SOCK_DGRAM if self.transport == "UDP" else socket.SOCK_STREAM
        with socket.socket(type=kind) as probe:
            if kind == socket.SOCK_STREAM:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, self.port))
            except OSError:
                return False
        return True

    def __str__(self) -> str:
        return f"{self.transport} port {self.port} ({self.purpose})"


class Conflict(NamedTuple):
    """A port, what is wrong with it ("" if nothing is), and what to do."""

    use: PortUse
    wrong: str = ""
    remedy: str = ""


def ports_of(scenario: Scenario, *, repeats: bool = False) -> Iterator[PortUse]:
    """All ports that the run listens on, or expects its autopilots to; autopilots that are called have none.

    Args:
        scenario: of the run.
        repeats: it repeats a record, which has what ground stations sent: no modem is served.
    """
    called = calls_standins(scenario)
    if scenario.ports.zenoh and has_bus(scenario):
        yield PortUse(scenario.ports.zenoh, "TCP", "Zenoh router", "ports.zenoh")
    if not repeats:
        yield from _served(scenario)
    fdm_setting = "ports.fdm" if scenario.fdm.scheme == "json" else "ports.first_slot"
    for ua in scenario.ua:
        kind = scenario.autopilot_of(ua)
        if kind == "px4":
            yield from _of_px4(scenario, ua)
        elif not called:
            yield PortUse(scenario.fdm_port(ua), "UDP", f"flight dynamics of UA {ua.id}", fdm_setting)
        yield PortUse(scenario.aps_port(ua), "TCP", f"MAVLink server of UA {ua.id}", "ports.aps")
        if scenario.api:
            yield PortUse(scenario.api_port(ua), "TCP", f"HTTP API of UA {ua.id}", "ports.api")
        if kind not in ("external", "px4") and not called:
            yield PortUse(scenario.autopilot_port(ua), "TCP", f"autopilot of UA {ua.id}", "ports.autopilot")
        if kind == "standin" and not called:
            for modem in ua.modems.values():
                port = scenario.serial_port(ua, modem.serial)
                yield PortUse(port, "TCP", f"serial port {modem.serial} of UA {ua.id}", "ports.autopilot")
        if kind == "ardupilot":
            for serial, offset in ((1, 2), (2, 3)):
                port = scenario.autopilot_port(ua) + offset
                yield PortUse(port, "TCP", f"SERIAL{serial} of UA {ua.id}'s ArduPilot", "ports.first_slot")


def _of_px4(scenario: Scenario, ua: Aircraft) -> Iterator[PortUse]:
    """Ports of PX4: its simulator's, its own, and where its MAVLink goes to."""
    port = scenario.autopilot_port(ua)
    yield PortUse(scenario.fdm_port(ua), "TCP", f"flight dynamics of UA {ua.id}'s PX4", "ports.first_slot")
    yield PortUse(port, "UDP", f"MAVLink of UA {ua.id}'s PX4", "ports.autopilot")
    yield PortUse(port + 1, "UDP", f"MAVLink from UA {ua.id}'s PX4", "ports.autopilot")


def _served(scenario: Scenario) -> Iterator[PortUse]:
    """Ports at which ground stations find modems."""
    for node in scenario.ground:
        for radio, modem in node.modems.items():
            for text in modem.serve:
                kind, _, place = text.partition(":")
                port = int(place.rpartition(":")[2]) if kind in ("tcpin", "udpin") else 0
                if port:
                    transport = "TCP" if kind == "tcpin" else "UDP"
                    key = f"modems.{radio}.serve of node {node.node}"
                    yield PortUse(port, transport, f"modem of node {node.node} on {radio}", key)


def why_no_loopback() -> str:
    """Why nothing can listen on this machine, whatever the port; "" if something can."""
    with socket.socket() as probe:
        try:
            probe.bind((HOST, 0))
        except OSError as error:
            return f"{HOST} cannot be bound ({error.strerror}), where all parts of a run listen: is the loopback up?"
    return ""


def conflicts(uses: Iterable[PortUse], held: Collection[PortUse] = ()) -> list[str]:
    """One line for each port that cannot be had: number, purpose, owner if known, and how to change it.

    Of more than `TOLD_MAX` that are changed in one way there is one line, with the first of them and how many more.

    Args:
        uses: the ports that are wanted.
        held: those of them that another run has, and may not have bound yet.
    """
    settled = list(_settled(uses))
    taken = dict.fromkeys(held, "is in use by another run")
    taken |= _bound([each.use for each in settled if not each.wrong and not each.use.is_free])
    return _lines(
        each if each.wrong else Conflict(each.use, taken[each.use], _remedy(each.use))
        for each in settled
        if each.wrong or each.use in taken
    )


def mistakes(uses: Iterable[PortUse]) -> list[str]:
    """Those of `conflicts` that are the scenario's own, whatever else is on the machine."""
    return _lines(each for each in _settled(uses) if each.wrong)


def _lines(found: Iterable[Conflict]) -> list[str]:
    by_remedy: dict[str, list[str]] = {}
    for use, wrong, remedy in found:
        by_remedy.setdefault(remedy, []).append(f"{use} {wrong}")
    lines = []
    for remedy, told in by_remedy.items():
        if (more := len(told) - TOLD_MAX) > 0:
            plural = remedy.replace("free it", "free them", 1)
            lines.append(f"{', '.join(told[:TOLD_MAX])}, and so are {more} more: {plural}")
        else:
            lines += [f"{each}: {remedy}" for each in told]
    return lines


def _settled(uses: Iterable[PortUse]) -> Iterator[Conflict]:
    """Each port that is wanted, and what is wrong with that in the scenario itself."""
    seen: dict[tuple[str, int], PortUse] = {}
    for use in uses:
        key = (use.transport, use.port)
        if key in seen:
            wrong = f"is also wanted for {seen[key].purpose}"
            yield Conflict(use, wrong, f"change {use.setting} in the scenario")
        elif use.port > PORT_MAX:
            yield Conflict(
                use, f"is beyond {PORT_MAX}", f"lower {use.setting} or ports.first_slot in the scenario"
            )
        else:
            yield Conflict(use)
        seen[key] = use


def _remedy(use: PortUse) -> str:
    if use.setting == "ports.zenoh":
        return "free it, or choose another with --zenoh-port N (0: any) or ports.zenoh in the scenario"
    if use.setting.startswith("--"):
        return f"free it, or choose another with {use.setting} N (0: any)"
    if use.setting.startswith("modems."):
        return f"free it, or choose another in {use.setting} in the scenario (0: any)"
    return f"free it, or move all UA with --first-slot N (auto: to free ports), or change {use.setting} in the scenario"


def _bound(uses: Collection[PortUse]) -> dict[PortUse, str]:
    """What is wrong with ports that are bound: by whom, as far as this user may know."""
    if not uses:
        return {}
    import psutil  # late: few ports are in use

    owners = {}
    for transport, kind in (("UDP", "udp4"), ("TCP", "tcp4")):
        with suppress(psutil.Error):
            for each in psutil.net_connections(kind):
                if each.laddr and each.pid and not each.raddr:
                    owners[transport, each.laddr.port] = each.pid
    found = {}
    for use in uses:
        found[use] = "is in use"
        with suppress(psutil.Error, KeyError):
            pid = owners[use.transport, use.port]
            found[use] += f" by {psutil.Process(pid).name()} (pid {pid})"
    return found
