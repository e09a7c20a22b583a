"""Finds an agent that is not part of lostlink: in a Python file, or in a module that can be imported."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import itertools
import sys
from pathlib import Path
from types import FunctionType, ModuleType

from bridge.agents.agent import Agent
from bridge.scenario.agent_class import AWAITED, IS_ASYNC, IS_GENERATOR, IS_PLAIN, NO_AGENT, PLAIN_METHODS
from bridge.scenario.calls import CALLED_WITH, wrong_call
from bridge.scenario.resolve.modules import NOT_THERE, put_first

PACKAGES = ("aps", "bridge", "channel", "fdm", "standin")
_numbers = itertools.count()


class AgentError(ValueError):
    """There is no such agent; the text says where it was looked for."""


def load_class(place: str, name: str, node: str = "") -> type[Agent]:
    """The subclass of `Agent` called ``name`` in ``place``, a file that ends in .py or a module, for a node.

    Raises:
        AgentError: if there is none, or the code in ``place`` raises as it is loaded: that is then the cause.
    """
    found = getattr(_loaded(place, node), name, None)
    if not isinstance(found, type):
        raise AgentError(f"{place} has no class {name}")
    if not issubclass(found, Agent):
        raise AgentError(f"{name} in {place} {NO_AGENT}")
    for method in PLAIN_METHODS:
        if inspect.iscoroutinefunction(getattr(found, method)):
            raise AgentError(f"{name}.{method} in {place} {IS_ASYNC}")
    if inspect.isasyncgenfunction(found.fly):
        raise AgentError(f"{name}.{AWAITED} in {place} {IS_GENERATOR}")
    if inspect.isfunction(found.fly) and not (
        inspect.iscoroutinefunction(found.fly) or hasattr(found.fly, "__wrapped__")
    ):
        raise AgentError(f"{name}.{AWAITED} in {place} {IS_PLAIN}")
    for method, given in CALLED_WITH.items():
        function = inspect.getattr_static(found, method)
        if not isinstance(function, FunctionType) or hasattr(function, "__wrapped__"):
            continue  # what is decorated may take anything
        if method == "__init__" and type(found).__call__ is not type.__call__:
            continue  # its metaclass makes it
        if wrong := wrong_call(inspect.signature(function), given, "self"):
            code = function.__code__
            raise AgentError(f"{code.co_filename}:{code.co_firstlineno}: {name}.{method} {wrong}")
    return found


def _loaded(place: str, node: str) -> ModuleType:
    try:
        return load_module(place, node)
    except AgentError:
        raise
    except BaseException as error:  # somebody's own code, which may also call sys.exit
        raise AgentError(f"{type(error).__name__} while {place} is loaded: {error}") from error


def load_module(place: str, node: str = "") -> ModuleType:
    """The module in ``place``, a file that ends in .py or a module's name.

    Args:
        place: where it is.
        node: whose agent is in it, if it is a node's: then a file's module has that in its name.

    Raises:
        AgentError: there is none. What its code itself raises is passed on.
    """
    return _from_file(Path(place), node) if place.endswith(".py") else _installed(place)


def _from_file(path: Path, node: str) -> ModuleType:
    if not path.is_file():
        raise AgentError(f"{path}: no such file (looked from {Path.cwd()})")
    # Loaded anew for each UA, also where several share a process: what a module keeps is then that UA's own, and a run
    # does not depend on how UA are spread over processes. (Modules that the file imports are shared.) Nor does its
    # name, which is in texts and pickles of its classes.
    name = f"{path.stem}__{node}" if node else f"{path.stem}___{next(_numbers)}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None, "a name that ends in .py has a loader"
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    for ours in PACKAGES:  # before the folder comes first: a file there may have the name of one
        importlib.import_module(ours)
    put_first(path.parent.resolve())
    spec.loader.exec_module(module)
    return module


def _installed(module: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and (module == error.name or module.startswith(f"{error.name}.")):
            raise AgentError(f"no module {module}: {NOT_THERE}") from error
        raise
