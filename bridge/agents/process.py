"""The process of one UA's agent: nothing but its own node's keys is visible from here."""

from __future__ import annotations

import asyncio
import logging
import sys

from bridge.agents import Agent, agent_class
from bridge.agents.client import CommandFailed, UaClient
from bridge.bus.session import open_client
from bridge.run.directory import RunDirectory
from bridge.run.process import parse_arguments, run_until_stopped

log = logging.getLogger("agent")


async def run_agent(run: RunDirectory, node: str, stop: asyncio.Event) -> None:
    """Fly and transmit until ``stop`` is set."""
    scenario, keys = run.scenario, run.keys
    aircraft = scenario.aircraft(node)
    with open_client(run.info.endpoint) as session:
        ua = UaClient(session, keys, node, is_agent=True)
        agent = agent_class(aircraft.agent)(ua, aircraft, scenario.transmit)
        asyncio.get_running_loop().set_exception_handler(
            lambda _, context: _fail(
                agent, "in a task of its own", context.get("exception"), context["message"]
            )
        )
        ua.on_error = lambda error: _fail(agent, "in a callback", error)
        ua.on_tick(lambda sim_time_ns: _tick(agent, sim_time_ns))
        session.declare_alive(keys.alive(f"agent-{node}"))
        flight = asyncio.create_task(_fly(agent))
        stopped = asyncio.create_task(stop.wait())
        await asyncio.wait({flight, stopped}, return_when=asyncio.FIRST_COMPLETED)
        await stop.wait()
        flight.cancel()
        ua.report("is stopped")


def _tick(agent: Agent, sim_time_ns: int) -> None:
    try:
        agent.on_tick(sim_time_ns)
    except Exception as error:  # an agent is somebody's own code: whatever it raises ends the run by name
        _fail(agent, "at a tick", error)
    agent.ua.answer_tick(sim_time_ns)


def _fail(agent: Agent, when: str, error: BaseException | None, text: str = "") -> None:
    log.error("%s, at %.3f s: %s", when, agent.ua.sim_time_ns / 1e9, text, exc_info=error)
    agent.ua.report(f"{type(error).__name__} {when}: {error or text}", failed=True)


async def _fly(agent: Agent) -> None:
    try:
        await agent.fly()
    except CommandFailed as error:
        log.error("%s", error)
        agent.ua.report(str(error), failed=True)
    except Exception as error:
        _fail(agent, "in flight", error)
    else:
        log.info("done at %.2f s", agent.ua.sim_time_ns / 1e9)
        agent.ua.report("is done", done=True)


def main() -> int:
    """Run the process."""
    run, node = parse_arguments("agent", __doc__ or "", per_ua=True)
    return run_until_stopped(lambda stop: run_agent(run, node, stop))


if __name__ == "__main__":
    sys.exit(main())
