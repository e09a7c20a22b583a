"""How a run goes and why it ends, from what its parts say of it. No I/O and no clock."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

from bridge.bus.messages import AgentStatus, Clock, Header
from bridge.run.directory import RunDirectory
from bridge.scenario.agents import FreeAgent, OwnAgent
from bridge.scenario.model import Scenario


class FleetError(RuntimeError):
    """The run could not start or broke off; the text says which process and where its log is."""


class Ending(StrEnum):
    """Why a run ended."""

    DONE = "done"
    DURATION = "duration"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


class Course:
    """The course of one run.

    Args:
        scenario: what is flown.
        run: its directory, for the names of logs.

    Attributes:
        sim_time_ns: the latest tick.
        not_done: nodes whose agents have not flown what they were to fly: also one that was only to hold.
        ended: UA whose flight models diverged.
    """

    def __init__(self, scenario: Scenario, run: RunDirectory) -> None:
        self._scenario, self._run = scenario, run
        self.sim_time_ns = 0
        self._failures: dict[str, tuple[int, FleetError]] = {}
        """By node, with the sim time of its tick."""
        self.ended: set[str] = set()
        self.not_done = {
            node.node
            for node in scenario.transceivers
            if node.agent.has_task or not isinstance(node.agent, OwnAgent | FreeAgent)
        }

    @property
    def unfinished(self) -> frozenset[str]:
        """Nodes whose agents have a task and have not done it: what the run waits for."""
        return self._scenario.nodes_with_a_task & self.not_done

    @property
    def failure(self) -> FleetError | None:
        """An agent failed: the run ends with this, as soon as its tick is closed.

        Of several the earliest, and at one tick the first by the scenario: who is heard of first is a matter of chance.
        """
        if not self._failures:
            return None
        order = [node.node for node in self._scenario.transceivers]
        first = min(self._failures, key=lambda node: (self._failures[node][0], order.index(node)))
        return self._failures[first][1]

    def tick(self, clock: Clock) -> list[tuple[str, FleetError]]:
        """The clock has come to a tick; gives the UA whose models have diverged since, and what there is to say.

        The run cannot go on without one that has a task (`unfinished`).
        """
        self.sim_time_ns = clock.header.stamp.ns
        lost = sorted(set(clock.ended) - self.ended)
        self.ended.update(lost)
        return [(node, FleetError(self._diverged(node))) for node in lost]

    def _diverged(self, node: str) -> str:
        log = self._run.log_path("physics")
        where = log if log.exists() else self._run.log_path("fleet")
        return f"the flight model of UA {node} diverged; its last state is in {where}"

    def agent(self, node: str, status: AgentStatus) -> AgentStatus:
        """A node's agent says what it does; gives it with the name of the node, whatever it said itself."""
        if status.failed and node not in self._failures:
            log = self._run.log_path(f"node-{node}")
            where = f"; its log is {log}" if log.exists() else ""  # a program beside the run has its own
            title = self._scenario.title(node)
            error = FleetError(f"the agent of {title} failed: {status.activity}{where}")
            self._failures[node] = status.header.stamp.ns, error
        if status.done:
            self.not_done.discard(node)
        return replace(status, header=Header(status.header.stamp, node))

    def end(self) -> Ending | FleetError:
        """The last tick is closed; gives how the run ended."""
        all_done = self._scenario.nodes_with_a_task and not self.unfinished
        return self.failure or (Ending.DONE if all_done else Ending.DURATION)
