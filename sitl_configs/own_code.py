"""Loads code of the user's: agents, functions and models, from a Python file or a module that can be imported."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import itertools
import json
import os
import sys
import sysconfig
import traceback
from pathlib import Path
from types import ModuleType
from typing import Final

OURS = frozenset(("aps", "bridge", "channel", "fdm", "lostlink", "sitl_configs", "standin"))
"""Packages of lostlink, which has a version."""
NOT_THERE = "neither installed nor on PYTHONPATH"
_NOT_THEIRS: Final = (
    "<",
    *(f"{Path(__file__).parents[1] / package}{os.sep}" for package in OURS),
    *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")),
)
"""What the names of files begin with that are no user's: Python's, those of installed packages, and ours."""
PATH_VARIABLE: Final = "LOSTLINK_SYS_PATH"
"""Of a process of a run: where imports look in the one that started it, in a script's folder, say; JSON."""
_numbers = itertools.count()
_put_first: set[str] = set()
if PATH_VARIABLE in os.environ:
    sys.path[:] = json.loads(os.environ.pop(PATH_VARIABLE))


class OwnCodeError(ValueError):
    """Code of the user's cannot be loaded; the text says where, as ``FILE:LINE`` where a line raised, and why."""


def load_module(place: str, name: str = "") -> ModuleType:
    """The module in ``place``, a file that ends in .py or a module's name.

    A file is loaded anew each time, and may import what lies beside it; modules that it imports are shared.

    Args:
        place: where it is.
        name: what a file's module is called; unless given, by a name that no other has.

    Raises:
        OwnCodeError: there is none, or its code raises as it is loaded: that is then the cause.
    """
    try:
        return _from_file(Path(place), name) if place.endswith(".py") else _installed(place)
    except OwnCodeError:
        raise
    except (Exception, SystemExit) as error:  # somebody's own code, which may also call sys.exit
        raise OwnCodeError(told(error, place)) from error


def told(error: BaseException, place: str = "") -> str:
    """What code of the user's raised, in a line: ``FILE:LINE: Type: text``; of no line of theirs the place for it."""
    text = str(error)
    if isinstance(error, SyntaxError) and error.filename is not None:
        place, text = f"{error.filename}:{error.lineno}", error.msg
    elif line := innermost(traceback.extract_tb(error.__traceback__)):
        place = f"{line.filename}:{line.lineno}"
    return ": ".join(part for part in (place, type(error).__name__, text) if part).partition("\n")[0]


def line_in_words(line: traceback.FrameSummary) -> str:
    """A line of code, as ``agent.py, line 12 (on_tick)``."""
    return f"{Path(line.filename).name}, line {line.lineno} ({line.name})"


def innermost(lines: traceback.StackSummary) -> traceback.FrameSummary | None:
    """The innermost line of a user's code, None if there is none."""
    return next((line for line in reversed(lines) if not line.filename.startswith(_NOT_THEIRS)), None)


def is_own(found: type) -> bool:
    """Whether a class is a user's, and not of lostlink."""
    return found.__module__.partition(".")[0] not in OURS


def put_first(folder: Path) -> None:
    """Have imports look in the folder of a file before all else, as the code in it expects."""
    text = str(folder)
    if text not in sys.path:
        sys.path.insert(0, text)
        _put_first.add(text)


def path_of_others() -> list[str]:
    """Where imports look, without the folders of files that were put first; absolute, but for what no file has.

    That is for a hook: editable installs of packages without an ``__init__`` have such a name.
    """
    names = [each for each in sys.path if isinstance(each, str) and each not in _put_first]
    return [os.path.abspath(each) if not each or os.path.exists(each) else each for each in names]  # noqa: PTH100, PTH110


def _from_file(path: Path, name: str) -> ModuleType:
    if not path.is_file():
        raise OwnCodeError(f"{path}: no such file (looked from {Path.cwd()})")
    name = name or f"{path.stem}___{next(_numbers)}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None, "a name that ends in .py has a loader"
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    for ours in OURS - {"lostlink"}:  # before the folder comes first: a file there may have the name of one
        importlib.import_module(ours)
    put_first(path.parent.resolve())
    try:
        spec.loader.exec_module(module)
        _see_neighbours(path)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _see_neighbours(path: Path) -> None:
    """See that a file has got what lies beside it, and not what has that name beside another file."""
    for name in _imported_by(path):
        beside, found = path.parent.resolve() / f"{name}.py", getattr(sys.modules.get(name), "__file__", None)
        if (
            found is None
            or not beside.is_file()
            or str(Path(found).parent) not in _put_first - {str(beside.parent)}
        ):
            continue
        if Path(found).read_bytes() != beside.read_bytes():
            raise OwnCodeError(
                f"{path} imports {name}, and {found} has that name, too: rename it or {beside}, or have one folder"
            )


def _imported_by(path: Path) -> set[str]:
    """Names of the modules and packages that a file imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            found.update(each.name.partition(".")[0] for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


def _installed(module: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{module}.".startswith(f"{error.name}."):
            raise OwnCodeError(f"no module {module}: {NOT_THERE}") from error
        raise
