"""Where Python finds the modules that code of the user's imports; nothing of them is run.

An import of ``a.b`` runs ``a``, and so does `importlib.util.find_spec`: here each part is looked for in the folders of
the part before.
"""

from __future__ import annotations

import os
import pkgutil
import site
import sys
from collections.abc import Sequence
from functools import cache
from importlib import metadata
from importlib.machinery import BuiltinImporter, FrozenImporter, ModuleSpec, PathFinder
from pathlib import Path

from sitl_configs.own_code import path_of_others

CODE = ".py"
_SITES = frozenset(site.getsitepackages())


class Modules:
    """The modules that a file, or a module of the user's, can import.

    Args:
        place: the file (ending in .py), whose folder is looked in first, or the module.
    """

    def __init__(self, place: str) -> None:
        self._beside = [str(Path(place).absolute().parent)] if place.endswith(CODE) else []
        self.path = (*self._beside, *path_of_others())  # folders of other files are not for it

    def found(self, name: str) -> list[ModuleSpec]:
        """The packages around a module and itself, outermost first, as far as they are there; none of the stdlib's."""
        top = name.partition(".")[0]
        if top in sys.stdlib_module_names and not found_in(top, self._beside):
            return []
        return found_in(name, self.path) or found_elsewhere(name)


def found_in(name: str, folders: Sequence[str]) -> list[ModuleSpec]:
    """The same of a name as seen from some folders, for a relative import say."""
    specs: list[ModuleSpec] = []
    for part in name.split("."):
        spec = _found(part, folders)
        if spec is None:
            break
        specs.append(spec)
        folders = spec.submodule_search_locations or ()
    return specs


def found_elsewhere(name: str) -> list[ModuleSpec]:
    """The same of a package that is not in Python's path: some editable installs have finders of their own."""
    top, _, rest = name.partition(".")
    for finder in sys.meta_path:
        if finder in (BuiltinImporter, FrozenImporter, PathFinder) or not hasattr(finder, "find_spec"):
            continue
        if (spec := finder.find_spec(top, None)) is not None:
            return [spec, *(found_in(rest, spec.submodule_search_locations or ()) if rest else [])]
    return []


def _found(part: str, folders: Sequence[str]) -> ModuleSpec | None:
    portions: list[str] = []
    for folder in folders:
        finder = pkgutil.get_importer(folder)
        spec = None if finder is None else finder.find_spec(part)
        if spec is not None and spec.loader is not None:
            return spec
        portions += (spec and spec.submodule_search_locations) or []
    if not portions:
        return None
    namespace = ModuleSpec(part, None, is_package=True)
    namespace.submodule_search_locations = portions
    return namespace


def file_of(spec: ModuleSpec) -> Path | None:
    """The file of a module or package, None where it has none."""
    return Path(spec.origin) if spec.origin and os.path.isfile(spec.origin) else None  # noqa: PTH113


def installed(top: ModuleSpec) -> dict[str, str]:
    """Name and version of the packages that have installed an outermost module where it is; none: it is just there.

    An editable install is just there, as its files may change while its version stays.
    """
    places = top.submodule_search_locations or ([top.origin] if top.origin else [])
    distributions = [
        each for place in places for each in _installed_in(str(Path(place).parent)).get(top.name, ())
    ]
    return {each.name: each.version for each in distributions}


@cache
def _installed_in(folder: str) -> dict[str, list[metadata.Distribution]]:
    """What is installed in a folder, by the outermost names of its modules."""
    found: dict[str, list[metadata.Distribution]] = {}
    for each in metadata.distributions(path=[folder]):
        files = each.read_text("RECORD") or ""
        if not files and folder in _SITES:  # of a system's own packages
            files = each.read_text("top_level.txt") or ""
        for name in {
            line.partition(",")[0].partition("/")[0].partition(".")[0] for line in files.split("\n")
        }:
            found.setdefault(name, []).append(each)
    return found
