"""Which files a resolved scenario names: what a run is made of besides the scenario and lostlink itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from bridge.scenario.model import Scenario
from bridge.scenario.resolve.sources import sources_of

TREES = (".yaml", ".yml")
CODE = ".py"


def named_files(scenario: Scenario) -> list[Path]:
    """Absolute paths, sorted: all files that the scenario names, and what these name or import in their turn.

    Own agents and models with what they import from their folders, radios and winds with their maps, terrain and
    tables, airframes with their flight models. What ships goes by name and belongs to lostlink; modules that are
    installed are not looked for.
    """
    found: set[Path] = set()
    for text in _texts(scenario.model_dump(mode="json", by_alias=True)):
        _add(Path(), text, found)
    return sorted(found)


def _add(folder: Path, text: str, found: set[Path]) -> None:
    """Take the file that a text names as seen from a folder, if it names one, and those that it names."""
    path = (folder / _file_of(text)).absolute()
    if path in found or not _is_file(path):
        return
    found.add(path)
    if path.suffix == CODE:
        found.update(sources_of(path))
    elif path.suffix in TREES:
        tree = _tree(path)
        for part in _texts(tree):
            _add(path.parent, part, found)
        if model := _flight_model(tree, path.parent):
            for file in model.rglob("*.xml"):
                _add_included(file, model, found)


def _is_file(path: Path) -> bool:
    with suppress(OSError):  # a text that is too long for a name
        return bool(path.suffix) and path.is_file()
    return False


def _file_of(text: str) -> Path:
    """The file of a text that names one, or a class in one: ``file.py:Name``."""
    file, colon, _ = text.rpartition(":")
    path = Path(file) if colon and file.endswith(CODE) else Path(text)
    return path.expanduser() if text.startswith("~/") else path


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


def _flight_model(tree: Any, beside: Path) -> Path | None:
    """The directory of an airframe's JSBSim model, if it has one of its own."""
    jsbsim = tree.get("jsbsim") if isinstance(tree, dict) else None
    if isinstance(jsbsim, dict) and isinstance(jsbsim.get("root"), str):
        return Path(beside, jsbsim["root"]).resolve() / "aircraft" / str(jsbsim.get("model"))
    return None


def _add_included(file: Path, model: Path, found: set[Path]) -> None:
    """Take a file of a flight model and what it includes, named as seen from the model, with or without ``.xml``."""
    if file in found or not file.is_file():
        return
    found.add(file)
    with suppress(OSError, ElementTree.ParseError):  # whoever loads it says what is wrong
        for part in ElementTree.parse(file).iter():
            if name := part.get("file", "").removesuffix(".xml"):
                _add_included((model / f"{name}.xml").resolve(), model, found)
