"""Forks of a command that wait to be the processes of its run."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

from bridge.fleet import many, one
from bridge.fleet.children.forked import Play, Understudy, can_fork
from bridge.fleet.hosts import host_groups
from bridge.fleet.how import how_joined
from bridge.scenario.model import Scenario

COMMAND_WORDS = len(one.PROGRAM)
"""Interpreter, flag, -m and module: what a command of ours has before its own words."""


def understudies_of(scenario: Scenario) -> Mapping[str, Understudy]:
    """A fork of this process for each of ours that the run needs, by its name; none where they have to be started anew.

    What several of them need is imported here, once. It is to be done before anything that has a thread.
    """
    how = how_joined(scenario)
    if how == "task" or not can_fork():
        return {}
    if how == "one":
        import_module("scipy.special")  # both need it, and it takes a quarter of a second
        return {one.NAME: _understudy(one.MODULE)}
    modules = many.modules_of(host_groups(scenario))
    for module in set(modules.values()):
        import_module(module)
    return {name: _understudy(module) for name, module in modules.items()}


def _understudy(module: str) -> Understudy:
    def load() -> Play:
        play: Play = import_module(module).main  # and with it all that it needs
        return play

    return Understudy(COMMAND_WORDS, load)
