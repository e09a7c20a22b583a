"""The base of all agents: transmits its state (Table II) at every tick, and flies what `fly` says.

An agent lives in sim time: whatever it awaits (`asyncio.sleep`, timeouts, timers) waits in sim time, and what it
transmits after an await has the stamp of the tick in which it ran. docs/reference/agents.md has the rules for its code.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bridge.agents.client import UaClient
from bridge.agents.commands import CommandFailed, checked_numbers
from bridge.agents.latest import LatestPackages
from bridge.agents.measurements import Measurement
from bridge.bus.messages import AircraftState, DataPackage, Header, Waypoint
from bridge.bus.reception import Reception
from bridge.scenario.agents import OwnAgent
from bridge.scenario.nodes import Aircraft, GroundNode
from bridge.scenario.sections import Transmit

READY_TIMEOUT_S = 180.0
"""Sim time; ArduPilot's estimator takes about 40 s."""
LONG_WAIT_S = 60.0
"""Of these, after which the agent says why it waits."""
SHORTEST_NS = 1000
"""Of a period: less than that and what is due now could not be told from what is due next."""
PACKAGE_MEASUREMENTS_MAX = 1000
"""The newest that a package carries."""


class Agent:
    """One UA's agent.

    Attributes:
        ua: the node as the agent sees it.
        waypoints: what it plans to fly; transmitted to the others.
        measurements_dbm: RF powers that are transmitted to the others; if empty, what the node's sensor measured since
            the last package.
        latest: newest package that the radio delivered, of each other node; see `LatestPackages`.
        rng: the agent's own random numbers, seeded by run and node: the same in every repetition of the run.
    """

    def __init__(self, ua: UaClient, config: Aircraft | GroundNode, transmit: Transmit) -> None:
        self.ua = ua
        self.config = config
        self.transmit_config = transmit
        self.waypoints: tuple[Waypoint, ...] = ()
        self.measurements_dbm: Sequence[float] = ()
        self._measured_dbm: deque[float] = deque(maxlen=PACKAGE_MEASUREMENTS_MAX)
        self.latest = LatestPackages(ua)
        self.rng = rng_of(ua.seed, ua.node)
        self._ticks = 0
        ua.on_packet(self.on_packet)
        ua.on_measurement(lambda measurement: self._measured_dbm.append(measurement.power_dbm))
        ua.on_measurement(self.on_measurement)

    @property
    def options(self) -> Mapping[str, Any]:
        """What the scenario gives to an agent of type ``own``."""
        config = self.config.agent
        return config.options if isinstance(config, OwnAgent) else {}

    async def fly(self) -> None:
        """What the agent does, once; the run is over when every agent is back from here."""

    async def sleep(self, duration_s: float) -> None:
        """Wait ``duration_s`` of sim time; it ends with a tick, the first that is not earlier."""
        await asyncio.sleep(duration_s)

    async def sleep_until(self, sim_time_s: float) -> None:
        """Wait for the first tick that is not earlier than ``sim_time_s``."""
        await asyncio.sleep(sim_time_s - self.ua.sim_time_ns / 1e9)

    async def every(self, period_s: float) -> AsyncIterator[float]:
        """Yield the sim time, s, now and then once per period, on the grid that begins now.

        A period shorter than a tick yields once per tick; what a slow body missed is not made up for.

        Raises:
            ValueError: the period is not above 0, or infinite.
        """
        if not 0.0 < period_s < math.inf:
            raise ValueError(f"every({period_s}): a period has to be above 0 s, and finite")
        begin_ns, period_ns = self.ua.sim_time_ns, max(SHORTEST_NS, period_s * 1e9)
        while True:
            yield self.ua.sim_time_ns / 1e9
            passed_ns = self.ua.sim_time_ns - begin_ns
            periods = int(passed_ns / period_ns)
            while (next_ns := round(periods * period_ns)) <= passed_ns:
                periods += 1
            await self.sleep_until((begin_ns + next_ns) / 1e9)

    @property
    def directory(self) -> Path:
        """A folder of its own in the run directory, for whatever it wants to keep."""
        return self.ua.files.folder

    def log(self, name: str, value: object) -> None:
        """Record ``value`` under ``name`` with the present sim time, as `UaClient.log`."""
        self.ua.log(name, value)

    def record(self, name: str, /, **fields: Any) -> None:
        """Append a line of JSON with sim time and ``fields`` to ``<name>.jsonl`` in the agent's own folder."""
        self.ua.files.write(name, self.ua.sim_time_ns, fields)

    def on_tick(self, sim_time_ns: int) -> None:
        """What the agent does at each tick of the fleet clock. It must not wait: the clock waits for it."""

    def transmit_package(self, sim_time_ns: int) -> None:
        """Transmit the data package when it is due; called at each tick, before `on_tick`."""
        if self._ticks % self.transmit_config.every_ticks == 0:
            self.ua.transmit(self.transmit_config.channel, self.package(sim_time_ns))
        self._ticks += 1

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:  # noqa: ARG002
        """What the agent does with a packet that the radio delivered; a DecodeError of it is counted as malformed."""
        if channel == self.transmit_config.channel:
            self.latest.take(sender, payload)

    def on_measurement(self, measurement: Measurement) -> None:
        """What the agent does with what its RF sensor measured; called before packets and `on_tick`."""

    def package(self, sim_time_ns: int) -> DataPackage:
        """The data package of Moon et al. 2020, Table II: the state without the ages of its fields.

        Each measurement of the node's sensor is in one package.
        """
        measured_dbm = tuple(self.measurements_dbm if len(self.measurements_dbm) else self._measured_dbm)
        self._measured_dbm.clear()
        return DataPackage(
            Header.at(sim_time_ns, self.ua.node),
            self.transmit_config.frequency_mhz,
            replace(self.ua.told, age_s=()),
            self.waypoints,
            measured_dbm,
        )

    async def take_off(self, alt_rel_m: float) -> AircraftState:
        """Wait until the autopilot can be armed and it is time, then arm and climb. Returns the state on the ground.

        The time is the scenario's ``take_off_at_s``.

        Raises:
            TypeError: ``alt_rel_m`` is no number.
            CommandFailed: the UA does not get there, or is not ready in time.
        """
        alt_rel_m = checked_numbers("take_off", alt_rel_m=alt_rel_m)["alt_rel_m"]
        self.ua.report("waits until the autopilot is ready to arm")
        home = await self._ready_to_arm(LONG_WAIT_S)
        if home is None:
            self.ua.report(f"still waits until the autopilot is ready to arm{self._why()}")
            home = await self._ready_to_arm(READY_TIMEOUT_S - LONG_WAIT_S)
        if home is None:
            raise CommandFailed(
                f"UA {self.ua.node}: the autopilot was not ready to arm within {READY_TIMEOUT_S:g} s of sim time"
                f"{self._why()}; the log of its host has all that it said"
            )
        await self._time_to_take_off()
        self.ua.report(f"takes off to {alt_rel_m:g} m")
        await self.ua.set_mode("GUIDED")
        await self.ua.arm()
        await self.ua.takeoff(alt_rel_m)
        return home

    async def _ready_to_arm(self, within_s: float) -> AircraftState | None:
        try:
            return await self.ua.wait_for(lambda state: state.ready_to_arm, timeout_s=within_s)
        except TimeoutError:
            return None

    def _why(self) -> str:
        """What the autopilot last warned of, such as ``PreArm: Fences enabled, but none selected``."""
        return f": {self.ua.warning}" if self.ua.warning else ""

    async def _time_to_take_off(self) -> None:
        late_s = self.ua.sim_time_ns / 1e9 - self.ua.take_off_at_s
        if late_s < 0.0:
            self.ua.report(f"is ready, and takes off at {self.ua.take_off_at_s:g} s")
            await self.sleep_until(self.ua.take_off_at_s)
        elif self.ua.take_off_at_s:
            self.ua.report(f"was ready {late_s:.0f} s after take_off_at_s")


def rng_of(seed: int, node: str) -> np.random.Generator:
    """The random numbers of one node's agent: PCG64, seeded by the run's seed and the node."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=tuple(node.encode()))))
