"""One UA of a host: its MAVLink daemon is connected when physics holds its autopilot's first frame."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from contextlib import AsyncExitStack
from pathlib import Path
from types import MappingProxyType
from typing import Any

from aps.config import DaemonConfig
from aps.held import HeldDaemon
from aps.links.address import parse_autopilot
from aps.links.kinds.called import CalledClient, CalledLink
from aps.links.kinds.held import HeldLink
from aps.vehicle.autopilots.autopilot import SYSTEM_TIME
from aps.vehicle.status_text import MAX_REASON_SEVERITY, StatusText
from aps.vehicle.streams import DEFAULT_RATES_HZ
from bridge.agents.outlet import NodeOutlet
from bridge.aircraft.aircraft_bridge import AircraftBridge
from bridge.host.hosted_node import HostedNode
from bridge.host.modem_devices import AutopilotPort
from bridge.host.modem_port import ModemPort
from bridge.host.node_record import NodeRecord
from bridge.run.directory import TLOG_FOLDER, RunDirectory
from bridge.run.process import current_node
from bridge.run.px4 import px4_events_file
from bridge.scenario.model import START_TIME_UNIX_S, Scenario
from bridge.scenario.nodes import Aircraft

PX4_RATES_HZ = {message: rate for message, rate in DEFAULT_RATES_HZ.items() if message != SYSTEM_TIME}
"""PX4's SYSTEM_TIME has the time of the machine: no two records would be alike."""
log = logging.getLogger("host")


class HostedAircraft(HostedNode):
    """One UA.

    Args:
        run: the run.
        config: the UA as the scenario has it.
        outlet: where what it says goes.
        autopilot: one in this process; None: it listens on its port.
        serials: further serial ports of that, by number.
    """

    def __init__(
        self,
        run: RunDirectory,
        config: Aircraft,
        outlet: NodeOutlet,
        autopilot: CalledClient | None = None,
        serials: Mapping[int, CalledClient] = MappingProxyType({}),
    ) -> None:
        scenario, record = run.scenario, NodeRecord(run, config.node)
        kind = scenario.autopilot_of(config)
        self.daemon = HeldDaemon(
            DaemonConfig(
                autopilot=mavlink_of(scenario, config),
                sysid=config.sysid,
                listen_port=scenario.aps_port(config),
                links=tuple(f"udp-out:{place}" for place in scenario.udp_outputs(config)),
                middle_stick=kind != "external",
                tlog_directory=run.path / TLOG_FOLDER if scenario.mavlink.tlog else None,
                tlog_name=config.node,
                tlog_epoch_us=START_TIME_UNIX_S * 1_000_000,
                stream_rates_hz=PX4_RATES_HZ if kind == "px4" else DEFAULT_RATES_HZ,
                events_file=_events_file(run, config) if kind == "px4" else None,
            ),
            autopilot=autopilot,
            ahead=bool(scenario.lookahead_ticks),
            peer=("127.0.0.1", scenario.autopilot_port(config)) if kind == "px4" else None,
        )
        self._aircraft = AircraftBridge(self.daemon, config.node)
        super().__init__(run, config, record, self._aircraft, outlet)
        self._api_port = scenario.api_port(config)
        self._api = AsyncExitStack()
        self.daemon.on_bytes = record.write_mavlink
        self.daemon.on_wall_time = record.may_not_repeat
        if kind == "standin":
            self.daemon.has_machine = False  # it has no threads, refuses files and has no logs
        self.daemon.on_link_down = self._link_down
        self.daemon.on_failure = self._cannot_go_on
        self.daemon.vehicle.on_foreign = record.other_system
        self.daemon.vehicle.text_listeners.append(self._autopilot_said)
        self.daemon.on_input = self.node.client_did
        self._connecting: asyncio.Task[None] | None = None
        self._waits = False
        self._devices: dict[str, AutopilotPort] = {}
        for radio, modem in config.modems.items():
            address = parse_autopilot(f"tcp:127.0.0.1:{scenario.serial_port(config, modem.serial)}")
            port, limit = serials.get(modem.serial), self.daemon.config.queue_limit_bytes
            link = HeldLink(address, limit) if port is None else CalledLink(port, address, limit)
            device = AutopilotPort(link, record.may_not_repeat)
            self._devices[radio] = device
            self.ports[radio] = ModemPort(radio, device, record, is_outside=False)

    async def __aenter__(self) -> HostedAircraft:
        """Be ready for the first tick: clients can connect, and the agent is built."""
        token = current_node.set(self.id)  # what its clients do is logged with its name
        try:
            await self.daemon.__aenter__()
            await self.start()
            await self._serve_api()
        finally:
            current_node.reset(token)
        log.info("MAVLink of UA %s at tcp:127.0.0.1:%d", self.id, self.daemon.listen_port)
        return self

    async def _serve_api(self) -> None:
        if self._scenario.api:
            from bridge.host.api import api_of  # FastAPI takes its time, and most runs do without

            await self._api.enter_async_context(
                api_of(self.daemon, self.node, self._api_port, self._cannot_go_on)
            )
            log.info("API of UA %s at http://127.0.0.1:%d", self.id, self._api_port)

    def last_message(self, name: str) -> dict[str, Any] | None:
        """The last MAVLink message of a type that the autopilot sent; None if there is none.

        Raises:
            ValueError: there is no message of this name.
        """
        return self._aircraft.last_message(name)

    async def __aexit__(self, *exc: Any) -> None:
        """Close the daemon's sockets."""
        await self._api.aclose()
        await self.daemon.__aexit__(*exc)

    def hold(self, sim_time_ns: int, *, absent: bool = False) -> None:
        """The fleet is held at ``sim_time_ns``; at the first tick, MAVLink is connected before anything else."""
        if sim_time_ns > 0 or self.daemon.link_up:
            super().hold(sim_time_ns)
        elif absent or self._scenario.fdm.scheme == "legacy":  # such a peer need not speak MAVLink at all
            self._connecting = asyncio.create_task(self._reconnect())
            super().hold(sim_time_ns)
        else:
            # The first frame of a UA is answered when its MAVLink is connected: its first bytes are in the ring, too.
            self._waits = True
            self._connecting = asyncio.create_task(self._connect_first())

    def live(self, sim_time_ns: int, *, is_tick: bool) -> None:
        """Do what the node does at this instant; before its first connection nothing."""
        if not self._waits:
            super().live(sim_time_ns, is_tick=is_tick)

    async def _connect_first(self) -> None:
        with self._named():
            await self.daemon.connect()
        self._waits = False
        super().hold(0)
        super().live(0, is_tick=True)

    async def _reconnect(self) -> None:
        with self._named():
            await self.daemon.connect()
            self._record.may_not_repeat("its MAVLink was connected during the run, when wall time let it")

    def flush_record(self) -> None:
        """Hand what was recorded to the operating system, its tlog too."""
        super().flush_record()
        self.daemon.flush_record()

    def _link_down(self) -> None:
        """The autopilot closed its MAVLink (it reboots, or is gone): connect again as soon as it listens."""
        self._record.may_not_repeat("its autopilot closed its MAVLink connection")
        self._connecting = asyncio.create_task(self._reconnect())

    def _autopilot_said(self, text: StatusText) -> None:
        if text.severity <= MAX_REASON_SEVERITY:
            self.node.arrivals.warning_came(text.text, text.severity)

    def modem_counters(self) -> Mapping[str, int]:
        """What its autopilot did not read at serial ports with a modem."""
        return {f"modem.{radio}.unread_bytes": device.unread_bytes for radio, device in self._devices.items()}

    def statistics(self) -> Mapping[str, Any]:
        """Counters of its MAVLink daemon."""
        return self.daemon.statistics()

    def close(self) -> None:
        """Write what is left of the record."""
        if self._connecting is not None:
            self._connecting.cancel()
        for device in self._devices.values():
            device.close()
        self.daemon.flush_record()  # what it counted is in the counters
        super().close()


def _events_file(run: RunDirectory, ua: Aircraft) -> Path | None:
    """What the events of the PX4 mean that flies ``ua``; None: it is not known."""
    from bridge.record.provenance import (
        read_provenance,
    )  # late: it takes the radio with it, which hosts do without

    made = read_provenance(run.path)
    binary = "" if made is None or ua.node not in made.autopilots else made.autopilots[ua.node].path
    return px4_events_file(Path(binary)) if binary else None


def mavlink_of(scenario: Scenario, ua: Aircraft) -> str:
    """Where the daemon finds the autopilot: at a TCP port of ArduPilot or the stand-in; PX4 sends to one of ours."""
    port = scenario.autopilot_port(ua)
    return f"udp-in:127.0.0.1:{port + 1}" if scenario.autopilot_of(ua) == "px4" else f"tcp:127.0.0.1:{port}"
