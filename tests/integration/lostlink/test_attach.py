"""`lostlink attach` on a router that stands for a run: refusals, rights, signals, exit codes, and nothing is left."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

import psutil
import pytest
from click.testing import CliRunner

from bridge.bus.identity.keyring import Keyring
from bridge.bus.identity.roster import roster
from bridge.bus.messages import Clock, Header
from bridge.bus.session import Session, free_port, open_router
from bridge.run.directory import RunDirectory
from bridge.scenario.file import parse_scenario
from lostlink.cli.live.attach import attach as attach_command
from tests.integration.lostlink.namespaces import LOSTLINK, WHY_NO_NAMESPACE
from tests.warm import Command

SCENARIO = """\
schema: 1
name: attached
duration_s: 10
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: {preset: perfect, mtu_bytes: 1200}
networks: {tiny: {preset: perfect, mtu_bytes: 60}, serial: {preset: sik-433}}
nodes:
  - {id: 0, modems: {serial: {serial: 1}}, agent: {type: still}}
  - {id: 1, agent: {type: free}}
  - {id: gcs, kind: ground, networks: [main], agent: {type: still}}
"""
WAIT_S = 20.0
pytestmark = pytest.mark.timeout(120)
needs_namespace = pytest.mark.skipif(bool(WHY_NO_NAMESPACE), reason=WHY_NO_NAMESPACE)


@dataclass
class Standing:
    """A run that goes on, of which only the router is there; `over` ends it."""

    directory: RunDirectory
    router: Session
    over: Callable[[], object]


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Standing]:
    scenario = parse_scenario(SCENARIO, "scenario", tmp_path, {})
    directory = RunDirectory.create(tmp_path, "attached")
    nodes = scenario.transceiver_ids
    keyring = Keyring.create(directory.path / "secrets", roster(nodes, {}, free=["1"]))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    directory.write(scenario, endpoint, keyring=keyring)
    with ExitStack() as stack:
        lock = stack.enter_context(ExitStack())
        lock.enter_context(directory.going_on())
        router = stack.enter_context(open_router(endpoint, directory.guard))
        yield Standing(directory, router, lock.close)


Attached = Command | subprocess.Popen[str]
Attach = Callable[..., Attached]


@pytest.fixture
def attach(run: Standing) -> Iterator[Attach]:
    """Attach a program; whatever is left of it in the end is killed."""
    started: list[Attached] = []

    def start(*words: str, before: tuple[str, ...] = (), stdin: int = subprocess.DEVNULL) -> Attached:
        line = ["attach", str(run.directory.path), "--node", *words]
        files = {"stdin": stdin, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        process = (
            subprocess.Popen([*before, *LOSTLINK, *line], **files, text=True, start_new_session=True)
            if before
            else Command(*line, **files, text=True, start_new_session=True)
        )
        started.append(process)
        return process

    yield start
    for process in started:
        with suppress(psutil.NoSuchProcess):
            for each in (*psutil.Process(process.pid).children(recursive=True), process):
                each.kill()
        process.communicate()


def ended(process: Attached) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=WAIT_S)
    return process.returncode, out, err


def first_line(process: Attached) -> str:
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line, process.communicate()[1]
    return line.strip()


def waits(code: str = "") -> list[str]:
    """A program that says that it is there, after some code of its own, and waits."""
    text = f"import os, signal, sys, threading\n{code}\nprint('here', flush=True)\nthreading.Event().wait()"
    return [sys.executable, "-I", "-c", text]


BESIDE = """\
import subprocess
subprocess.Popen(["sleep", "1000"])
subprocess.Popen(["sleep", "1000"], start_new_session=True)
"""
"""Two processes in the background, one of the program's session and one of its own; each runs once it is started."""


def refused(process: Attached) -> str:
    """The one line that it says when it could not attach anything."""
    status, out, err = ended(process)
    assert (status, out) == (125, "")
    assert err.startswith("lostlink: ")
    assert err.count("\n") == 1, err
    return err.removeprefix("lostlink: ").strip()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("1",),
            "UA 1 has a free program for its agent, which numbers the node's packets: give it an agent of",
        ),
        (("7",), "there is no node '7'; there are 0, 1, gcs"),
        (("gcs", "--radio", "tiny"), "node gcs has no radio 'tiny'; it has main"),
        (("0", "--radio", "tiny"), "radio tiny takes 60 bytes at most (mtu_bytes), and IPv4 needs 68"),
        (
            ("0", "--radio", "serial"),
            "UA 0 has a modem on its radio serial, which sends and hears its autopilot's",
        ),
        (("0", "--subnet", "10.0.0.0/30"), "10.0.0.0/30 has no address for node"),
        (("0", "--subnet", "10.0.0.1/24"), "'10.0.0.1/24' is no subnet, such as 10.42.0.0/24"),
        (("0", "--mtu", "1300"), "--mtu 1300: from 68 to 1200 on radio main"),
        (("0", "--mtu", "67"), "--mtu 67: from 68 to 1200 on radio main"),
    ],
)
def test_what_cannot_be_attached_is_told_in_a_line(words: tuple[str, ...], said: str, run: Standing) -> None:
    done = CliRunner().invoke(attach_command, [str(run.directory.path), "--node", *words, "--", "true"])
    assert (done.exit_code, done.stdout) == (125, "")
    assert done.stderr.startswith(f"lostlink: {said}")
    assert done.stderr.count("\n") == 1


def test_a_run_that_is_over_or_repeats_another_takes_nothing(run: Standing, attach: Attach) -> None:
    file = run.directory.path / "run.json"
    file.write_text(file.read_text().replace('"replay": ""', '"replay": "runs/A"'))
    assert refused(attach("0", "--", "true")).endswith("repeats runs/A: it takes nothing from outside")
    file.write_text(file.read_text().replace('"replay": "runs/A"', '"replay": ""'))
    run.over()
    assert refused(attach("0", "--", "true")) == f"the run {run.directory.path} is over"


@needs_namespace
def test_the_program_has_interface_addresses_and_names_and_its_exit_code_is_ours(attach: Attach) -> None:
    code = (
        "import fcntl, os, socket, struct, sys\n"
        "print([name for _, name in socket.if_nameindex()])\n"
        "s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n"
        "ask = lambda what: fcntl.ioctl(s, what, struct.pack('16s24x', b'radio0'))\n"
        "print(socket.inet_ntoa(ask(0x8915)[20:24]), socket.inet_ntoa(ask(0x891b)[20:24]))\n"
        "print(struct.unpack('16si20x', ask(0x8921))[1])\n"
        "print([socket.gethostbyname(name) for name in ('ua-0', 'ua-1', 'gcs', 'localhost')])\n"
        "print(open('/etc/hosts').readlines()[:3])\n"
        "print(sorted(os.listdir('/sys/class/net')))\n"
        "s.sendto(b'x', ('127.0.0.1', 9))\n"
        "try:\n    s.sendto(b'x', ('192.0.2.1', 9))\nexcept OSError as error:\n    print(error.strerror)\n"
        "sys.exit(5)\n"
    )
    process = attach("0", "--subnet", "172.20.0.0/23", "--mtu", "300", "--", sys.executable, "-I", "-c", code)
    status, out, err = ended(process)
    assert out.splitlines() == [
        "['lo', 'radio0']",
        "172.20.0.1 255.255.254.0",
        "300",
        "['172.20.0.1', '172.20.0.2', '172.20.1.254', '127.0.0.1']",
        "['172.20.0.1 ua-0\\n', '172.20.0.2 ua-1\\n', '172.20.1.254 gcs\\n']",
        "['lo', 'radio0']",
        "Network is unreachable",
    ]
    assert status == 5
    assert err.splitlines() == [
        "lostlink: UA 0 is 172.20.0.1 on radio main (MTU 300 bytes)",
        "lostlink: others: ua-1 172.20.0.2, gcs 172.20.1.254",
        "lostlink: 0 packets sent (0 bytes), 0 received (0 bytes)",
    ]


@needs_namespace
@pytest.mark.parametrize(
    ("command", "status", "said"),
    [
        (["no-such-program"], 127, "lostlink: no-such-program: No such file or directory\n"),
        ([""], 127, "lostlink: : No such file or directory\n"),
        (["/"], 126, "lostlink: /: Permission denied\n"),
        (["sh", "-c", "kill -PIPE $$"], 141, ""),
    ],
)
def test_exit_codes_are_those_of_a_shell(command: list[str], status: int, said: str, attach: Attach) -> None:
    assert ended(attach("0", "--quiet", "--", *command)) == (status, "", said)


@needs_namespace
def test_what_a_program_sends_by_its_end_is_sent_or_counted(attach: Attach) -> None:
    """While nobody reads, as many packets wait as a node takes in a tick; those beyond are told."""
    code = (
        "import socket, sys\n"
        "print('here', flush=True)\n"
        "sys.stdin.readline()\n"
        "s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n"
        "for _ in range(2100):\n    s.sendto(b'x', ('10.42.0.2', 9))\n"
    )
    theirs, ours = os.pipe()
    process = attach("0", "--", sys.executable, "-I", "-c", code, stdin=theirs)
    os.close(theirs)
    assert first_line(process) == "here"
    attached = psutil.Process(process.pid)
    [outside] = attached.children()
    attached.suspend()
    os.close(ours)
    while outside.status() != psutil.STATUS_ZOMBIE:
        sleep(0.01)
    attached.resume()
    status, _, err = ended(process)
    assert status == 0
    held = 2000 if os.geteuid() == 0 else 500  # the length of a queue is for root to say
    assert err.splitlines()[-1] == (
        f"lostlink: {held} packets sent ({29 * held} bytes), 0 received (0 bytes), "
        f"{2100 - held} dropped (came faster than they could be read)"
    )


@needs_namespace
def test_the_second_on_a_node_is_refused_by_name_and_other_nodes_are_not(
    run: Standing, attach: Attach
) -> None:
    first = attach("0", "--", *waits())
    assert first_line(first) == "here"
    assert refused(attach("0", "--", "true")).startswith("UA 0 has a program attached already: ")
    assert ended(attach("gcs", "--", "true"))[0] == 0
    first.send_signal(signal.SIGTERM)
    assert ended(first)[0] == 143
    assert ended(attach("0", "--", "true"))[0] == 0
    assert not list(run.directory.path.glob("attached-*"))


@needs_namespace
@pytest.mark.parametrize(
    ("number", "code", "status"),
    [
        (signal.SIGINT, "signal.signal(signal.SIGINT, lambda *_: os._exit(6))", 6),
        (signal.SIGINT, "signal.signal(signal.SIGINT, signal.SIG_DFL)", 130),
        (signal.SIGTERM, "signal.signal(signal.SIGTERM, lambda *_: os._exit(7))", 7),
        (signal.SIGTERM, "", 143),
        pytest.param(
            signal.SIGTERM, "signal.signal(signal.SIGTERM, signal.SIG_IGN)", 137, marks=pytest.mark.slow
        ),
    ],
)
def test_signals_reach_the_program_and_nothing_is_left(
    number: signal.Signals, code: str, status: int, run: Standing, attach: Attach
) -> None:
    attached = attach("0", "--", *waits(BESIDE + code))
    assert first_line(attached) == "here"
    below = psutil.Process(attached.pid).children(recursive=True)
    assert [each.name() for each in below].count("sleep") == 2
    attached.send_signal(number)
    assert ended(attached)[0] == status
    assert not psutil.wait_procs(below, timeout=WAIT_S)[1]
    assert not list(run.directory.path.glob("attached-*"))


IN_A_TERMINAL = (
    *(sys.executable, "-c"),
    "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); os.execvp(sys.argv[1], sys.argv[1:])",
)
COUNTS = (
    "signals, count = {signal.SIGINT, signal.SIGTERM}, 0\n"
    "signal.pthread_sigmask(signal.SIG_BLOCK, signals)\n"
    "print('here', flush=True)\n"
    "while signal.sigwaitinfo(signals).si_signo == signal.SIGINT:\n"
    "    count += 1\n"
    "    print('interrupted', flush=True)\n"
    "sys.exit(count)"
)


@pytest.mark.slow
@needs_namespace
def test_ctrl_c_in_a_terminal_reaches_the_program_once(attach: Attach) -> None:
    ours, theirs = os.openpty()
    attached = attach("0", "--", *waits(COUNTS), before=IN_A_TERMINAL, stdin=theirs)
    assert first_line(attached) == "here"
    for _ in range(5):
        os.write(ours, b"\x03")
        assert first_line(attached) == "interrupted"
    attached.send_signal(signal.SIGTERM)
    assert ended(attached)[0] == 5
    os.close(ours)
    os.close(theirs)


@needs_namespace
def test_a_killed_attach_takes_its_program_along_and_what_that_started(attach: Attach) -> None:
    attached = attach("0", "--", *waits(BESIDE))
    assert first_line(attached) == "here"
    below = psutil.Process(attached.pid).children(recursive=True)
    assert [each.name() for each in below].count("sleep") == 2
    attached.kill()
    assert not psutil.wait_procs(below, timeout=WAIT_S)[1]
    assert ended(attach("0", "--", "true"))[0] == 0


ORPHANS = 'for each in 1 2 3 4 5 6 7 8; do (true &); done; exec "$@"'
ALONE = """\
import time
until = time.monotonic() + 10.0
while (left := [each for each in os.listdir("/proc") if each.isdigit()]) != ["1", "2"] and time.monotonic() < until:
    time.sleep(0.01)
print(left, flush=True)
"""
"""Wait until nothing is left but the program and its parent, not even what has ended and was not reaped."""


@needs_namespace
def test_what_ends_and_has_no_parent_is_reaped_while_the_program_runs(attach: Attach) -> None:
    attached = attach("0", "--", "sh", "-c", ORPHANS, "sh", *waits(ALONE))
    assert first_line(attached) == "['1', '2']"
    assert attached.poll() is None


@needs_namespace
def test_the_program_sees_its_own_processes_alone(attach: Attach) -> None:
    code = "import os; print(os.getpid() == int(os.readlink('/proc/self')), os.getppid())"
    code += "; print(sorted(int(each) for each in os.listdir('/proc') if each.isdigit()))"
    _, out, err = ended(attach("0", "--", sys.executable, "-I", "-c", code))
    assert out.splitlines() == ["True 1", "[1, 2]"], err


@needs_namespace
@pytest.mark.parametrize("says", [True, False])
def test_the_end_of_the_run_ends_the_program_with_a_word(says: bool, run: Standing, attach: Attach) -> None:
    attached = attach("0", "--", "sh", "-c", "while true; do echo here; sleep 0.05; done")
    assert first_line(attached) == "here"
    if says:
        wanted = run.router.interest(run.directory.keys.clock_end)
        until = monotonic() + WAIT_S
        while not wanted() and monotonic() < until:
            first_line(attached)
        run.router.put(run.directory.keys.clock_end, Header.at(0, ""))
    else:  # it was killed
        run.over()
    status, _, err = ended(attached)
    assert status == 143
    assert err.count("lostlink: the run is over: ends the program\n") == 1


@needs_namespace
@pytest.mark.parametrize("is_held", [True, False])
def test_a_run_that_stands_is_slow_unless_an_operator_holds_it(
    is_held: bool, run: Standing, attach: Attach
) -> None:
    keys, router = run.directory.keys, run.router
    attached = attach("0", "--quiet", "--", "sh", "-c", "while true; do echo here; sleep 0.05; done")
    wanted = [router.interest(key) for key in (keys.clock, keys.clock_pace, keys.clock_end)]
    until = monotonic() + WAIT_S
    while not all(each() for each in wanted) and monotonic() < until:
        first_line(attached)
    router.put(keys.clock, Clock(Header.at(0, "")))
    if is_held:
        router.put(keys.clock_pace, Clock(Header.at(0, ""), paused=True))
    for _ in range(6):
        first_line(attached)
    router.put(keys.clock, Clock(Header.at(1, "")))
    router.put(keys.clock_end, Header.at(1, ""))
    status, _, err = ended(attached)
    assert status == 143
    assert (err == "") == is_held, "a warning is told in any case"
    assert is_held or (err.startswith("lostlink: warning: the run went at") and err.count("\n") == 1), err


WITHOUT_RIGHTS = (
    *("unshare", "--user", "--map-root-user", "sh", "-c"),
    'echo 0 > /proc/sys/user/max_user_namespaces; exec setpriv --bounding-set=-sys_admin --inh-caps=-all -- "$@"',
    "sh",
)
"""No user namespaces, and none of root's rights to others."""


@pytest.mark.slow
@needs_namespace
@pytest.mark.skipif(shutil.which("setpriv") is None, reason="no setpriv here (util-linux)")
def test_without_the_right_to_namespaces_there_is_a_word(attach: Attach) -> None:
    said = refused(attach("0", "--", "true", before=WITHOUT_RIGHTS))
    assert said.startswith("no network namespace can be made here (")
    assert "run it as root, or let users make namespaces" in said


@pytest.mark.slow
@needs_namespace
@pytest.mark.skipif(shutil.which("setpriv") is None or os.geteuid() != 0, reason="root has rights to lose")
def test_a_user_namespace_does_where_root_has_no_right(attach: Attach) -> None:
    before = ("setpriv", "--bounding-set=-sys_admin,-net_admin,-net_raw", "--")
    status, out, err = ended(attach("0", "--", "sh", "-c", "id -u; cat /proc/self/uid_map", before=before))
    assert status == 0, err
    assert [line.split() for line in out.splitlines()] == [["0"], ["0", "0", "1"]]


WITHOUT_TUN = (
    *("unshare", "--user", "--map-root-user", "--mount", "sh", "-c"),
    'mount -t tmpfs none /dev/net && exec "$@"',
    "sh",
)


@pytest.mark.slow
@needs_namespace
def test_without_tun_devices_there_is_a_word(attach: Attach) -> None:
    said = refused(attach("0", "--", "true", before=WITHOUT_TUN))
    assert said.startswith("/dev/net/tun: No such file or directory: it needs the kernel's TUN devices")
