"""Lanes that are left end what still flies on them."""

from __future__ import annotations

import asyncio
import fcntl
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from time import monotonic
from typing import Any

import psutil
import pytest

from lostlink import fly_study
from lostlink.study.lanes import DaskLanes, Lanes, LocalLanes, fly_here
from lostlink.study.model import StudyError


@pytest.fixture
def waiting(tmp_path: Path) -> Iterator[Path]:
    """The directory of a case whose process waits for another that has it, for ever."""
    case = tmp_path / "case"
    case.mkdir()
    with (tmp_path / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        (case / "lock").hardlink_to(tmp_path / "lock")
        yield case


def _processes(case: Path) -> list[psutil.Process]:
    """Those that fly it: they work in its directory."""
    return [each for each in psutil.Process().children(recursive=True) if _works_in(each, case)]


def _works_in(process: psutil.Process, folder: Path) -> bool:
    try:
        return process.cwd() == str(folder)
    except psutil.Error:  # it has just ended
        return False


def _is_worker(process: psutil.Process) -> bool:
    try:
        return "lostlink.study.case_process" in process.cmdline()
    except psutil.Error:
        return False


def _leave(lanes: Lanes, case: Path) -> list[psutil.Process]:
    """Leave lanes while a case flies; gives its processes that have not ended."""
    with lanes:
        started = next(found for _ in lanes.fly([case]) if (found := _processes(case)))
    return psutil.wait_procs(started, timeout=30)[1]


def test_on_this_machine(waiting: Path) -> None:
    assert not _leave(LocalLanes(1), waiting)


@pytest.mark.slow
def test_a_worker_that_is_killed_while_it_has_no_case_costs_none(tmp_path: Path) -> None:
    cases = [tmp_path / name for name in ("one", "two")]
    with LocalLanes(1) as lanes:
        for case in cases:
            case.mkdir()
            assert [over for over in lanes.fly([case]) if over] == [case]
            assert "plan.json" in (case / "log.txt").read_text()  # it was begun, and has none
            for worker in psutil.Process().children():
                if _is_worker(worker):
                    worker.kill()
                    psutil.wait_procs([worker])


@pytest.mark.slow
def test_on_a_dask_cluster(waiting: Path) -> None:
    distributed: Any = pytest.importorskip("distributed")
    with closing(
        distributed.LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
        )
    ) as cluster:
        assert not _leave(DaskLanes(cluster.scheduler_address), waiting)


@pytest.mark.slow
def test_a_case_whose_workers_are_killed_is_over(waiting: Path) -> None:
    """As by a machine that has no memory left: the others go on."""
    distributed: Any = pytest.importorskip("distributed")
    dask: Any = pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        closing(
            distributed.LocalCluster(
                n_workers=1,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
            )
        ) as cluster,
        DaskLanes(cluster.scheduler_address) as lanes,
    ):
        over = lanes.fly([waiting])
        assert next(found for _ in over if (found := _processes(waiting)))
        (worker,) = cluster.workers.values()
        psutil.Process(worker.pid).kill()
        assert next(case for case in over if case is not None) == waiting


@pytest.mark.slow
def test_a_scheduler_that_is_lost_is_told(waiting: Path) -> None:
    distributed: Any = pytest.importorskip("distributed")
    with (
        closing(
            distributed.LocalCluster(
                n_workers=1,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
            )
        ) as cluster,
        DaskLanes(cluster.scheduler_address) as lanes,
    ):
        over = lanes.fly([waiting, waiting.with_name("next")])
        assert next(found for _ in over if (found := _processes(waiting)))
        address = cluster.scheduler_address
        cluster.close()
        with pytest.raises(
            StudyError, match=f"^the Dask scheduler at {address} is lost, with what it had to fly$"
        ):
            list(over)


@pytest.mark.slow
def test_a_worker_that_is_frozen_keeps_nobody_from_leaving(
    waiting: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed: Any = pytest.importorskip("distributed")
    with closing(
        distributed.LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
        )
    ) as cluster:
        with DaskLanes(cluster.scheduler_address) as lanes:
            started = next(found for _ in lanes.fly([waiting]) if (found := _processes(waiting)))
            (worker,) = cluster.workers.values()
            frozen = psutil.Process(worker.pid)
            frozen.suspend()
            monkeypatch.setattr("lostlink.study.lanes.DASK_PATIENCE_S", 0.5)
            left_s = monotonic()
        left_s = monotonic() - left_s
        frozen.resume()
        assert not psutil.wait_procs(started, timeout=30)[1]  # its flight ends when it thaws
    assert left_s < 20


def test_a_worker_that_does_not_see_the_study_says_so(tmp_path: Path) -> None:
    with pytest.raises(
        StudyError, match=r"/gone is not there on .+: workers have to see the study's directory"
    ):
        fly_here("client", str(tmp_path / "gone"))


@pytest.mark.slow
def test_a_scheduler_is_met_from_a_notebook() -> None:
    """Which has an event loop in its thread."""
    pytest.importorskip("distributed")

    async def cell() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(StudyError, match=f"^no Dask scheduler answers at {address}: "):
            DaskLanes(address)

    asyncio.run(cell())


@pytest.mark.parametrize("lanes", [0, -1])
def test_fewer_lanes_than_one_are_refused(lanes: int) -> None:
    with pytest.raises(ValueError, match=f"^lanes: has to be 1 or more, not {lanes}$"):
        LocalLanes(lanes)


@pytest.mark.parametrize("lanes", ["2", 2.0, "tcp://10.0.0.1:8786"])
def test_lanes_that_are_no_number_are_refused(lanes: Any, tmp_path: Path) -> None:
    study = {"schema": 1, "name": "mine", "scenario": "separation", "seeds": [1]}
    with pytest.raises(TypeError, match=f"^lanes: has to be a whole number, not {lanes!r}$"):
        fly_study(study, directory=tmp_path, lanes=lanes)
