"""Which files and packages a resolved scenario names: what a run is made of besides itself and lostlink."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from bridge.scenario.model import Scenario
from bridge.scenario.resolve.modules import CODE
from bridge.scenario.resolve.sources import Code, code_of
from sitl_configs.yaml_text import YamlMistake, read_yaml

TREES = (".yaml", ".yml")


MODULE = re.compile(r"[^\W\d][\w.]*:[^\W\d]\w*")
LAWS = "lostlink."
"""What groups of entry points begin with that give models of radios names."""


def named_files(scenario: Scenario) -> list[Path]:
    """The files of `named_code`."""
    return list(named_code(scenario).files)


def named_code(scenario: Scenario) -> Code:
    """All files that the scenario names, and what these name or import in their turn; and packages that they import.

    Own agents, functions and models with what they import, radios and winds with their maps, terrain and tables,
    airframes with their flight models. What ships goes by name and belongs to lostlink.
    """
    named = _Named()
    for text in _texts(scenario.model_dump(mode="json", by_alias=True)):
        named.add(Path(), text)
    return Code(tuple(sorted(named.files)), dict(sorted(named.packages.items())))


class _Named:
    def __init__(self) -> None:
        self.files: set[Path] = set()
        self.packages: dict[str, str] = {}

    def add(self, folder: Path, text: str) -> None:
        """Take the file or module that a text names as seen from a folder, if it names one, and those that it names."""
        text = _laws().get(text, text)
        if MODULE.fullmatch(text) and not text.rpartition(":")[0].endswith(CODE):
            self._add_code(text.rpartition(":")[0])
            return
        path = (folder / _file_of(text)).absolute()
        if path in self.files or not _is_file(path):
            return
        self.files.add(path)
        if path.suffix == CODE:
            self._add_code(str(path))
        elif path.suffix in TREES:
            tree = _tree(path)
            for part in _texts(tree):
                self.add(path.parent, part)
            if model := _flight_model(tree, path.parent):
                for file in model.rglob("*.xml"):
                    _add_included(file, model, self.files)

    def _add_code(self, place: str) -> None:
        code = code_of(place)
        self.files.update(code.files)
        self.packages.update(code.packages)


@cache
def _laws() -> dict[str, str]:
    """Models of radios that packages bring, by name: ``module:Name``."""
    known = entry_points()
    groups = [group for group in known.groups if group.startswith(LAWS)]
    return {each.name: each.value for group in groups for each in known.select(group=group)}


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
        return read_yaml(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, YamlMistake):
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
