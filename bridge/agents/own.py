"""Finds an agent that is not part of lostlink: in a Python file, or in a module that can be imported."""

from __future__ import annotations

import inspect
from pathlib import Path
from types import FunctionType

from bridge.agents.agent import Agent
from bridge.scenario.own.agent_class import AWAITED, IS_ASYNC, IS_GENERATOR, IS_PLAIN, NO_AGENT, PLAIN_METHODS
from bridge.scenario.own.calls import CALLED_WITH, wrong_call
from sitl_configs.own_code import OwnCodeError, load_module


def load_class(place: str, name: str, node: str = "") -> type[Agent]:
    """The subclass of `Agent` called ``name`` in ``place``, a file that ends in .py or a module, for a node.

    Raises:
        OwnCodeError: there is none, or the code in ``place`` raises as it is loaded: that is then the cause.
    """
    # Loaded anew for each UA, also where several share a process: what a module keeps is then that UA's own, and a run
    # does not depend on how UA are spread over processes. Nor does its name, which is in texts and pickles of its
    # classes.
    found = getattr(load_module(place, f"{Path(place).stem}__{node}" if node else ""), name, None)
    if not isinstance(found, type):
        raise OwnCodeError(f"{place} has no class {name}")
    if not issubclass(found, Agent):
        raise OwnCodeError(f"{name} in {place} {NO_AGENT}")
    for method in PLAIN_METHODS:
        if inspect.iscoroutinefunction(getattr(found, method)):
            raise OwnCodeError(f"{name}.{method} in {place} {IS_ASYNC}")
    if inspect.isasyncgenfunction(found.fly):
        raise OwnCodeError(f"{name}.{AWAITED} in {place} {IS_GENERATOR}")
    if inspect.isfunction(found.fly) and not (
        inspect.iscoroutinefunction(found.fly) or hasattr(found.fly, "__wrapped__")
    ):
        raise OwnCodeError(f"{name}.{AWAITED} in {place} {IS_PLAIN}")
    for method, given in CALLED_WITH.items():
        function = inspect.getattr_static(found, method)
        if not isinstance(function, FunctionType) or hasattr(function, "__wrapped__"):
            continue  # what is decorated may take anything
        if method == "__init__" and type(found).__call__ is not type.__call__:
            continue  # its metaclass makes it
        if wrong := wrong_call(inspect.signature(function), given, "self"):
            code = function.__code__
            raise OwnCodeError(f"{code.co_filename}:{code.co_firstlineno}: {name}.{method} {wrong}")
    return found
