"""Runs one agent in sim time, in a thread of its own: a slow one holds up sim time, but nothing else of its process.

The thread's event loop is a `SimLoop`. Each tick brings what arrived since the last one, in an order that the host
fixes; the tick is over when nothing in the loop is ready to run, and then the thread sleeps until the next.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import queue
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any, NamedTuple

from bridge.agents.agent import Agent
from bridge.agents.client import UaClient
from bridge.agents.commands import CommandFailed
from bridge.agents.running.feed import Arrival, Feeder
from bridge.agents.running.sim_loop import SimLoop
from bridge.agents.running.unawaited import told_of_unawaited
from bridge.agents.running.whereabouts import whereabouts
from bridge.timeouts import BLOCKED_S

log = logging.getLogger("agent")

OUTCOMES = (CommandFailed, TimeoutError)
"""What a task of an agent may end with though nothing is wrong with the code."""


@dataclass(frozen=True, slots=True)
class _Tick:
    sim_time_ns: int
    arrivals: Sequence[Arrival]


class _Work(NamedTuple):
    """What an agent is at.

    Attributes:
        since_s: wall time at which it was given to it.
        sim_time_ns: of the tick; None: its constructor.
    """

    since_s: float
    sim_time_ns: int | None

    def __str__(self) -> str:
        return (
            "its constructor" if self.sim_time_ns is None else f"the tick at {self.sim_time_ns / 1e9:.2f} s"
        )


class AgentRunner:
    """One agent in its thread.

    Args:
        ua: the node as the agent sees it.
        build: makes the agent, in its thread and event loop; what it raises is reported at the first tick.
        on_idle: called in the agent's thread when it has done all that it does at a tick.
        on_warning: called in the agent's thread with what its author should know.
    """

    def __init__(
        self,
        ua: UaClient,
        build: Callable[[UaClient], Agent],
        on_idle: Callable[[], object],
        on_warning: Callable[[str], object],
    ) -> None:
        self.ua = ua
        self._build = build
        self._on_idle, self._on_warning = on_idle, on_warning
        self._inbox: queue.SimpleQueue[_Tick | None] = queue.SimpleQueue()
        self._built: concurrent.futures.Future[None] = concurrent.futures.Future()
        self._busy = False
        self._work: _Work | None = None
        """What it is at; None: it waits for a tick, or has been told of."""
        self._late = ""
        """What is to be told of work that is done: code that holds the interpreter's lock keeps others from looking."""
        self._feeder = Feeder(ua, BaseException)
        self._stopping = False
        self._loop = SimLoop(self._wait)
        self._flight: asyncio.Task[None] | None = None
        self._unbuilt: BaseException | None = None
        # A daemon: code that never returns from a tick must not keep the process from ending.
        self._thread = threading.Thread(target=self._run, name=f"agent-{ua.node}", daemon=True)

    def start(self) -> concurrent.futures.Future[None]:
        """Build the agent; the future is done when it waits for its first tick."""
        self._work = _Work(monotonic(), None)
        self._thread.start()
        return self._built

    def tick(self, sim_time_ns: int, arrivals: Sequence[Arrival]) -> None:
        """Have the agent live through the tick ``sim_time_ns``; `on_idle` is called when it has."""
        self._work = _Work(monotonic(), sim_time_ns)
        self._inbox.put(_Tick(sim_time_ns, arrivals))

    def blocked(self, now_s: float) -> str:
        """What to tell of an agent that is at work on a tick, or in its constructor, for long, or was; "" if none is.

        Once for each tick, and with the line that it is at if one of the looks within `BLOCKED_S` more finds it.

        Args:
            now_s: wall time, as `time.monotonic` has it.
        """
        late, self._late = self._late, ""
        work = self._work
        if late or work is None or now_s - work.since_s < BLOCKED_S:
            return late
        place = whereabouts(self._thread.ident, self._loop.ready_coroutines())
        if not place and now_s - work.since_s < 2 * BLOCKED_S:
            return ""  # it goes from one of its lines to another: the next look may find it in one
        self._work = None
        where = f", in {place}" if place else ""
        return f"{work} takes more than {BLOCKED_S:g} s of wall time{where}; the run waits for it"

    def ask_to_stop(self) -> None:
        """Have the agent end; what it still transmits or commands on its way out has no effect."""
        self.ua.is_over = True
        self._inbox.put(None)

    def join(self, timeout_s: float) -> bool:
        """Wait for the agent's end (wall time); returns whether it has come."""
        self._thread.join(max(0.0, timeout_s))
        return not self._thread.is_alive()

    # In the agent's thread.

    def _run(self) -> None:
        try:
            with told_of_unawaited(self._tell), asyncio.Runner(loop_factory=lambda: self._loop) as runner:
                try:
                    runner.run(self._live())
                except BaseException as error:  # told before the tasks are, which the runner then cancels
                    self._fail_in_thread(error)
        except BaseException as error:  # SystemExit, too: whatever ends this thread leaves a tick open
            self._fail_in_thread(error)
        finally:
            if self._busy:
                self._on_idle()
            self.ua.files.close()  # all of its tasks have ended

    def _fail_in_thread(self, error: BaseException) -> None:
        if not self._stopping:
            self._feeder.fail("in its thread", error)

    def _tell(self, text: str) -> None:
        if not self.ua.is_over:  # on its way out an agent leaves what it had no time for
            log.warning("%s", text)
            self._on_warning(text)

    async def _live(self) -> None:
        self._stopped = asyncio.Event()
        self._loop.set_exception_handler(self._on_loop_error)
        try:
            self._agent = self._build(self.ua)
            self.ua.on_tick(self._agent.transmit_package)
            self.ua.on_tick(self._agent.on_tick)
        except BaseException as error:  # somebody's own code: sys.exit, too
            self._unbuilt = error
        self._built.set_result(None)
        await self._stopped.wait()
        if self._flight is not None:
            self._flight.cancel()
        self.ua.report("is stopped")

    async def _fly(self) -> None:
        try:
            await self._agent.fly()
        except asyncio.CancelledError as error:
            if not self.ua.is_over and not self._feeder.has_failed:  # else what failed is why it is cancelled
                self._feeder.fail("in flight", error, "it awaited what had been cancelled")
            raise
        except Exception as error:  # an agent is somebody's own code: whatever it raises ends the run by name
            self._feeder.fail_in_flight(error)
        else:
            log.info("done at %.2f s", self.ua.sim_time_ns / 1e9)
            self.ua.report("is done", done=True)

    def _wait(self) -> None:
        """Nothing in the loop is ready: the tick is done. Returns with the next one."""
        work, self._work = self._work, None
        if work is not None and (took_s := monotonic() - work.since_s) >= BLOCKED_S:
            self._late = f"{work} took {took_s:.0f} s of wall time; the run waited for it"
        if self._busy:
            self._look_at_tasks()
            self._busy = False
            self._on_idle()
        item = self._inbox.get()
        if item is None:
            self._end()
            return
        self._busy = True
        self._loop.advance(item.sim_time_ns)
        self._loop.call_soon(self._take, item)

    def _look_at_tasks(self) -> None:
        """Fail for a task that has raised while nobody awaited it: in this tick, not when asyncio comes to collect it.

        Outcomes that code may want to look at later are kept until `fly` has returned.
        """
        over = self._flight is None or self._flight.done()
        for task in self._loop.take_raised():
            if isinstance(task._exception, OUTCOMES) and not over:
                self._loop.keep_raised(task)
            else:
                self._feeder.fail("in a task of its own", task.exception())

    def _end(self) -> None:
        if self._stopping or not self._built.done():
            self._loop.stop()  # what it does on its way out waits for sim time that never comes
            return
        self._stopping = True
        self._inbox.put(None)
        self._loop.call_soon(self._stopped.set)

    def _take(self, tick: _Tick) -> None:
        if self._unbuilt is not None:
            self._feeder.fail_unbuilt(tick.sim_time_ns, self._unbuilt)
            return
        self._feeder.tick(tick.sim_time_ns, tick.arrivals)
        if self._flight is None:  # the first tick: there is no sim time before it
            self._flight = asyncio.create_task(self._fly())

    def _on_loop_error(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        self._feeder.fail("in a task of its own", context.get("exception"), context["message"])
