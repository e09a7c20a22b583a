"""The base of all agents: tells the others its state (Table II) at every tick, and flies what `fly` says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge.agents.client import CommandFailed, UaClient
from bridge.bus.messages import AircraftState, DataPackage, Header, Waypoint, decode
from bridge.bus.session import Stamp
from bridge.scenario.model import Aircraft, OwnAgent, Transmit

READY_TIMEOUT_S = 180.0
"""Sim time; ArduPilot's estimator takes about 40 s."""


class Agent:
    """One UA's agent.

    Attributes:
        ua: the node as the agent sees it.
        waypoints: what it plans to fly; told to the others.
        latest: newest package that the radio delivered, of each other node.
    """

    def __init__(self, ua: UaClient, aircraft: Aircraft, transmit: Transmit) -> None:
        self.ua = ua
        self.aircraft = aircraft
        self.transmit_config = transmit
        self.waypoints: tuple[Waypoint, ...] = ()
        self.measurements_dbm: tuple[float, ...] = ()
        self.latest: dict[str, DataPackage] = {}
        self._ticks = 0
        ua.on_packet(self.on_packet)

    @property
    def options(self) -> Mapping[str, Any]:
        """What the scenario gives to an agent of type ``own``."""
        config = self.aircraft.agent
        return config.options if isinstance(config, OwnAgent) else {}

    async def fly(self) -> None:
        """What the agent does, once; the run is over when every agent is back from here."""

    def on_tick(self, sim_time_ns: int) -> None:
        """What the agent does at each tick of the fleet clock. It must not wait: the clock waits for it."""
        if self._ticks % self.transmit_config.every_ticks == 0:
            self.ua.transmit(self.transmit_config.channel, self.package(sim_time_ns))
        self._ticks += 1

    def on_packet(self, sender: str, channel: str, payload: bytes, stamp: Stamp) -> None:  # noqa: ARG002
        """What the agent does with a packet that the radio delivered.

        Raises:
            DecodeError: it is no data package; counted as malformed.
        """
        if channel == self.transmit_config.channel:
            self.latest[sender] = decode(payload, DataPackage)

    def package(self, sim_time_ns: int) -> DataPackage:
        """The data package of Moon et al. 2020, Table II."""
        return DataPackage(
            Header.at(sim_time_ns, self.ua.node),
            self.transmit_config.frequency_mhz,
            self.ua.state or AircraftState(),
            self.waypoints,
            self.measurements_dbm,
        )

    async def take_off(self, altitude_rel_m: float) -> AircraftState:
        """Wait until the autopilot can be armed, then arm and climb. Returns the state on the ground."""
        self.ua.report("waits until the autopilot is ready to arm")
        try:
            home = await self.ua.wait_for(lambda state: state.ready_to_arm, timeout_s=READY_TIMEOUT_S)
        except TimeoutError:
            raise CommandFailed(
                f"UA {self.ua.node}: the autopilot was not ready to arm within {READY_TIMEOUT_S:g} s of sim time; "
                f"the log of aircraft-{self.ua.node} has what it said"
            ) from None
        self.ua.report(f"takes off to {altitude_rel_m:g} m")
        await self.ua.set_mode("GUIDED")
        await self.ua.arm()
        await self.ua.takeoff(altitude_rel_m)
        return home
