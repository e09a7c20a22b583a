"""One ground node of a host: an agent at a place, without an aircraft; perhaps with modems for ground stations."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from bridge.agents.outlet import NodeOutlet
from bridge.aircraft.ground_body import GroundBody
from bridge.host.hosted_node import HostedNode
from bridge.host.modem_devices import GroundPort
from bridge.host.modem_port import ModemPort
from bridge.host.node_record import NodeRecord
from bridge.run.directory import RunDirectory
from bridge.scenario.nodes import GroundNode
from bridge.scenario.resolve.ground_track import GroundTrack

log = logging.getLogger("host")


class HostedGround(HostedNode):
    """One ground node with an agent."""

    def __init__(self, run: RunDirectory, config: GroundNode, outlet: NodeOutlet) -> None:
        body, record = (
            GroundBody(config.node, GroundTrack(run.scenario, config)),
            NodeRecord(run, config.node, has_autopilot=False),
        )
        super().__init__(run, config, record, body, outlet)
        self._devices: dict[str, GroundPort] = {}
        if config.modems:
            self._open_modems(run, config, record)

    def _open_modems(self, run: RunDirectory, config: GroundNode, record: NodeRecord) -> None:
        from bridge.endpoints.address import (
            endpoint_of,  # the channel takes its time, and few nodes have modems
        )
        from bridge.modem.settings import modem_of
        from bridge.scenario.resolve.radio import medium_on

        for radio, modem in config.modems.items():
            baud = modem_of(medium_on(run.scenario, radio, config.node), modem.baud).baud
            endpoints = [endpoint_of(text) for text in modem.serve]
            self._devices[radio] = GroundPort(endpoints, baud, run.scenario.exchange_period_ns)
            self.ports[radio] = ModemPort(radio, self._devices[radio], record, is_outside=True)

    async def __aenter__(self) -> HostedGround:
        """Be ready for the first tick: ground stations can connect, unless a record is repeated."""
        await self.start()
        if self._record.replay is None:
            for radio, device in self._devices.items():
                await device.open()
                log.info("modem of node %s on %s at %s", self.id, radio, ", ".join(device.names))
        return self

    async def __aexit__(self, *exc: Any) -> None:
        """Send ground stations away."""
        for device in self._devices.values():
            await device.close()
        await super().__aexit__(*exc)

    def modem_counters(self) -> Mapping[str, int]:
        """What ground stations sent faster than the line, and what nobody took."""
        found: dict[str, int] = {}
        for radio, device in self._devices.items():
            found[f"modem.{radio}.overrun_bytes"] = device.overrun_bytes
            found[f"modem.{radio}.unread_bytes"] = device.unread_bytes
        return found
