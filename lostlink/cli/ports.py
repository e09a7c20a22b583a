"""Where a command's run has its ports: ``--first-slot``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Literal, TypeVar

import click

from bridge.fleet.preflight.slots import at_own_or_free_ports, at_own_ports
from bridge.scenario.model import Scenario
from lostlink.cli.exits import tell
from lostlink.cli.number_or_word import SLOT

F = TypeVar("F", bound=Callable[..., Any])
FirstSlot = int | Literal["auto"] | None
"""What ``--first-slot`` gives; None: it was not given."""


def first_slot_option(command: F) -> F:
    """Add ``--first-slot`` to a command, as ``first_slot``."""
    return click.option(
        "--first-slot",
        type=SLOT,
        help="Move the ports of all UA by ten times this; auto: to free ones, if any of the run's is in use.",
    )(command)


def slot_asked(first_slot: FirstSlot) -> int | None:
    """What it changes of the scenario; None: nothing."""
    return None if first_slot == "auto" else first_slot


@contextmanager
def at_ports(scenario: Scenario, first_slot: FirstSlot, *, repeats: bool = False) -> Iterator[Scenario]:
    """The scenario at the ports of a run, which no other has as long as the context lasts; says so if it moved.

    Args:
        scenario: of the run, at the slot that was asked for.
        first_slot: what was asked for.
        repeats: it repeats a record.

    Raises:
        FleetError: there are none; the text says what to do.
        OSError: they cannot be locked.
    """
    place = at_own_or_free_ports if first_slot == "auto" else at_own_ports
    with ExitStack() as held:
        placed = held.enter_context(place(scenario, repeats=repeats))
        if placed != scenario:
            _tell_move(scenario, placed)
        yield placed


def _tell_move(scenario: Scenario, placed: Scenario) -> None:
    text = f"ports of the run are in use: it moves to --first-slot {placed.ports.first_slot}"
    for ua in placed.ua[:1]:
        text += f", with MAVLink from TCP port {placed.aps_port(ua)} on"
        if len(placed.udp_outputs(ua)) < len(scenario.udp_outputs(ua)):
            text += f" and none sent to UDP port {scenario.ports.gcs} (--udp-out sends it)"
    if placed.ports.zenoh != scenario.ports.zenoh:
        text += "; Zenoh is at any free port"
    tell(text)
