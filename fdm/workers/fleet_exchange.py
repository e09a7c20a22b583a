"""A fleet spread over worker processes, with one fleet clock: the same as fdm.exchange.exchange.Exchange to its user.

Each worker is an exchange of its own for its share of the UA. What couples them:

- the window: every worker's clock sees how far the others are (fdm.clock.board: shared memory, and a wake when
  it matters);
- ticks: a worker's ticks are held; this process gives out the truth of a tick when all workers have reached it, and
  then releases it. That also makes them start together: the first tick is at time 0;
- pace, stalls and boots are each worker's own matter. Their clocks run on the same wall clock.
"""

from __future__ import annotations

import logging
import os
import selectors
import socket
import time
from collections.abc import Sequence
from typing import Unpack

from fdm.clock.board import Board, create_board
from fdm.clock.events import UaEvent
from fdm.clock.fleet_ticks import FleetTicks
from fdm.clock.pace import NEVER_NS
from fdm.clock.status import check_speed
from fdm.exchange.aircraft_spec import AircraftSpec
from fdm.exchange.called import CalledAutopilot
from fdm.exchange.command_queue import CommandQueue
from fdm.exchange.exchange import Exchange
from fdm.exchange.ports import bind
from fdm.exchange.settings import DEFAULTS, FOR_WORKERS, ExchangeSettings, Workers, check_settings, core_count
from fdm.workers.worker_messages import RUN, Ended, Happened, Reached, WorkerPlan
from fdm.workers.worker_process import WorkerProcess, end_all

END_TIMEOUT_S = 1.0
"""For all workers together, then they are killed: whoever ends this process may kill it soon, which a worker that is
stopped or stuck would outlive."""
UA_PER_WORKER = 16
"""What `auto` gives one process: at 800 Hz that is two thirds of a core (docs/explanation/performance.md)."""

_log = logging.getLogger(__name__)


class FleetExchange:
    """Serves autopilots in lockstep from several processes; arguments as of fdm.exchange.exchange.Exchange, and these.

    Args:
        workers: how many processes, at least 1 and at most one per UA.

    Raises:
        PortInUseError: a port is taken.
        AirframeError: a model cannot be loaded.
        WorkerError: a worker ended while it started.
        ValueError: no UA, an id twice, or a setting out of its range.
    """

    def __init__(
        self,
        aircraft: Sequence[AircraftSpec],
        *,
        workers: int,
        **settings: Unpack[ExchangeSettings],
    ) -> None:
        ids = [spec.ua_id for spec in aircraft]
        options: ExchangeSettings = {**DEFAULTS, **settings}
        check_settings(ids, workers, options)
        self._on_truth, self._on_tick = options["on_truth"], options["on_tick"]
        self._on_event = options["on_event"]
        self._speed, self._hold_ticks, self._paused = options["speed"], options["hold_ticks"], False
        self._emitted_ns = self._told_ns = self._released_ns = -1
        self._ticks = FleetTicks([ids[index::workers] for index in range(workers)], options["tick_period_ns"])
        self._counters: dict[int, dict[str, int]] = {ua_id: {"frames": 0} for ua_id in ids}
        self._commands = CommandQueue()
        self._stopping = False
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._commands, selectors.EVENT_READ, self._commands.drain)
        self._workers: list[WorkerProcess] = []
        try:
            self._start(aircraft, workers, options)
        except BaseException:
            self.close()
            raise

    @property
    def ports(self) -> dict[int, int]:
        """UDP port of each UA, by its id."""
        return dict(self._ports)

    @property
    def worker_pids(self) -> tuple[int, ...]:
        """Process ids of the workers."""
        return tuple(worker.pid for worker in self._workers)

    def counters(self, ua_id: int) -> dict[str, int]:
        """What UA `ua_id` received and did, up to the latest tick, and to the end after `run` has returned."""
        if ua_id not in self._counters:
            raise KeyError(f"no UA {ua_id}")
        return dict(self._counters[ua_id])

    def run(self) -> None:
        """Serve until `stop` is called. Errors of the callbacks end it and come out of it.

        Raises:
            WorkerError: a worker ended.
        """
        self._tell_all(*RUN)
        try:
            while not self._stopping:
                for key, _ in self._selector.select():
                    key.data()
                self._progress()
        finally:
            self._end_workers()

    def stop(self) -> None:
        """Let `run` return soon."""
        self._stopping = True
        self._commands.wake()

    def close(self) -> None:
        """End the workers and close all. Not while `run` runs. What others command from now on has no effect."""
        self._stopping = True
        self._end_workers()
        self._selector.close()
        self._commands.close()

    # Control, from any thread

    def release_tick(self, sim_time_ns: int) -> None:
        """With hold_ticks: UA may go on beyond the ticks up to `sim_time_ns`."""
        self._commands.put(lambda: self._release(sim_time_ns))

    def set_speed(self, speed: float) -> None:
        """Aim at `speed` of sim time per wall time (inf = as fast as possible).

        Raises:
            ValueError: out of its range (fdm.clock.status.SPEED_RANGE).
        """
        check_speed(speed)

        def command() -> None:
            self._speed = speed
            self._tell_all("set_speed", speed)

        self._commands.put(command)

    def pause(self) -> None:
        """Hold sim time; workers stop within a window of each other."""

        def command() -> None:
            self._paused = True
            self._tell_all("pause")

        self._commands.put(command)

    def resume(self) -> None:
        """End a pause."""

        def command() -> None:
            self._paused = False
            self._tell_all("resume")

        self._commands.put(command)

    def step(self, sim_ns: int) -> None:
        """While paused: let sim time go on by `sim_ns` ns.

        Raises:
            ValueError: not above 0.
        """
        if sim_ns <= 0:
            raise ValueError(f"step of {sim_ns} ns: must be above 0")
        self._commands.put(lambda: self._tell_all("step", sim_ns))

    # Inner workings

    def _start(
        self,
        aircraft: Sequence[AircraftSpec],
        workers: int,
        options: ExchangeSettings,
    ) -> None:
        settings = {name: value for name, value in options.items() if name in FOR_WORKERS}
        sockets: list[socket.socket] = []
        fds: list[int] = []
        try:
            for spec in aircraft:
                sockets.append(bind(spec, options["host"]))
            self._ports = {
                spec.ua_id: sock.getsockname()[1] for spec, sock in zip(aircraft, sockets, strict=True)
            }
            fds.append(create_board(workers))
            for _ in range(workers):
                fds += os.pipe()
            wake_fds = tuple(fds[2::2])
            for fd in wake_fds:
                os.set_blocking(fd, False)
            self._board = Board(fds[0], 0, wake_fds)  # only to read from
            for index in range(workers):
                share = slice(index, None, workers)
                socket_fds = tuple(sock.fileno() for sock in sockets[share])
                plan = WorkerPlan(
                    index, tuple(aircraft[share]), socket_fds, fds[0], fds[1 + 2 * index], wake_fds, settings
                )
                self._workers.append(WorkerProcess(plan))
        finally:
            for sock in sockets:
                sock.close()
            for fd in fds:
                os.close(fd)
        for index, worker in enumerate(self._workers):
            worker.receive()  # that it is ready
            self._selector.register(
                worker.control, selectors.EVENT_READ, lambda index=index: self._hear(index)
            )

    def _tell_all(self, *command: object) -> None:
        for worker in self._workers:
            worker.tell(command)

    def _hear(self, index: int) -> None:
        message = self._workers[index].receive()
        if isinstance(message, Reached):
            self._ticks.reached(index, message.sim_time_ns, message.truths)
        elif isinstance(message, Happened):
            self._happened(message.event)
        if isinstance(message, Reached | Ended):
            self._counters.update((ua_id, dict(counts)) for ua_id, counts in message.counters.items())

    def _happened(self, event: UaEvent) -> None:
        _log.info("UA %d %s: %s", event.ua_id, event.kind.value, event.detail)
        self._ticks.happened(event)
        if self._on_event is not None:
            self._on_event(event)

    def _progress(self) -> None:
        """Do what was commanded, and emit the ticks that are reached."""
        self._commands.obey()
        idle = [self._board.slowest_of(index) == NEVER_NS for index in range(len(self._workers))]
        while (due := self._ticks.take_due(idle)) is not None:
            tick_ns, truths = due
            if self._on_truth is not None:
                for truth in truths:
                    self._on_truth(truth)
            status = self._ticks.status(tick_ns, time.monotonic_ns(), self._speed, self._paused)
            if self._on_tick is not None:
                self._on_tick(status)
            self._emitted_ns = tick_ns
            self._tell_all("pass_ticks", tick_ns)
            self._release(-1 if self._hold_ticks else tick_ns)
            self._commands.obey()

    def _release(self, sim_time_ns: int) -> None:
        """Let the workers go beyond the latest tick if it is emitted and released."""
        self._released_ns = max(self._released_ns, sim_time_ns)
        if self._told_ns < self._emitted_ns <= self._released_ns:
            self._told_ns = self._emitted_ns
            self._tell_all("release_tick", self._emitted_ns)

    def _end_workers(self) -> None:
        for worker in self._workers:
            if worker.control in self._selector.get_map():
                self._selector.unregister(worker.control)
        self._counters.update(end_all(self._workers, END_TIMEOUT_S))
        self._workers.clear()


def worker_count(workers: Workers, ua: int) -> int:
    """How many worker processes to use for `ua` UA, never more than there are UA.

    With ``auto`` that is one per UA_PER_WORKER, but at most half of the cores: the autopilots need the others.

    Raises:
        ValueError: a number below 1.
    """
    if workers == "auto":
        return max(1, min(core_count() // 2, -(-ua // UA_PER_WORKER)))
    if workers < 1:
        raise ValueError(f"workers = {workers}: must be auto or at least 1")
    return min(workers, ua)


def open_exchange(
    aircraft: Sequence[AircraftSpec],
    *,
    workers: Workers = "auto",
    called: Sequence[CalledAutopilot] = (),
    **settings: Unpack[ExchangeSettings],
) -> Exchange | FleetExchange:
    """An exchange in this process, or spread over `workers` processes if that is more than one.

    Args:
        aircraft: the UA.
        workers: how many processes; one, if autopilots are `called`.
        called: see fdm.exchange.exchange.Exchange.
        settings: of the exchange.

    Raises:
        As fdm.exchange.exchange.Exchange and FleetExchange.
    """
    count = 1 if called else worker_count(workers, len(aircraft))
    if count > 1:
        return FleetExchange(aircraft, workers=count, **settings)
    return Exchange(aircraft, called=called, **settings)
