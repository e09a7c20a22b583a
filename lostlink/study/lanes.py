"""Where the runs of a study are flown: several at a time on this machine, or on a Dask cluster."""

from __future__ import annotations

import asyncio
import logging
import platform
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from numbers import Integral
from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

from bridge.fleet.children.child import start_process
from bridge.fleet.own_thread import begun
from bridge.timeouts import NEWS_PERIOD_S
from fdm.exchange.settings import core_count
from lostlink.study.model import StudyError

DASK_PATIENCE_S = 10
"""A scheduler has so long to answer, wall time; Dask tries again also where nobody listens, for it may only begin."""


@runtime_checkable
class Lanes(Protocol):
    """Flies cases; left, it ends those that still fly."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def fly(self, cases: Sequence[Path]) -> Iterator[Path | None]:
        """Fly the cases of these directories; gives each when it is over, and None now and then in between."""


class _Worker:
    """A process that flies cases one after the other, each forked from it (`lostlink.study.case_process`)."""

    def __init__(self) -> None:
        self._process = start_process([sys.executable, "-P", "-m", "lostlink.study.case_process"])

    @property
    def is_there(self) -> bool:
        """Whether it has not ended, as one that somebody kills."""
        return self._process.poll() is None

    def fly(self, case: Path) -> bool:
        """Fly a case, and wait for it; returns whether the worker is of further use."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(f"{case}\n".encode())
            self._process.stdin.flush()
        except BrokenPipeError:
            return False
        return bool(self._process.stdout.readline())

    def end_case(self) -> None:
        """Ask the case that flies to end."""
        self._process.send_signal(signal.SIGTERM)

    def close(self) -> None:
        """End it: it has no case any more."""
        with suppress(BrokenPipeError), self._process:  # which closes its pipes and waits
            return


class _Flights:
    """Flies cases in workers, as many as are asked for at a time, until it is asked to end them."""

    def __init__(self) -> None:
        self._flying: set[_Worker] = set()
        # Each thread has its own: the kernel ends a worker with the thread that started it.
        self._idle: dict[int, _Worker] = {}
        self._lock = threading.Lock()
        self._ended = False

    def fly(self, case: Path) -> None:
        """Fly a case, and wait for it; once all are ended, no more."""
        with self._lock:
            if self._ended:
                return
            worker = self._idle.pop(threading.get_ident(), None) or _Worker()
            if not worker.is_there:
                worker.close()
                worker = _Worker()
            self._flying.add(worker)
        is_of_use = False
        try:
            is_of_use = worker.fly(case)
        finally:
            with self._lock:
                self._flying.discard(worker)
                is_kept = is_of_use and not self._ended
                if is_kept:
                    self._idle[threading.get_ident()] = worker
            if not is_kept:
                worker.close()

    def end(self) -> None:
        """Ask those that fly to end, and start no others."""
        with self._lock:
            self._ended = True
            for worker in self._flying:
                worker.end_case()

    def close(self) -> None:
        """End the workers, which have nothing to fly any more."""
        with self._lock:
            idle, self._idle = list(self._idle.values()), {}
        for worker in idle:
            worker.close()


class LocalLanes:
    """So many at a time on this machine, each in a process of its own that ends with this one.

    Args:
        lanes: how many; one per core, at most 8, unless given.

    Raises:
        TypeError: no whole number.
        ValueError: fewer than one.
    """

    def __init__(self, lanes: int | None = None) -> None:
        if lanes is not None and not isinstance(lanes, Integral):
            raise TypeError(f"lanes: has to be a whole number, not {lanes!r}")
        if lanes is not None and lanes < 1:
            raise ValueError(f"lanes: has to be 1 or more, not {lanes}")
        self._pool = ThreadPoolExecutor(lanes or min(8, core_count()), thread_name_prefix="lane")
        self._flights = _Flights()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._flights.end()
        self._pool.shutdown(cancel_futures=True)
        self._flights.close()

    def fly(self, cases: Sequence[Path]) -> Iterator[Path | None]:
        """Fly the cases; see `Lanes.fly`."""
        futures = {self._pool.submit(self._flights.fly, case): case for case in cases}
        return _as_completed(futures)


class DaskLanes:
    """On the workers of a Dask cluster, which see the study's directory under the same path.

    Args:
        scheduler: its address, as ``tcp://10.0.0.1:8786``.

    Raises:
        StudyError: Dask is not installed, or the scheduler does not answer.
    """

    def __init__(self, scheduler: str) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            raise StudyError("--scheduler needs Dask: pip install 'lostlink[dask]'") from error
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what goes wrong is told in our words
        try:
            begun(lambda: asyncio.run(_meet(scheduler)), "meets Dask").result()  # a notebook has a loop here
            self._client: Any = Client(scheduler, set_as_default=False)
            self._scheduler = scheduler
        except (OSError, ValueError) as error:
            why = f"not within {DASK_PATIENCE_S} s" if isinstance(error, TimeoutError) else str(error)
            raise StudyError(f"no Dask scheduler answers at {scheduler}: {why}") from error

    @property
    def workers(self) -> int:
        """How many workers the cluster has now; others may join."""
        return len(self._client.nthreads())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._client.status == "running":  # workers that lose their scheduler end, with their flights
            with suppress(OSError, TimeoutError):  # one may be frozen, which the scheduler learns in minutes
                self._client.sync(
                    self._client._run,
                    end_here,
                    self._client.id,
                    on_error="ignore",
                    callback_timeout=DASK_PATIENCE_S,
                )
        self._client.close()

    def fly(self, cases: Sequence[Path]) -> Iterator[Path | None]:
        """Fly the cases; see `Lanes.fly`."""
        futures: dict[Future[Any], Path] = {}
        for case in cases:
            local: Future[Any] = Future()
            remote = self._client.submit(fly_here, self._client.id, str(case), pure=False, retries=1)
            remote.add_done_callback(_passing_to(local, self._scheduler))
            futures[local] = case
        return _as_completed(futures)


async def _meet(scheduler: str) -> None:
    """See that a scheduler answers: a client waits for ever where somebody listens and says nothing.

    Raises:
        TimeoutError, OSError, ValueError: it does not, or it is no address.
    """
    from distributed.comm.core import connect
    from distributed.security import Security

    async with asyncio.timeout(DASK_PATIENCE_S):
        comm = await connect(scheduler, **Security().get_connection_args("client"))
        await comm.close()


_here: dict[str, _Flights] = {}
"""On a worker of a cluster: the flights of each client."""


def fly_here(client: str, case: str) -> None:
    """Fly the case of a directory in a process of its own, and wait for it: what a worker of a cluster does.

    Raises:
        StudyError: the directory is not there.
    """
    if not Path(case).is_dir():
        raise StudyError(
            f"{case} is not there on {platform.node()}: workers have to see the study's directory under the same path"
        )
    _here.setdefault(client, _Flights()).fly(Path(case))


def end_here(client: str) -> None:
    """End what a client has flying on this worker."""
    flights = _here.setdefault(client, _Flights())
    flights.end()
    flights.close()


def _passing_to(local: Future[Any], scheduler: str) -> Callable[[Any], None]:
    from distributed import KilledWorker

    def done(remote: Any) -> None:
        if remote.status not in ("finished", "error"):
            local.set_exception(
                StudyError(f"the Dask scheduler at {scheduler} is lost, with what it had to fly")
            )
            return
        error = remote.exception() if remote.status == "error" else None
        if error is None or isinstance(error, KilledWorker):  # then it leaves no result
            local.set_result(None)
        else:
            what = str(error) if isinstance(error, StudyError) else f"{type(error).__name__}: {error}"
            local.set_exception(StudyError(f"a worker of the cluster cannot fly: {what}"))

    return done


def _as_completed(futures: dict[Future[Any], Path]) -> Iterator[Path | None]:
    open_ = set(futures)
    while open_:
        done, open_ = wait(open_, timeout=NEWS_PERIOD_S, return_when=FIRST_COMPLETED)
        for future in done:
            future.result()
            yield futures[future]
        if not done:
            yield None
