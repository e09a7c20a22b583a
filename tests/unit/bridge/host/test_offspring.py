"""What agents start ends with the run, however it was started."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from bridge.record.events import PROCESS_LEFT, read_reports

LEFT_BEHIND = (
    "import os, time; os.fork() and os._exit(0); os.setsid(); print(os.getpid(), flush=True); time.sleep(60)"
)
DEAF = (
    "import signal, time; signal.signal(15, signal.SIG_IGN); print(os.getpid(), flush=True); time.sleep(60)"
)
WAYS = {
    "a child": "start('sleep', '60').pid",
    "in a session of its own": "start('sleep', '60', start_new_session=True).pid",
    "left behind by its parent": f"int(said_when_over(start(sys.executable, '-c', {LEFT_BEHIND!r}, stdout=-1)))",
    "deaf": f"int(said(start(sys.executable, '-c', 'import os; ' + {DEAF!r}, stdout=-1)))",
}
SCRIPT = """\
import json, os, subprocess, sys
from pathlib import Path
from bridge.host.offspring import Offspring
from bridge.record.events import Report

def start(*command, **options):
    return subprocess.Popen(command, **options)

def said(process):
    return process.stdout.readline()

def said_when_over(process):
    process.wait()
    return said(process)

before = start("sleep", "60")
offspring = Offspring(Report(Path(sys.argv[1]), "fleet"))
start("true").wait()
over = start("true")  # which nobody waits for, as what has ended
os.waitid(os.P_PID, over.pid, os.WEXITED | os.WNOWAIT)
pids = [before.pid, {way}]
offspring.end()
print(json.dumps(pids))
before.kill()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives a process what others have left behind")
@pytest.mark.parametrize(
    "way",
    [
        pytest.param(way, id=name, marks=[] if name == "deaf" else pytest.mark.slow)
        for name, way in WAYS.items()
    ],
)
def test_what_agents_start_is_ended_and_told(tmp_path: Path, way: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.replace("{way}", way), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    _, pid = json.loads(done.stdout.splitlines()[-1])
    assert not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    [event] = read_reports(tmp_path).events
    assert event.kind == PROCESS_LEFT
    assert event.text.startswith("a process that an agent had started was ended with the run: ")
    assert event.text.endswith(f" (pid {pid})")


@pytest.mark.slow
def test_what_multiprocessing_starts_by_itself_is_left_to_it(tmp_path: Path) -> None:
    """Killed, it would leave shared memory behind."""
    way = "(lambda tracker: (tracker.ensure_running(), tracker._pid)[1])(resource_tracker._resource_tracker)"
    script = "from multiprocessing import resource_tracker\n" + SCRIPT.replace("{way}", way)
    script = script.replace(
        "print(json.dumps(pids))", "print(json.dumps([*pids, os.waitpid(pids[1], os.WNOHANG)[0]]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    _, pid, ended = json.loads(done.stdout)
    assert pid
    assert not ended
    assert read_reports(tmp_path).events == ()
