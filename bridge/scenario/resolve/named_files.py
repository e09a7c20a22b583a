"""Which files a resolved scenario names: what a run is made of besides the scenario and lostlink itself."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from bridge.scenario.agents import OwnAgent
from bridge.scenario.model import Scenario

TREES = (".yaml", ".yml")
TABLES = (".csv", ".nc", ".nc4", ".h5", ".tif", ".tiff", ".hgt")
CODE = ".py"


def named_files(scenario: Scenario) -> list[Path]:
    """Absolute paths, sorted: own agents, airframes with their flight models, winds and radios with what they name.

    What ships goes by name and belongs to lostlink; modules that are installed are not looked for.
    """
    named = [ua.airframe for ua in scenario.ua]
    sensors = (node.sensor.radio for node in scenario.transceivers if node.sensor is not None)
    antennas = (emitter.antenna for emitter in scenario.emitters)
    radios = (scenario.radio, *(node.radio for node in scenario.transceivers), *sensors)
    for setting in (scenario.wind, *radios, *antennas):
        named += _texts(setting)
    found: set[Path] = set()
    for name in named:
        _add(_file_of(name), found)
    for node in scenario.transceivers:
        if isinstance(node.agent, OwnAgent) and node.agent.place.endswith(".py"):
            found.add(Path(node.agent.place).absolute())
    return sorted(found)


def _add(path: Path, found: set[Path]) -> None:
    """Take a file, and those that it names as seen from its directory."""
    path = path.absolute()
    if path.suffix not in (*TREES, *TABLES, CODE) or path in found or not path.is_file():
        return
    found.add(path)
    if path.suffix in TREES:
        tree = _tree(path)
        for text in _texts(tree):
            _add(path.parent / _file_of(text), found)
        found.update(_flight_model(tree, path.parent))


def _file_of(text: str) -> Path:
    """The file of a text that names one, or a class in one: ``file.py:Name``."""
    file, colon, _ = text.rpartition(":")
    return Path(file) if colon and file.endswith(CODE) else Path(text)


def _tree(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return None  # whoever loads it says what is wrong


def _texts(tree: Any) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    elif isinstance(tree, dict | list):
        for part in tree.values() if isinstance(tree, dict) else tree:
            yield from _texts(part)


def _flight_model(tree: Any, beside: Path) -> Iterator[Path]:
    """The files of an airframe's JSBSim model, if it has a directory of its own for it."""
    jsbsim = tree.get("jsbsim") if isinstance(tree, dict) else None
    if isinstance(jsbsim, dict) and isinstance(jsbsim.get("root"), str):
        directory = (beside / jsbsim["root"]).resolve() / "aircraft" / str(jsbsim.get("model"))
        yield from (file for file in directory.rglob("*.xml") if file.is_file())
