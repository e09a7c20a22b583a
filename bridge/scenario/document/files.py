"""Files that a scenario names, as absolute paths: each as seen from the file that names it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from bridge.scenario.document.merge import names_a_preset
from bridge.scenario.document.written import Path_, Written, WrittenPlace, plain, written_at

Find = Callable[[str], str]
"""Gives where the file of an absolute path, or of a class in one, lies now."""
YAML = (".yaml", ".yml")
CODE = (".py",)


def with_absolute_files(root: Written, find: Find = str) -> Written:
    """The scenario with absolute paths of radios, antennas, winds, airframes, own classes, tables, maps and options."""
    for path, leaf in list(root.leaves()):
        if path and isinstance(leaf.content, str) and (placed := _placer(path)):
            text = placed(leaf.content, leaf.place.folder)
            root = _put(root, path, Written(find(text) if text.startswith("/") else text, leaf.place))
    return root


def files_placed(content: Any, folder: Path, find: Find = str) -> Any:
    """What a scenario's file says, with its files as seen from a folder: as `with_absolute_files`, without places."""
    return plain(with_absolute_files(written_at(content, WrittenPlace("", None, folder)), find))


def _put(here: Written, path: Path_, leaf: Written) -> Written:
    if not path:
        return leaf
    below = here.get(path[0])
    assert below is not None, "the path came from here"
    return here.having(path[0], _put(below, path[1:], leaf))


def _placer(path: Path_) -> Callable[[str, Path], str] | None:
    """What makes the text at a path absolute; None for a text that names no file."""
    if names_a_preset(path):
        return _yaml_file
    last = path[-1]
    in_an_antenna = path[:1] == ("nodes",) and path[2:3] == ("antenna",)
    if in_an_antenna or any(names_a_preset(path[:length]) for length in (1, 2, 3, 4)):
        return _in_a_preset(str(last))
    if len(path) == 3 and path[0] == "nodes" and last == "airframe":
        return _yaml_file
    if "options" in _in_a_part_of_ones_own(path):
        return _any_file if _names_a_file(str(last)) else None
    if len(path) == 3 and path[0] == "expectations" and last == "function":
        return _class
    return _class if len(path) == 4 and path[0] == "nodes" and path[2:] == ("agent", "class") else None


def _in_a_part_of_ones_own(path: Path_) -> Path_:
    """Of the path into an agent or an expectation, its first step in there."""
    if path[:1] == ("nodes",) and path[2:3] == ("agent",):
        return path[3:4]
    return path[2:3] if path[:1] == ("expectations",) else ()


def _names_a_file(key: str) -> bool:
    return key == "file" or key.endswith("_file")


def _in_a_preset(key: str) -> Callable[[str, Path], str] | None:
    if key == "preset":
        return _yaml_file
    if key == "class":
        return _class
    return _any_file if _names_a_file(key) else None


def file_seen_from(folder: Path, name: str) -> Path:
    """The file of a name as seen from a folder; ``~/`` is the user's own."""
    return folder / (Path(name).expanduser() if name.startswith("~/") else name)


def _any_file(name: str, folder: Path) -> str:
    return str(file_seen_from(folder, name)) if name else name


def _yaml_file(name: str, folder: Path) -> str:
    return _any_file(name, folder) if Path(name).suffix in YAML else name


def _class(text: str, folder: Path) -> str:
    file, colon, name = text.rpartition(":")
    return f"{_any_file(file, folder)}:{name}" if colon and Path(file).suffix in CODE else text
