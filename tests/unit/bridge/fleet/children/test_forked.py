"""A fork that waits to be a process of a run; each in a process of its own that has one thread, as a command has."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

import psutil
import pytest

from bridge.fleet.children.environment import environment_of, has_environment, of_runs

ROOT = Path(__file__).parents[5]
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends a child with its parent")
BEGINNING = """\
import fcntl, json, os, signal, sys, threading
from pathlib import Path
from bridge.fleet.children.child import ProcessSpec
from bridge.fleet.children.forked import Understudy, can_fork
held = open(os.devnull)
def tell(words):
    with open(int(words[-1]), "w") as told:
        json.dump({
            "words": list(words), "session": os.getsid(0) == os.getpid(), "files": os.listdir("/proc/self/fd"),
            "environment": dict(os.environ), "input": sys.stdin.read(),
        }, told)
    print("played", flush=True)
    return 7
log = Path("log")
def spec(told):
    return ProcessSpec("c", ["python", "program", "--to", str(told)], log, pass_fds=(told,))
"""


def run(
    tmp_path: Path, code: str, flags: Sequence[str] = (), **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run code in the environment of a run."""
    found = f"import sys\nsys.path.insert(0, {str(ROOT)!r})\n"  # with -I, too
    return subprocess.run(
        [sys.executable, *flags, "-c", found + BEGINNING + textwrap.dedent(code)],
        env={**of_runs(os.environ), "PYTHONPATH": str(ROOT), **environment},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
    )


@pytest.mark.parametrize("least", [0, 5, 7, 40])
def test_it_plays_with_its_words_its_log_and_one_file(tmp_path: Path, least: int) -> None:
    """Whatever number the file has: in the fork it has the same, where others may have come first."""
    done = run(
        tmp_path,
        f"""
        understudy = Understudy(2, lambda: tell)
        reader, other = os.pipe()
        reader = fcntl.fcntl(reader, fcntl.F_DUPFD, 60)
        writer = fcntl.fcntl(other, fcntl.F_DUPFD, {least})
        os.close(other)
        with log.open("wb") as file:
            understudy.begin(spec(writer), file)
        os.close(writer)
        print(writer, open(reader).read())
        print(understudy.wait(), understudy.returncode)
        """,
        PX4_SIM_MODEL="/somewhere",
    )
    told, status = done.stdout.splitlines()
    number, _, rest = told.partition(" ")
    said = json.loads(rest)
    assert said["words"] == ["--to", number]
    assert said["session"]
    assert said["input"] == ""
    assert "PX4_SIM_MODEL" not in said["environment"]
    assert set(said["files"]) <= {"0", "1", "2", "3", "4", number}  # those of looking at them are two
    assert status == "7 7"
    assert (tmp_path / "log").read_text() == "played\n"


def test_it_has_the_name_of_its_process_and_needs_no_file(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
        def play(words):
            print(Path("/proc/self/comm").read_text().strip(), *words, sorted(os.listdir("/proc/self/fd")))
            return 0
        understudy = Understudy(2, lambda: play)
        with log.open("wb") as file:
            understudy.begin(ProcessSpec("host-0", ["python", "program", "--nodes", "0,1"], log), file)
        understudy.wait()
        """,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "log").read_text() == "host-0 --nodes 0,1 ['0', '1', '2', '3']\n"


def test_what_it_raises_is_in_its_log(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
        def fail(words):
            raise ArithmeticError("a mistake")
        understudy = Understudy(2, lambda: fail)
        with log.open("wb") as file:
            understudy.begin(spec(file.fileno()), file)
        print(understudy.wait())
        """,
    )
    assert done.stdout == "1\n", done.stderr
    assert "ArithmeticError: a mistake" in (tmp_path / "log").read_text()


def test_dismissed_it_ends(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
        understudy = Understudy(2, lambda: tell)
        understudy.dismiss()
        understudy.dismiss()
        understudy.send_signal(signal.SIGTERM)
        print(understudy.returncode)
        """,
    )
    assert (done.stdout, done.stderr) == ("-9\n", "")


@pytest.mark.parametrize("closed", ["0", "1", "2", "01", "12", "012"])
def test_standard_files_that_are_closed_lead_nowhere_and_it_is_dismissed(tmp_path: Path, closed: str) -> None:
    """What is opened next would have their numbers."""
    code = """
    from lostlink.cli import entry
    entry._open_what_is_closed()
    told = os.open("told", os.O_WRONLY | os.O_CREAT)
    understudy = Understudy(2, lambda: tell)
    understudy.dismiss()
    os.write(told, str(understudy.returncode).encode())
    """
    beginning = f"import os\nfor number in {closed!r}: os.close(int(number))\n"
    done = subprocess.run(
        [sys.executable, "-c", beginning + BEGINNING + textwrap.dedent(code)],
        env={**of_runs(os.environ), "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        timeout=60,
        check=False,
    )
    assert (done.returncode, (tmp_path / "told").read_text()) == (0, "-9")


def test_a_program_that_cannot_be_loaded_says_so_in_its_log(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
        def load():
            raise ImportError("libjsbsim.so: there is none")
        understudy = Understudy(2, load)
        with log.open("wb") as file:
            understudy.begin(spec(file.fileno()), file)
        print(understudy.wait())
        """,
    )
    assert (done.stdout, done.stderr) == ("1\n", "")
    assert "ImportError: libjsbsim.so: there is none" in (tmp_path / "log").read_text()


def test_what_is_printed_is_printed_once_and_it_ends_as_any_python(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
        import atexit
        atexit.register(lambda: print("ours", flush=True))
        print("said before")
        def play(words):
            atexit.register(lambda: print("its own", flush=True))
            return 0
        understudy = Understudy(2, lambda: play)
        with log.open("wb") as file:
            understudy.begin(spec(file.fileno()), file)
        understudy.wait()
        """,
    )
    assert done.stdout == "said before\nours\n"
    assert (tmp_path / "log").read_text() == "its own\n"


@pytest.mark.parametrize("end", ["os.kill(os.getpid(), signal.SIGKILL)", "os._exit(0)"])
def test_it_ends_with_its_parent(tmp_path: Path, end: str) -> None:
    done = run(tmp_path, f"print(Understudy(2, lambda: tell).pid, flush=True); {end}")
    try:
        psutil.Process(int(done.stdout)).wait(10.0)
    except psutil.NoSuchProcess:
        return


@pytest.mark.parametrize("number", ["SIGTERM", "SIGINT", "SIGHUP"])
def test_signals_end_it_whatever_its_parent_does_with_them(tmp_path: Path, number: str) -> None:
    done = run(
        tmp_path,
        f"""
        signal.signal(signal.{number}, lambda *_: print("handled"))
        understudy = Understudy(2, lambda: tell)
        understudy.send_signal(signal.{number})
        print(understudy.wait() == -signal.{number})
        """,
    )
    assert done.stdout == "True\n", done.stderr


def test_a_process_with_threads_or_of_another_environment_is_not_forked(tmp_path: Path) -> None:
    code = """
    alone = can_fork()
    over = threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    print(alone, can_fork())
    over.set()
    """
    assert run(tmp_path, code).stdout == "True False\n"
    assert run(tmp_path, code, PYTHONHASHSEED="1").stdout == "False False\n"
    assert run(tmp_path, code, flags=["-I"]).stdout == "False False\n"
    assert run(tmp_path, code, flags=["-O"]).stdout == "False False\n"


def test_environment_of_a_run() -> None:
    assert not has_environment({"PATH": "/bin"})
    assert has_environment(environment_of({"PATH": "/bin", "GLIBC_TUNABLES": "glibc.malloc.check=1"}))
    assert not has_environment({**environment_of({}), "OPENBLAS_NUM_THREADS": "2"})


@pytest.mark.slow
def test_its_log_says_at_the_end_how_many_lines_were_left_out(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
        import argparse, logging
        from bridge.run.process import log_to_files
        def flood(words):
            log_to_files(argparse.Namespace(run_dir="."))
            for _ in range(30):
                logging.getLogger("aps.hub").info("again")
            return 0
        understudy = Understudy(2, lambda: flood)
        with log.open("wb") as file:
            understudy.begin(spec(file.fileno()), file)
        understudy.wait()
        """,
    )
    assert done.returncode == 0, done.stderr
    *lines, last = (tmp_path / "log").read_text().splitlines()
    assert len(lines) == 10
    assert last.endswith("INFO aps.hub: 20 more lines like this were left out: again")
