"""Processes of a run end with their parent, and have the time that they need."""

from __future__ import annotations

import ast
import asyncio
import logging
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from bridge.fleet.children.child import LEASH, Child, ProcessSpec, end_all, end_with_news
from bridge.fleet.children.last_words import last_words
from bridge.run.process import LogForm

ROOT = Path(__file__).parents[5]


STARTERS = ["bridge/fleet/children/child.py", "fdm/module_process.py", "lostlink/attach/program.py"]
"""fdm knows nothing of bridge, and its processes want neither log nor leash: each ends with its connection. What a user
attaches has the user's environment and terminal, and its leash from the program that makes its namespace."""


FORKERS = ["bridge/fleet/children/forked.py", "lostlink/attach/namespace.py"]
"""A namespace is of the process that enters it, and of its children."""


def callers(*names: str) -> list[str]:
    """The files of the product that call one of these functions."""
    found = {
        str(file.relative_to(ROOT))
        for package in ("aps", "bridge", "channel", "fdm", "lostlink", "standin")
        for file in sorted((ROOT / package).rglob("*.py"))
        if any(name in (text := file.read_text(encoding="utf-8")) for name in names)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(names)
    }
    return sorted(found)


def test_processes_are_started_in_one_way() -> None:
    """Never with `preexec_fn`: it deadlocks now and then in a process with threads (documentation of subprocess)."""
    assert callers("Popen", "subprocess_exec", "subprocess_shell") == STARTERS
    assert callers("os.fork") == FORKERS
    for starter in STARTERS:
        assert "preexec_fn=" not in (ROOT / starter).read_text(encoding="utf-8")


@pytest.mark.skipif(sys.platform != "linux", reason="other kernels do not end a child with its parent")
def test_a_child_ends_with_its_parent_however_that_ends(tmp_path: Path) -> None:
    parent = textwrap.dedent(
        f"""
        import asyncio, os, signal, sys
        from pathlib import Path
        from bridge.fleet.children.child import Child, ProcessSpec
        async def main():
            command = [sys.executable, "-c", "import time; print('up', flush=True); time.sleep(600)"]
            child = Child(ProcessSpec("c", command, Path({str(tmp_path / "log")!r})))
            while "up" not in Path({str(tmp_path / "log")!r}).read_text():
                await asyncio.sleep(0.01)
            print(child.pid, flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
        asyncio.run(main())
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", parent], capture_output=True, text=True, cwd=ROOT, timeout=60
    )
    assert done.returncode == -9, done.stderr
    try:
        psutil.Process(int(done.stdout)).wait(10.0)
    except psutil.NoSuchProcess:
        return


def test_the_leash_ends_at_once_when_the_parent_is_gone_already() -> None:
    command = [sys.executable, str(LEASH), str(os.getpid() + 1), sys.executable, "-c", "print('never')"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("", 1)
    assert "is gone" in done.stderr


async def test_what_cannot_be_started_is_told_in_the_log(tmp_path: Path) -> None:
    child = Child(ProcessSpec("c", [str(tmp_path / "nothing")], tmp_path / "log"))
    await asyncio.wait_for(child.ended, 20.0)
    assert child.how_it_ended == "ended with status 1"
    assert f"{tmp_path}/nothing: No such file" in child.last_words()


LATE = (
    "import signal, sys, time; signal.signal(15, lambda *_: None); print('up', flush=True); time.sleep(2.5)"
)


async def started(tmp_path: Path) -> Child:
    """A process that goes on for a while after it was asked to end."""
    log = tmp_path / "log"
    child = Child(ProcessSpec("router", [sys.executable, "-c", LATE], log))
    while "up" not in log.read_text():  # noqa: ASYNC110 - nothing tells of it  # noqa: ASYNC110 - a file has no event
        await asyncio.sleep(0.01)
    return child


async def test_a_process_that_gets_on_is_waited_for(tmp_path: Path) -> None:
    child, news = await started(tmp_path), asyncio.Event()

    async def tell() -> None:
        while True:
            news.set()
            await asyncio.sleep(0.1)

    telling = asyncio.create_task(tell())
    assert await end_with_news(child, news, 1.0) == []
    assert child.how_it_ended == "ended with status 0"
    telling.cancel()


async def test_a_process_that_says_nothing_is_killed(tmp_path: Path) -> None:
    child = await started(tmp_path)
    assert await end_with_news(child, asyncio.Event(), 0.5) == ["router"]
    assert child.how_it_ended == "was ended by SIGKILL"


async def test_what_is_killed_leaves_nothing_that_it_has_started(tmp_path: Path) -> None:
    program = (
        "import subprocess, time; subprocess.Popen(['sleep', '60']); print('up', flush=True); time.sleep(60)"
    )
    log = tmp_path / "starts.log"
    child = Child(ProcessSpec("starts", [sys.executable, "-c", program], log))
    while "up" not in log.read_text():  # noqa: ASYNC110 - nothing tells of it  # noqa: ASYNC110 - a file has no event
        await asyncio.sleep(0.01)
    [started_by_it] = psutil.Process(child.pid).children()
    child.kill()
    await child.ended
    until = time.monotonic() + 5.0
    while started_by_it.is_running() and started_by_it.status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < until


async def test_the_exit_status_is_the_childs_however_often_it_is_asked_to_end(tmp_path: Path) -> None:
    """A signal that meets the child's end must not take the status from whoever waits for it."""
    command = [sys.executable, "-I", "-S", "-c", "import sys; sys.exit(7)"]
    ends = []
    for delay_s in np.linspace(0.01, 0.1, 40).tolist():
        child = Child(ProcessSpec("c", command, tmp_path / "log", stop_signal=signal.SIGCONT))
        await asyncio.sleep(delay_s)
        while not child.ended.done():
            child.ask_to_end()
            await asyncio.sleep(0.0)
        ends.append(child.how_it_ended)
    assert ends == ["ended with status 7"] * 40


async def test_the_end_of_a_log_of_any_size_is_told(tmp_path: Path) -> None:
    log, end = tmp_path / "talks.log", "the last\nwords"
    talk = f"import os; os.truncate(1, 1 << 40); os.lseek(1, 0, 2); print({end!r})"
    child = Child(ProcessSpec("talks", [sys.executable, "-c", talk], log))
    await child.ended
    assert log.stat().st_size == (1 << 40) + len(end) + 1
    assert child.last_words(1) == "words"
    assert child.last_words().endswith(end)


AT = "2026-11-26 11:26:47,344 12.050s"
KILLED = f"""\
{AT} WARNING host: late by 0.2 s
{AT} INFO host: MAVLink of UA 0
"""
RAISED = f"""\
{AT} INFO host: MAVLink of UA 0
Traceback (most recent call last):
  File "a.py", line 1, in <module>
    agent()
ValueError: no such place
"""
LOGGED = f"""\
{AT} ERROR agent: failed
Traceback (most recent call last):
  File "a.py", line 1, in <module>
ValueError: no such place
{AT} INFO host: goes on
"""


@pytest.mark.parametrize(
    ("log", "words"),
    [
        (f"{AT} INFO host: MAVLink of UA 0\n", ""),
        (KILLED, f"{AT} WARNING host: late by 0.2 s"),
        (RAISED, "ValueError: no such place"),
        (RAISED.partition("\n")[2], "ValueError: no such place"),
        (LOGGED, f"{AT} ERROR agent: failed\nValueError: no such place"),
        (f"{KILLED}terminate called\n  what(): no memory\n", "terminate called\n  what(): no memory"),
        (f"{AT} ERROR lostlink: a\nb\n", f"{AT} ERROR lostlink: a\nb"),
        ("1\n2\n3\n4\n5\nPANIC\n", "2\n3\n4\n5\nPANIC"),
        ("", ""),
    ],
)
def test_what_a_log_says_last_is_what_went_wrong_and_nothing_else(log: str, words: str) -> None:
    assert last_words(log) == words


def test_our_logs_have_the_form_that_is_looked_for() -> None:
    for level, word in ((logging.WARNING, "late"), (logging.INFO, "")):
        line = LogForm().format(logging.LogRecord("host", level, "", 0, "late", None, None))
        assert last_words(line) == (line if word else "")


STUCK = """\
import faulthandler, signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
if {registers}:
    faulthandler.register(signal.SIGUSR1, file=2)
def stuck():
    print("up", flush=True)
    time.sleep(600)
while True:
    stuck()
"""


@pytest.mark.skipif(
    sys.platform != "linux", reason="whether a process would write its stacks is asked of Linux"
)
@pytest.mark.parametrize("registers", [True, False])
async def test_one_that_is_killed_has_written_what_it_was_at(tmp_path: Path, registers: bool) -> None:
    """Another one is not ended by the question: it may have children that are to be killed with it."""
    log = tmp_path / "log"
    child = Child(ProcessSpec("stuck", [sys.executable, "-c", STUCK.format(registers=registers)], log))
    while "up" not in log.read_text():  # noqa: ASYNC110 - nothing tells of it
        await asyncio.sleep(0.01)
    assert await end_all([child], 0.0) == ["stuck"]
    assert child.how_it_ended == "was ended by SIGKILL"
    assert ('File "<string>", line 7 in stuck\n' in log.read_text()) == registers
