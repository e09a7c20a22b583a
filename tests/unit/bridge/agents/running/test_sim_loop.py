"""Coroutines in a SimLoop wait in sim time, and interleave the same way in every process."""

from __future__ import annotations

import asyncio
import gc
import math
import subprocess
import sys
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from bridge.agents.running.sim_loop import SimLoop, SimTimeError

TICK_NS = 50_000_000


def live(make: Callable[[SimLoop], Coroutine[Any, Any, Any]], ticks: int = 100) -> Any:
    """Run a coroutine through so many ticks of 50 ms; returns its result."""
    left = iter(range(1, ticks + 1))

    def wait() -> None:
        number = next(left, None)
        if number is None:
            loop.stop()
        else:
            loop.advance(number * TICK_NS)

    loop = SimLoop(wait)
    try:
        return loop.run_until_complete(make(loop))
    finally:
        loop.close()


def test_sleep_ends_with_the_first_tick_that_is_not_earlier() -> None:
    async def naps(loop: SimLoop) -> list[int]:
        woken = []
        for duration_s in (0.05, 0.01, 0.12, 1.0):
            await asyncio.sleep(duration_s)
            woken.append(loop.sim_time_ns // TICK_NS)
        return woken

    assert live(naps) == [1, 2, 5, 25]


@pytest.mark.parametrize(("late_ns", "tick"), [(0.0, 1), (0.4, 1), (0.6, 2), (1.0, 2), (1.1, 2)])
def test_a_timer_just_after_a_tick_is_due_with_one_tick_or_the_next(late_ns: float, tick: int) -> None:
    async def nap(loop: SimLoop) -> int:
        await asyncio.sleep(0.05 + late_ns * 1e-9)
        return loop.sim_time_ns // TICK_NS

    assert live(nap) == tick


def test_a_period_of_one_tick_never_misses_one() -> None:
    async def beat(loop: SimLoop) -> list[int]:
        beats = []
        for _ in range(2000):
            await asyncio.sleep(0.05)
            beats.append(loop.sim_time_ns // TICK_NS)
        return beats

    assert live(beat, ticks=2000) == list(range(1, 2001))


def test_a_wait_of_nan_seconds_is_a_mistake_and_disorders_no_other() -> None:
    async def wait(_loop: SimLoop) -> None:
        with pytest.raises(ValueError, match=r"(?i)nan"):  # asyncio says it itself from 3.13 on
            await asyncio.sleep(math.nan)

    live(wait)


def test_timeouts_of_asyncio_are_sim_time() -> None:
    async def wait(loop: SimLoop) -> tuple[float, float]:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.Event().wait(), 0.3)
        first = loop.time()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.2):
                await asyncio.Event().wait()
        return first, loop.time()

    first, second = live(wait)
    assert (first, second) == (pytest.approx(0.3), pytest.approx(0.5))


@pytest.mark.parametrize(
    "refused",
    [
        lambda: asyncio.to_thread(print),
        lambda: asyncio.open_connection("127.0.0.1", 1),
        lambda: asyncio.create_subprocess_exec("true"),
        lambda: asyncio.start_server(lambda r, w: None, "127.0.0.1", 0),
    ],
)
def test_what_answers_by_wall_time_is_refused(refused: Callable[[], Coroutine[Any, Any, Any]]) -> None:
    async def ask(_: SimLoop) -> None:
        await refused()

    with pytest.raises(SimTimeError, match="lives in sim time"):
        live(ask)


INTERLEAVING = """\
import asyncio
from bridge.agents.running.sim_loop import SimLoop

trace = []

async def worker(name):
    try:
        while True:
            await asyncio.sleep(0.05)
    finally:
        trace.append(name)

async def main():
    junk = [bytearray(n % 977) for n in range(3000)]  # so that addresses differ from process to process
    futures = {asyncio.get_running_loop().create_future() for _ in range(40)}
    for number, future in enumerate(futures):
        future.add_done_callback(lambda f, n=number: trace.append(n))
    workers = [asyncio.create_task(worker(f"w{n}")) for n in range(40)]
    done, pending = await asyncio.wait({asyncio.create_task(asyncio.sleep(0.01, n)) for n in range(40)})
    trace.extend(task.result() for task in done)
    for future in futures:
        future.set_result(None)
    try:
        async with asyncio.TaskGroup() as group:
            for n in range(40):
                group.create_task(worker(f"g{n}"))
            await asyncio.sleep(0.2)
            raise KeyError
    except* KeyError:
        pass
    for task in set(workers):
        task.cancel()
    await asyncio.wait(set(workers))

ticks = iter(range(1, 200))
loop = SimLoop(lambda: loop.advance(next(ticks) * 50_000_000))
loop.run_until_complete(main())
print(trace)
"""


@pytest.mark.slow
def test_sets_of_tasks_and_futures_have_one_order_in_every_process() -> None:
    traces = {
        subprocess.run(
            [sys.executable, "-c", f"filler = bytearray({size})\n{INTERLEAVING}"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for size in (1, 100_000, 5_000_000)
    }
    assert len(traces) == 1
    assert "'g39'" in traces.pop()


def test_tasks_are_named_by_their_own_loop_whatever_others_there_are() -> None:
    async def names(_: SimLoop) -> list[str]:
        first, named, last = (
            asyncio.create_task(asyncio.sleep(0.05), name=name) for name in (None, "mine", None)
        )
        await asyncio.wait([first, named, last])
        return [each.get_name() for each in (first, named, last)]

    assert live(names) == live(names) == ["Task-1", "mine", "Task-3"]


def test_a_task_that_nobody_refers_to_stays_until_it_is_done() -> None:
    async def left_alone(_: SimLoop) -> list[str]:
        ended: list[str] = []

        async def wait_for_nothing() -> None:
            try:
                await asyncio.get_running_loop().create_future()
            except asyncio.CancelledError:
                ended.append("cancelled")
            finally:
                ended.append("gone")

        asyncio.create_task(wait_for_nothing())  # noqa: RUF006
        asyncio.create_task(asyncio.sleep(0.1))  # noqa: RUF006
        await asyncio.sleep(0.2)
        gc.collect()
        await asyncio.sleep(0.2)
        [pending] = asyncio.all_tasks() - {asyncio.current_task()}
        pending.cancel()
        await asyncio.sleep(0.2)
        return ended

    assert live(left_alone) == ["cancelled", "gone"]
