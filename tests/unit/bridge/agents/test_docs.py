"""The page on agents has the methods' own names and defaults, and so have the daemon's commands."""

from __future__ import annotations

import inspect
import re
from operator import attrgetter
from pathlib import Path

import pytest

from aps.vehicle.commander import argument_names
from bridge.agents import Agent, UaClient
from bridge.scenario.file import read_scenario

PAGE = Path(__file__).parents[4] / "docs" / "reference" / "agents.md"
WRITTEN = re.compile(r"[`(.]?(self\.|self\.ua\.|\.)(\w+)\(([a-z_]+[^()`]*)\)")
METHODS = (
    "take_off",
    "goto",
    "goto_ned",
    "velocity",
    "follow",
    "orbit",
    "takeoff",
    "change_speed",
    "transmit",
)


def on_the_page() -> list[tuple[str, str]]:
    """Each call in the table of what an agent can do: its name and its arguments."""
    rows = PAGE.read_text(encoding="utf-8").split("| to | call |")[1].split("\n\n")[0]
    return [(name, arguments) for _, name, arguments in WRITTEN.findall(rows) if name in METHODS]


def test_every_method_is_on_the_page() -> None:
    assert {name for name, _ in on_the_page()} == set(METHODS)


@pytest.mark.parametrize(("name", "written"), on_the_page())
def test_a_signature_on_the_page_is_the_methods(name: str, written: str) -> None:
    method = getattr(Agent if name == "take_off" else UaClient, name)
    parameters = dict(list(inspect.signature(method).parameters.items())[1:])
    given = dict([*each.split("="), ""][:2] for each in written.split(", "))
    assert [each for each in parameters if each in given] == list(given)
    assert {each for each, one in parameters.items() if one.default is one.empty} <= given.keys()
    for each, default in given.items():
        if default != "...":
            wanted = parameters[each].default
            assert default == ("" if wanted is inspect.Parameter.empty else repr(wanted).replace("'", '"'))


@pytest.mark.parametrize("name", ["goto", "follow", "orbit", "takeoff"])
def test_a_place_has_the_names_that_the_command_has(name: str) -> None:
    parameters = list(inspect.signature(getattr(UaClient, name)).parameters)
    places = [each for each in parameters if each.startswith(("lat", "lon", "alt"))]
    assert places == [each for each in argument_names(name) if each.startswith(("lat", "lon", "alt"))]
    assert places[-1] == "alt_rel_m"


def test_the_parts_of_its_scenario_on_the_page_are_there() -> None:
    own = read_scenario("separation").ua[0]
    written = re.findall(r"`self\.config\.([\w.]+)`", PAGE.read_text(encoding="utf-8"))
    assert written
    assert all(attrgetter(name)(own) is not None for name in written)
