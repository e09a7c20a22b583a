"""The radios that a scenario names by file, in the run's directory: with them a record is read wherever it lies.

`radios/lab.yaml` is a radio whole: with what it extends and its tables. Maps and terrain lie beside. What is code stays
where it is, named by the scenario (`lostlink.reading.moved` finds it), and so do files that are too large to be copied
for each run.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from bridge.scenario.document.files import YAML
from sitl_configs.yaml_text import yaml_of

RADIO_FOLDER: Final = "radios"
CODE: Final = ".py:"
Change = Callable[[Any], Any]
LARGE_BYTES: Final = 8 << 20
"""Maps above this are not copied: each run of a study has its own."""
OF_MANY_FILES: Final = frozenset((".vrt", ".asc", ".hgt", ".img", ".bil", ".flt"))
"""Maps whose format has other files beside, or a meaning in the file's name."""
BESIDE: Final = (".tfw", ".wld", ".prj", ".hdr", ".ovr", ".msk", ".aux.xml")
"""What GDAL reads with a map of the same name."""


def with_radios_carried(content: dict[str, Any], run: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Copy the radios of a scenario into a run's directory.

    Gives the scenario as seen from there, and of each file that was copied where it came from.

    Args:
        content: of the scenario, with absolute paths.
        run: the directory.

    Raises:
        OSError: it cannot be written.
        PresetError: a radio's file cannot be read.
    """
    carried = _Carried(run / RADIO_FOLDER)
    return _with_radios(content, carried.setting), carried.origins


def with_radios_placed(content: dict[str, Any], run: Path, origins: Mapping[str, str]) -> dict[str, Any]:
    """The same scenario with absolute paths again: of where its radios came from, if they are there.

    A process that is forked has read those already; GDAL does not work in both.
    """

    def path_of(name: str) -> str:
        origin = origins.get(name, "")
        return origin if os.path.isfile(origin) else str(run / name)  # noqa: PTH113

    with suppress(AttributeError, TypeError):  # of what is no scenario: its validation says what is wrong
        return _with_radios(content, lambda setting: _placed(setting, path_of))
    return content


def _with_radios(content: dict[str, Any], change: Change) -> dict[str, Any]:
    def of_node(node: dict[str, Any]) -> dict[str, Any]:
        own: dict[str, Change] = {"radio": change, "sensor": of_node}
        return {key: own[key](part) if key in own and part else part for key, part in node.items()}

    changed: dict[str, Change] = {
        "radio": change,
        "networks": lambda networks: {name: change(radio) for name, radio in networks.items()},
        "nodes": lambda nodes: [of_node(node) for node in nodes],
    }
    return {key: changed[key](part) if key in changed else part for key, part in content.items()}


def _placed(setting: Any, path_of: Callable[[str], str]) -> Any:
    """A radio, or part of one, with absolute paths of what was carried."""
    if isinstance(setting, dict):
        return {
            key: _placed(part, path_of) if isinstance(part, dict) or key in ("preset", "file") else part
            for key, part in setting.items()
        }
    is_carried = isinstance(setting, str) and setting.startswith(f"{RADIO_FOLDER}/")
    return path_of(setting) if is_carried else setting


class _Carried:
    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._names: dict[Path, str] = {}
        self._code: dict[Path, dict[str, Any]] = {}
        """By radio, its parts that are models of the user's own: the scenario has them, so that they can be found."""

    @property
    def origins(self) -> dict[str, str]:
        """Where each file came from, by its path as seen from the run's directory."""
        return {f"{RADIO_FOLDER}/{name}": str(file) for file, name in self._names.items()}

    def setting(self, setting: Any) -> Any:
        """A radio as a scenario has it: a preset's name, a file, or a mapping, which may extend one."""
        from channel.presets import merged  # whoever only reads runs need not wait for it

        over = {"preset": setting} if isinstance(setting, str) else dict(setting)
        file = Path(str(over.get("preset", "")))
        if file.suffix in YAML and file.is_file():
            over["preset"] = f"{RADIO_FOLDER}/{self._radio(file)}"
            over = merged(self._code[file], over)
        over = self._with_maps(over, f"{RADIO_FOLDER}/")
        return over["preset"] if isinstance(setting, str) and len(over) == 1 else over

    def _radio(self, file: Path) -> str:
        from channel.presets import radio_tree

        if file not in self._names:
            name = self._names[file] = self._free_name(file)
            tree = radio_tree(file)
            self._code[file] = {key: part for key, part in tree.items() if _has_code(part)}
            whole = {key: part for key, part in tree.items() if key not in self._code[file]}
            if file != self._folder / name:
                text = yaml_of(self._with_maps(whole))
                (self._folder / name).write_text(text, encoding="utf-8")
        return self._names[file]

    def _with_maps(self, tree: Any, below: str = "") -> Any:
        """A radio, or part of one, with the maps that it names as seen from a folder."""
        if not isinstance(tree, dict):
            return tree
        return {
            key: self._map(part, below)
            if key == "file" and isinstance(part, str)
            else self._with_maps(part, below)
            for key, part in tree.items()
        }

    def _map(self, text: str, below: str) -> str:
        file = Path(text)
        if not file.is_file() or not _is_one_small_file(file):
            return text
        if file not in self._names:
            name = self._names[file] = self._free_name(file)
            if file != self._folder / name:
                shutil.copyfile(file, self._folder / name)
        return below + self._names[file]

    def _free_name(self, file: Path) -> str:
        """The file's name; with a number if another has it."""
        self._folder.mkdir(exist_ok=True)
        taken = {each.casefold() for each in self._names.values()}  # a file system may not tell case apart
        name, number = file.name, 1
        while name.casefold() in taken:
            number += 1
            name = f"{file.stem}-{number}{file.suffix}"
        return name


def _is_one_small_file(file: Path) -> bool:
    """Whether a map is a file that can be copied and read alone: GDAL reads what lies beside one, too."""
    if file.stat().st_size > LARGE_BYTES or file.suffix.lower() in OF_MANY_FILES:
        return False
    return not any(Path(f"{base}{end}").exists() for base in (file, file.with_suffix("")) for end in BESIDE)


def _has_code(tree: Any) -> bool:
    """Whether a part of a radio has a class in a file of the user's."""
    if isinstance(tree, list):
        return any(map(_has_code, tree))
    if not isinstance(tree, dict):
        return False
    return CODE in str(tree.get("class", "")) or any(map(_has_code, tree.values()))
