"""Agents that are tuned by studies, and one that a program outside decides for."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd
import pytest
from click.testing import CliRunner

from lostlink import load_run
from lostlink.cli.flying.check import check

EXAMPLES = Path(__file__).parents[3] / "examples" / "learning"
SHORT = {"duration_s": 7, "nodes.0.agent.options.height_m": 1}


def module(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


@pytest.mark.parametrize("name", ["steered", "follow"])
def test_scenarios_are_right(name: str) -> None:
    done = CliRunner().invoke(check, [str(EXAMPLES / f"{name}.yaml"), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["warnings"] == []


def episode(directory: Path, north_mps: float) -> tuple[list[Any], str]:
    environment = module("environment").Environment(directory, SHORT)
    steps, is_over = [environment.reset(seed=3)], False
    while not is_over:
        *seen, is_over = environment.step(north_mps)
        steps.append(seen)
    result = environment.close()
    assert result.ending == "duration"
    return steps, result.summary["digest"]


def test_an_episode_repeats_with_the_same_decisions(tmp_path: Path) -> None:
    steps, digest = episode(tmp_path, 3.0)
    assert (steps, digest) == episode(tmp_path, 3.0)
    assert len(steps) > 4
    assert steps[-1][0]["north_m"] > steps[0]["north_m"] + 1.0


def test_an_episode_that_cannot_fly_says_why(tmp_path: Path) -> None:
    environment = module("environment").Environment(tmp_path, {"duration_s": -1})
    with pytest.raises(Exception, match="duration_s: has to be greater than 0"):
        environment.reset(seed=1)
    environment = module("environment").Environment(tmp_path, {"nodes.0.agent.options.height_m": "ten"})
    with pytest.raises(RuntimeError, match="UA 0 failed"):
        environment.reset(seed=1)


def test_an_episode_ends_when_its_environment_is_left(tmp_path: Path) -> None:
    environment = module("environment").Environment(tmp_path, SHORT | {"duration_s": 600})

    def episode_with_a_mistake() -> None:
        with environment:
            environment.reset(seed=1)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        episode_with_a_mistake()
    (run,) = tmp_path.iterdir()
    assert load_run(run).ending == "done"
    assert environment.close() is None


def test_who_is_interrupted_before_the_agent_asks_gets_just_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    found = module("environment")
    monkeypatch.setattr(found.Listener, "accept", interrupted)
    with pytest.raises(KeyboardInterrupt), found.Environment(tmp_path, SHORT) as environment:
        environment.reset(seed=1)
    assert environment.close() is None


@pytest.mark.slow
def test_a_search_flies_no_candidate_twice(tmp_path: Path) -> None:
    search = module("search")
    best = search.search(2, 3, 1, tmp_path, duration_s=32.0)
    table = pd.read_parquet(tmp_path / "search" / "metrics.parquet")
    assert table.failure.tolist() == ["", "", ""]
    assert len(list((tmp_path / "search" / "runs").iterdir())) == 5  # of six, the best of the first twice
    assert len(best) == 3
