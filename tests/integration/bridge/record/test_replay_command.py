"""`lostlink replay` on Zenoh: what an observer gets, what an operator may ask."""

from __future__ import annotations

import json
import os
import selectors
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from click.testing import CliRunner

from bridge.bus.identity.keyring import OBSERVERS
from bridge.bus.identity.roster import OPERATOR
from bridge.bus.keys import Keys
from bridge.bus.messages import Clock, Header, decode, encode
from bridge.bus.session import Sample, Session, Stamp, free_port, open_client, open_router
from bridge.record.digests import digests
from bridge.run.access import access_of
from lostlink.cli.main import lostlink
from lostlink.replay.player import Player
from lostlink.replay.playing.controls import Controls
from lostlink.replay.playing.pace import Pace
from lostlink.replay.playing.process import ReplayProcess
from tests.unit.lostlink.replay.flown import TICK_NS, Sent, flown, scenario_of

NODES = ("0", "1", "gcs")
TICKS = 41


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("records") / "made"
    return flown(path, scenario_of("moon2020", NODES), TICKS, lambda _: [Sent("0"), Sent("gcs", to="1")])


class Played:
    """A `lostlink replay` in the background."""

    def __init__(self, record: Path, out: Path, *options: str) -> None:
        command = [sys.executable, "-m", "lostlink.cli.main", "replay", str(record), "--out", str(out)]
        self.out = out
        self.process = subprocess.Popen(
            [*command, "--zenoh-port", "0", *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        self.first_line = self._line()

    def _line(self) -> str:
        """What it says when it is there."""
        assert self.process.stdout is not None
        said = b""
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            deadline = time.monotonic() + 60.0
            while b"\n" not in said:
                assert selector.select(deadline - time.monotonic()), said
                chunk = os.read(self.process.stdout.fileno(), 4096)
                assert chunk, said
                said += chunk
        return said.decode()

    @property
    def place(self) -> Path:
        (found,) = self.out.iterdir()
        return found

    def end(self) -> int:
        status = self.process.wait(30.0)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return status


@pytest.fixture
def played(record: Path, tmp_path: Path) -> Iterator[Any]:
    started: list[Played] = []

    def start(*options: str) -> Played:
        started.append(Played(record, tmp_path / "runs", *options))
        return started[-1]

    yield start
    for each in started:
        if each.process.poll() is None:
            each.process.kill()
        each.end()


class Listener:
    """What came, in its order."""

    def __init__(self, session: Session, key_expr: str) -> None:
        self.samples: list[Sample] = []
        self._came = threading.Condition()
        session.subscribe(key_expr, self._take)

    def _take(self, sample: Sample) -> None:
        with self._came:
            self.samples.append(sample)
            self._came.notify_all()

    def wait_for(self, key: str, count: int = 1) -> list[Sample]:
        with self._came:
            assert self._came.wait_for(lambda: len(self.on(key)) >= count, 20.0), (key, len(self.samples))
            return self.on(key)

    def on(self, key: str) -> list[Sample]:
        return [sample for sample in self.samples if str(sample.key_expr) == key]

    def payloads(self, key: str) -> list[bytes]:
        return [sample.payload.to_bytes() for sample in self.on(key)]


def ask(session: Session, keys: Keys, verb: str, text: str = "") -> dict[str, Any] | None:
    """What is answered; None if nothing is."""
    replies: list[zenoh.Reply] = []
    over = threading.Event()
    key = keys.clock_command(verb)
    session._inner.get(
        key, zenoh.handlers.Callback(replies.append, over.set, indirect=False), payload=text, timeout=5.0
    )
    assert over.wait(20.0)
    if not replies:
        return None
    answer = replies[0].ok or replies[0].err
    found: dict[str, Any] = json.loads(answer.payload.to_bytes())
    return found


@pytest.mark.slow
def test_an_observer_gets_what_an_observer_of_the_run_got(played: Any, record: Path) -> None:
    replay = played("--paused", "--speed", "max")
    place = replay.place
    assert place.name == "replay-made"
    keys = Keys("replay-made")
    with access_of(place, OPERATOR).open() as operator, open_client(endpoint(place), OBSERVERS) as observer:
        listener = Listener(observer, "lostlink/**")
        listener.wait_for(keys.clock)
        assert ask(operator, keys, "seek", "0") is not None
        listener.wait_for(keys.tick("links"))
        listener.samples.clear()
        assert ask(operator, keys, "resume") is not None
        listener.wait_for(keys.clock_end)
    assert replay.end() == 0
    assert not place.exists()
    expected: dict[str, list[bytes]] = {}
    for moment in Player.open(record).moments():
        if moment.sim_time_ns:
            messages = [(keys.tick("truths"), moment.truths()), (keys.tick("fates"), moment.fates())]
            messages += [(keys.truth(node), truth) for node, truth in moment.truth().items()]
            messages += [(keys.tick("communication"), moment.communication())]
            messages += [(keys.comm_status(s.header.frame_id), s) for s in moment.statuses()]
            states = moment.states().items()
            messages += [(keys.state(n), s) for n, s in states if s.header.stamp.ns == moment.sim_time_ns]
            messages += [(keys.tick("links"), moment.links())] if moment.links_are_due else []
            for key, message in messages:
                expected.setdefault(key, []).append(encode(message))
            for packet in moment.received():
                key = keys.rx(packet.rx, packet.tx, packet.channel)
                expected.setdefault(key, []).append(packet.payload)
    assert {key: listener.payloads(key) for key in expected} == expected
    clocks = [decode(payload, Clock).header.stamp.ns for payload in listener.payloads(keys.clock)]
    assert sorted(set(clocks)) == [TICK_NS * tick for tick in range(TICKS)]
    stamps = [Stamp.from_sample(sample) for sample in listener.on(keys.rx("1", "0", "team"))]
    assert stamps
    assert all(stamp is not None and stamp.sim_time_ns == stamp.seq * TICK_NS for stamp in stamps)
    end = decode(listener.payloads(keys.clock_end)[0], Header)
    assert end.stamp.ns == (TICKS - 1) * TICK_NS


def endpoint(place: Path) -> str:
    return str(json.loads((place / "run.json").read_text())["endpoint"])


def test_an_operator_moves_it_and_an_observer_does_not(played: Any) -> None:
    replay = played("--paused", "--from", "0.5", "--name", "mine")
    keys = Keys("mine")
    with access_of(replay.place, OPERATOR).open() as operator:
        listener = Listener(operator, f"{keys.prefix}/tick/truths")
        until = time.monotonic() + 10.0
        while (status := ask(operator, keys, "status")) is None:  # a new session has yet to learn who answers
            assert time.monotonic() < until
        assert (status["paused"], status["begin_s"], status["end_s"]) == (True, 0.5, 2.0)
        assert ask(operator, keys, "seek", "1.25") == status | {"sim_time_s": 1.25}
        assert ask(operator, keys, "step") == status | {"sim_time_s": 1.3}
        truths = listener.wait_for(str(keys.tick("truths")), 2)
        assert len({sample.payload.to_bytes() for sample in truths}) >= 2
        answer = ask(operator, keys, "seek", "9")
        assert answer == {"error": "seek: seconds of sim time, from 0.5 to 2, not 9.0"}
        answer = ask(operator, keys, "fly")
        assert answer is not None
        assert "is none of pause" in answer["error"]
        with open_client(endpoint(replay.place), OBSERVERS) as observer:
            assert ask(observer, keys, "resume") is None
        assert ask(operator, keys, "status") == status | {"sim_time_s": 1.3}


SIGNALLED = """
import signal
from types import SimpleNamespace
from lostlink.replay.playing import process

process.MomentPublisher = lambda *_: None
served = SimpleNamespace(serve=lambda *_: None)
played = SimpleNamespace(player=SimpleNamespace(record=SimpleNamespace(scenario=None)))
replay = process.ReplayProcess(served, SimpleNamespace(clock_command=str), played)
replay._patience_s, replay._play = lambda: 0.0, lambda: True  # always about to look whether somebody asked
signal.signal(signal.SIGALRM, lambda *_: replay.stop())
for number in range(2000):
    signal.setitimer(signal.ITIMER_REAL, 1e-4 + 1e-6 * (number % 97))
    replay.run()
print("ended each time")
"""


@pytest.mark.slow
def test_a_signal_may_come_at_any_moment() -> None:
    """Also while the thread that is to be told holds what it waits with."""
    done = subprocess.run([sys.executable, "-c", SIGNALLED], capture_output=True, text=True, timeout=60)
    assert done.stdout == "ended each time\n", done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_a_signal_ends_it_and_leaves_nothing_behind(played: Any, number: signal.Signals) -> None:
    replay = played("--loop", "--speed", "50")
    place = replay.place
    keys = Keys("replay-made")
    with open_client(endpoint(place), OBSERVERS) as observer:
        listener = Listener(observer, keys.clock)
        listener.wait_for(keys.clock, 3 * TICKS)  # it has begun anew
        assert not listener.on(keys.clock_end)
    replay.process.send_signal(number)
    assert replay.end() == 0
    assert not place.exists()


def test_it_publishes_through_a_router_of_somebody_elses(played: Any, tmp_path: Path) -> None:
    place = f"tcp/127.0.0.1:{free_port()}"
    with open_router(place) as router:
        listener = Listener(router, "lostlink/**")
        replay = played("--connect", place, "--speed", "max", "--name", "elsewhere")
        assert "lostlink/elsewhere/**" in replay.first_line
        listener.wait_for(Keys("elsewhere").clock_end)
        assert replay.end() == 0
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_it_begins_with_the_record_at_the_earliest(played: Any) -> None:
    replay = played("--speed", "max", "--from=-inf", "--to", "inf")
    assert replay.first_line.startswith("plays 0 s to 2 s on ")
    assert replay.end() == 0


def test_what_nobody_wants_is_not_made(record: Path) -> None:
    with open_router(f"tcp/127.0.0.1:{free_port()}") as router:
        player = Player.open(record)
        pace = Pace(float("inf"), 0, 0.0)
        ReplayProcess(router, Keys("made"), Controls(player, pace, 0, player.end_ns)).run()
        assert "states" not in player.__dict__
        assert "sent" not in player.__dict__


def test_what_the_record_has_lost_is_told(record: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(record, tmp_path / "cut")
    (copy / "summary.json").write_text(json.dumps({"digests": digests(record) | {"measurements": ""}}))
    (copy / "logs").mkdir(exist_ok=True)
    (copy / "deliveries.parquet").unlink()
    shutil.rmtree(copy / "streams" / "packets")
    command = [sys.executable, "-m", "lostlink", "replay", str(copy), "--out", str(tmp_path / "runs")]
    command += ["--speed", "max", "--zenoh-port", "0"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 0
    lost = "deliveries, measurements, packets/0, packets/1, packets/gcs"
    assert ended.stderr == f"lostlink: warning: {copy}: the record has lost {lost}: not played\n"


def test_a_directory_whose_name_is_no_key_is_told_with_the_option_that_helps(
    record: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(record, tmp_path / "my run")
    result = CliRunner().invoke(lostlink, ["replay", str(copy), "--out", str(tmp_path / "runs")])
    assert result.exit_code == 2
    assert "--name: 'replay-my run' cannot be part of a key" in result.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--from", "9"), "the record has 0 s to 2 s"),
        (("--speed", "0"), "a factor from 0.01"),
        (("--name", "a/b"), "cannot be part of a key"),
        (("--connect", "tcp/127.0.0.1:1"), "no Zenoh router answers"),
    ],
)
def test_mistakes_are_told(record: Path, tmp_path: Path, options: tuple[str, ...], text: str) -> None:
    result = CliRunner().invoke(lostlink, ["replay", str(record), "--out", str(tmp_path / "runs"), *options])
    assert result.exit_code == 2
    assert text in result.stderr
    assert not (tmp_path / "runs").exists()
