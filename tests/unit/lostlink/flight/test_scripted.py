"""What `fly` returns."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Mapping
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import yaml

from bridge.fleet.autopilots.dirs import NOT_SAID
from bridge.scenario.document.extends import SCENARIOS
from bridge.scenario.file import ScenarioError, read_scenario
from bridge.scenario.model import Scenario
from lostlink.flight import scripted
from lostlink.flight.flight import Flight
from lostlink.flight.scripted import RunResult, ScenarioLike, read_like

SEPARATION = Path(str(SCENARIOS / "separation.yaml"))
OF_ALL_KINDS: tuple[ScenarioLike, ...] = (
    SEPARATION,
    read_scenario(SEPARATION),
    {"extends": "separation"},
    yaml.safe_load(SEPARATION.read_text(encoding="utf-8")),
)


def test_an_assertion_shows_why_a_run_failed() -> None:
    summary = {
        "ending": "failed",
        "outcome": "broke_off",
        "verdict": "broke off: the agent of UA 1 raised KeyError: 'x'",
        "error": "the agent of UA 1 raised KeyError: 'x'",
        "events": [{"node": str(number)} for number in range(1000)],
    }
    told = "<RunResult r, failed: broke off: the agent of UA 1 raised KeyError: 'x'>"
    assert repr(RunResult(Path("runs/r"), summary)) == told


def kind(scenario: ScenarioLike) -> str:
    return type(scenario).__name__ + ("_that_extends" if scenario == {"extends": "separation"} else "")


@pytest.mark.parametrize("scenario", OF_ALL_KINDS, ids=kind)
@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"radio": "hata"}, "radio: no radio preset or YAML file 'hata'; did you mean hata-qpsk?"),
        ({"nodes.0.airframe": "f45"}, "nodes.0.airframe: unknown airframe 'f45'; did you mean f450?"),
        (
            {"expectations": [{"type": "age", "node": 7, "at_most_s": 1}]},
            "expectations.0.node: no node has the id 7; there are: 0, 1",
        ),
        ({"nodes.0.agent": {"type": "own", "class": "a.py:A"}}, "nodes.0.agent.class: "),
    ],
)
def test_names_in_changes_are_looked_for_whatever_is_changed(
    scenario: ScenarioLike, changes: Mapping[str, Any], says: str
) -> None:
    ((key, value),) = changes.items()
    with pytest.raises(ScenarioError) as caught:
        read_like(scenario, changes)
    assert str(caught.value).startswith(f"override {key}={value!r}: {says}")


@pytest.mark.parametrize("scenario", OF_ALL_KINDS, ids=kind)
def test_files_in_changes_are_absolute_and_numbers_of_numpy_are_numbers(
    scenario: ScenarioLike, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that what a run keeps can be flown again from anywhere."""
    monkeypatch.chdir(tmp_path)
    Path("a.py").write_text("from lostlink import Agent\nclass A(Agent): pass\n", encoding="utf-8")
    Path("w.yaml").write_text("constant: {speed_mps: 3}\n", encoding="utf-8")
    changes = {
        "wind": "w.yaml",
        "nodes.0.agent": {"type": "own", "class": "a.py:A"},
        "seed": np.int64(7),
        "radio.mtu_bytes": np.int64(500),
    }
    it = read_like(scenario, changes)
    assert it.wind == str(tmp_path / "w.yaml")
    assert it.ua[0].agent.model_dump()["class_"] == f"{tmp_path / 'a.py'}:A"
    assert Scenario.from_yaml(it.to_yaml()) == it
    assert (it.seed, type(it.seed)) == (7, int)


def test_a_mapping_may_have_numbers_of_numpy() -> None:
    it = read_like({"extends": "separation", "nodes": [{"id": 1, "home": {"north_m": np.float64(3.5)}}]}, {})
    assert it.ua[1].home.north_m == 3.5


def is_waited_for(frame: FrameType | None) -> bool:
    """Whether the interrupted thread was waiting for another."""
    while frame is not None:
        if frame.f_code.co_name in {"wait", "join"}:
            return True
        frame = frame.f_back
    return False


def test_a_flight_whose_end_is_not_waited_for_is_not_taken_for_ended(tmp_path: Path) -> None:
    """Of a thread that is over Python does not wait at its own end: the record would have none."""
    interrupted, gone, quiet, released = (threading.Event() for _ in range(4))
    thread: list[threading.Thread] = []

    def ctrl_c(_: int, frame: FrameType | None) -> None:
        if is_waited_for(frame) and not gone.is_set():
            if interrupted.is_set():
                gone.set()
            raise KeyboardInterrupt

    def fly(_: object, *, takes_signals: bool) -> dict[str, Any]:
        thread.append(threading.current_thread())
        while not gone.wait(0.01):  # until it was interrupted twice
            os.kill(os.getpid(), signal.SIGUSR1)
        quiet.set()
        released.wait()
        return {}

    flight = SimpleNamespace(directory=SimpleNamespace(path=tmp_path), fly=fly, interrupt=interrupted.set)
    before = signal.signal(signal.SIGUSR1, ctrl_c)
    try:
        with pytest.raises(KeyboardInterrupt):
            scripted._in_a_thread(cast(Flight, flight), NOT_SAID)
        assert thread[0].is_alive()
    finally:
        assert quiet.wait(10.0)  # else the next would end this process
        signal.signal(signal.SIGUSR1, before)
        released.set()
    thread[0].join()
