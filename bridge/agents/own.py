"""Finds an agent that is not part of lostlink: in a Python file, or in a module that can be imported."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from bridge.agents.agent import Agent


class AgentError(ValueError):
    """There is no such agent; the text says where it was looked for."""


def load_class(place: str, name: str) -> type[Agent]:
    """The subclass of `Agent` called ``name`` in ``place``, a file that ends in .py or a module.

    Raises:
        AgentError: if there is none. What the code in ``place`` itself raises is passed on.
    """
    module = _from_file(Path(place)) if place.endswith(".py") else _installed(place)
    found = getattr(module, name, None)
    if not isinstance(found, type):
        raise AgentError(f"{place} has no class {name}")
    if not issubclass(found, Agent):
        raise AgentError(f"{name} in {place} is no subclass of bridge.agents.Agent")
    return found


def _from_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise AgentError(f"{path}: no such file (looked from {Path.cwd()})")
    if path.stem in sys.modules:
        raise AgentError(f"{path}: {path.stem} is the name of a module in use; give the file another name")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None, "a name that ends in .py has a loader"
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    sys.path.insert(0, str(path.parent.resolve()))
    spec.loader.exec_module(module)
    return module


def _installed(module: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and (module == error.name or module.startswith(f"{error.name}.")):
            raise AgentError(f"no module {module}: neither installed nor in {Path.cwd()}") from error
        raise
