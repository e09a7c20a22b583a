"""Ports that runs on one machine share without meeting, whoever starts them.

Each run locks those of its ports by which others know it (`LOCKED`), from before it looks whether they are free until
its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from bridge.fleet.course import FleetError
from bridge.fleet.preflight.locks import hold
from bridge.fleet.preflight.open_files import allow_open_files
from bridge.fleet.preflight.ports import PortUse, conflicts, mistakes, ports_of, why_no_loopback
from bridge.scenario.model import Scenario

NAME = "lostlink-tcp"
"""How names of locks begin."""
LOCKED = ("ports.aps", "ports.autopilot", "ports.api", "ports.zenoh", "modems.")
"""Settings of the ports that are locked: of each UA those that are ports of another kind at another slot (autopilots
at slot s + 100 listen where MAVLink servers at slot s do), which stand for the rest of its slot; and those of no UA."""
FIRST_SLOT, LAST_SLOT = 20, 2249
"""Slots given out: below are those that people choose, and above ports that the kernel gives to clients."""
ATTEMPTS = 5
"""How often a run that may be anywhere is flown, as long as programs that know no locks take ports of it after the look
at them."""
LAST_INSTANCE = 249
"""Of real autopilots: the last slot that PX4 takes."""


def _see_machine(scenario: Scenario) -> None:
    allow_open_files(scenario)
    if why := why_no_loopback():
        raise FleetError(why)


@contextmanager
def at_own_ports(scenario: Scenario, *, repeats: bool = False) -> Iterator[Scenario]:
    """The scenario where it is: its ports are free, and no other run's for as long as the context lasts.

    Args:
        scenario: of the run.
        repeats: it repeats a record.

    Raises:
        FleetError: one is taken; the text says which, by whom if known, and what to do. Or there is no loopback, or
            too few files may be open.
        OSError: it cannot be locked.
    """
    _see_machine(scenario)
    with ExitStack() as held:
        uses = list(ports_of(scenario, repeats=repeats))
        taken = conflicts(uses, _lock(uses, held))
        if taken:
            raise FleetError("\n".join(taken))
        yield scenario


@contextmanager
def at_free_ports(scenario: Scenario, *, repeats: bool = False) -> Iterator[Scenario]:
    """The scenario at slots that no other run has, and any free port for Zenoh, for as long as the context lasts.

    Args:
        scenario: of the run.
        repeats: it repeats a record.

    Raises:
        FleetError: there are none; or a port that does not move with the slot is taken; or two of its own ports are
            one; or as `at_own_ports`.
        OSError: as `at_own_ports`.
    """
    _see_machine(scenario)
    count = max((ua.id for ua in scenario.ua), default=0) + 1
    last = LAST_INSTANCE if scenario.autopilots & {"ardupilot", "px4"} else LAST_SLOT
    moved = set(ports_of(_at(scenario, FIRST_SLOT + 1), repeats=repeats))
    first = list(ports_of(_at(scenario, FIRST_SLOT), repeats=repeats))
    if wrong := mistakes(first):  # at all others, too
        raise FleetError("\n".join(wrong))
    fixed = [use for use in first if use in moved]
    for slot in range(FIRST_SLOT, last - count + 2):
        with ExitStack() as held:
            placed = _at(scenario, slot)
            uses = list(ports_of(placed, repeats=repeats))
            taken = _lock(uses, held)
            if stuck := conflicts(fixed, taken):
                raise FleetError("\n".join(stuck))
            if not taken and not conflicts(uses):
                yield placed
                return
    raise FleetError(f"no {count} port slots in a row are free between {FIRST_SLOT} and {last}")


@contextmanager
def at_own_or_free_ports(scenario: Scenario, *, repeats: bool = False) -> Iterator[Scenario]:
    """As `at_own_ports`, and if one is taken, as `at_free_ports`; with the arguments and errors of both.

    A run that moves sends nothing to ``ports.gcs``: a ground station there is most likely that of the run whose ports
    these are, which has the same sysids.
    """
    with ExitStack() as held:
        try:
            placed = held.enter_context(at_own_ports(scenario, repeats=repeats))
        except FleetError:
            placed = held.enter_context(at_free_ports(_with(scenario, gcs=0), repeats=repeats))
        yield placed


def _at(scenario: Scenario, slot: int) -> Scenario:
    return _with(scenario, first_slot=slot, zenoh=0)


def _with(scenario: Scenario, **ports: int) -> Scenario:
    return scenario.model_copy(update={"ports": scenario.ports.model_copy(update=ports)})


def _lock(uses: list[PortUse], held: ExitStack) -> set[PortUse]:
    """Lock ports for a run; gives those that another has."""
    locked = (use for use in uses if use.setting.startswith(LOCKED))
    return {use for use in locked if not hold(f"{NAME}-{use.port}", held)}
