"""Which files and packages a resolved scenario names: what a run is made of besides itself and lostlink."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from bridge.scenario.model import Scenario
from bridge.scenario.resolve.modules import CODE
from bridge.scenario.resolve.sources import Code, code_of
from sitl_configs.yaml_text import YamlMistake, read_yaml

Digest = Callable[[Path], str]
"""What gives the digest of a file."""
TREES = (".yaml", ".yml")

MODULE = re.compile(r"[^\W\d][\w.]*:[^\W\d]\w*")
OPTIONS = "options"
LAWS = "lostlink."
"""What groups of entry points begin with that give models of radios names."""


def named_code(scenario: Scenario) -> Code:
    """All files that the scenario names, and what these name or import in their turn; and packages that they import.

    Own agents, functions and models with what they import, radios and winds with their maps, terrain and tables,
    airframes with their flight models. What ships goes by name and belongs to lostlink.
    """
    named = Named()
    named.in_place(scenario.model_dump(mode="json", by_alias=True), [Path()])
    return Code(tuple(sorted(named.files)), dict(sorted(named.packages.items())))


@dataclass(frozen=True, slots=True)
class _Found:
    """What a file brings: its digest with all that it names or imports, these files, and packages."""

    digest: str = ""
    files: frozenset[Path] = frozenset()
    packages: Mapping[str, str] = field(default_factory=dict)


class Named:
    """Takes in files and modules that texts name, and what these name or import in their turn.

    Args:
        digest_of: gives the digest of a file; without it only files and packages are told.

    Attributes:
        files: those that were found, absolute.
        packages: versions of installed packages that these import, by name.
    """

    def __init__(self, digest_of: Digest | None = None) -> None:
        self._digest_of = digest_of
        self._known: dict[Path, _Found] = {}
        self.files: set[Path] = set()
        self.packages: dict[str, str] = {}

    def anew(self) -> Named:
        """One that has found nothing yet, and need not look into files again that this one knows, nor this one."""
        other = Named(self._digest_of)
        other._known = self._known
        return other

    def in_place(self, tree: Any, folders: Sequence[Path] = ()) -> Any:
        """A tree in which contents stand in place of each text that names a file: the same wherever the files lie.

        Args:
            tree: mappings and lists of texts and other values.
            folders: what relative names are seen from, the first in which there is such a file; in options of code
                the folder of that comes before them.
        """
        if isinstance(tree, dict):
            of_options = (*_folder_of_code(tree), *folders)
            return {
                key: self.in_place(part, of_options if key == OPTIONS else folders)
                for key, part in tree.items()
            }
        if isinstance(tree, list):
            return [self.in_place(part, folders) for part in tree]
        return self._in_place(tree, folders) if isinstance(tree, str) else tree

    def _in_place(self, text: str, folders: Sequence[Path]) -> Any:
        law = _laws().get(text, text)
        if MODULE.fullmatch(law) and not law.rpartition(":")[0].endswith(CODE):
            return [text, law, self._code(law.rpartition(":")[0])]
        said = _file_of(text)
        places = (said, *((folder / said).absolute() for folder in folders))
        path = next((place for place in places if place.is_absolute() and _is_file(place)), None)
        if path is None:
            return text
        if path not in self._known:
            self._known[path] = _Found()  # of one that names itself
            inner = self.anew()
            digest = inner._file(path)
            self._known[path] = _Found(digest, frozenset(inner.files), inner.packages)
        found = self._known[path]
        self.files |= found.files
        self.packages |= found.packages
        file, _, name = text.rpartition(":")
        return [name if file.endswith(CODE) else "", found.digest]

    def _file(self, path: Path) -> str:
        if path.suffix == CODE:
            return self._code(str(path))
        own, named = self._content([path]), []
        if path.suffix in TREES:
            tree = _tree(path)
            named = [self.in_place(list(_texts(tree)), [path.parent])]
            if model := _flight_model(tree, path.parent):
                files = _flight_model_files(model)
                named += [[os.path.relpath(file, model) for file in files], self._content(files)]
        return self._digest([own, named])

    def _code(self, place: str) -> str:
        code = code_of(place)
        self.packages.update(code.packages)
        return self._digest([self._content(code.files), dict(code.packages)])

    def _content(self, files: Sequence[Path]) -> list[list[str]]:
        self.files.update(files)
        return [] if self._digest_of is None else [[file.name, self._digest_of(file)] for file in files]

    def _digest(self, content: Any) -> str:
        return "" if self._digest_of is None else digest_of_plain(content)


def digest_of_plain(content: Any) -> str:
    """SHA-256 (hex) of what JSON can say; the order of keys does not count."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


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


def _folder_of_code(part: Mapping[str, Any]) -> list[Path]:
    """Where the file of an agent or a function lies; nothing of what is no such part, or of a module."""
    texts = [text for key in ("class", "function") if isinstance(text := part.get(key), str)]
    return [file.parent for file in map(_file_of, texts) if file.suffix == CODE]


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


def _flight_model_files(model: Path) -> list[Path]:
    """The files of a flight model, and what they include, by name."""
    found: set[Path] = set()
    for file in model.rglob("*.xml"):
        _add_included(file, model, found)
    return sorted(found)


def _add_included(file: Path, model: Path, found: set[Path]) -> None:
    """Take a file of a flight model and what it includes, named as seen from the model, with or without ``.xml``."""
    if file in found or not file.is_file():
        return
    found.add(file)
    with suppress(OSError, ElementTree.ParseError):  # whoever loads it says what is wrong
        for part in ElementTree.parse(file).iter():
            if name := part.get("file", "").removesuffix(".xml"):
                _add_included((model / f"{name}.xml").resolve(), model, found)
