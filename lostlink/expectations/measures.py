"""What measures of the user's own show: values that agents logged, and functions of the whole record."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from pathlib import Path

from bridge.record.logged import LoggedValue, logged_of
from bridge.record.tables.logged import leaves
from bridge.scenario.model import Scenario
from bridge.scenario.own_measures import FunctionExpectation, LoggedExpectation
from lostlink.reading.run import load_run
from sitl_configs.own_code import OwnCodeError, load_module


class MeasureError(ValueError):
    """A measure says nothing that can be judged; the text says which and why."""


def share_within(run: Path, scenario: Scenario, wanted: LoggedExpectation) -> float | None:
    """The share of logged numbers within the bounds: the least of any node that logged some; None if none did.

    Raises:
        MeasureError: something else than numbers was logged under that name.
        ValueError, OSError: what agents logged is damaged, or cannot be read.
    """
    nodes = scenario.transceiver_ids if wanted.node is None else (wanted.node,)
    logged = ([wanted.holds(value) for value in _numbers(run, node, wanted)] for node in nodes)
    return min((sum(held) / len(held) for held in logged if held), default=None)


def _numbers(run: Path, node: str, wanted: LoggedExpectation) -> Iterator[float]:
    begin_s, until_s = wanted.between_s or (0.0, float("inf"))
    for tick_ns, item in logged_of(run, node):
        if (
            isinstance(item, LoggedValue)
            and item.name == wanted.value
            and begin_s <= tick_ns / 1e9 <= until_s
        ):
            values = dict(leaves(item.value))
            value = values.get(wanted.key or "")
            if value is None or isinstance(value, str | list | dict):
                under = f" under {wanted.key!r}" if wanted.key else ""
                keys = f": give one of the keys {', '.join(values)}" if "" not in values else ""
                raise MeasureError(
                    f"node {node} logged {item.value!r} at {tick_ns / 1e9:g} s, which has no number{under}{keys}"
                )
            yield float(value)


def measured(run: Path, wanted: FunctionExpectation) -> float | bool:
    """What a function says of a run.

    Raises:
        MeasureError: there is no such function, it raises, or gives neither a number nor, without bounds, whether it
            holds.
    """
    try:
        function = getattr(load_module(wanted.place), wanted.function_name, None)
        if not callable(function):
            raise MeasureError(f"{wanted.place} has no function {wanted.function_name}")
        found = function(load_run(run), **wanted.options)
        found = found.item() if hasattr(found, "item") else found
    except (OwnCodeError, MeasureError) as error:
        raise MeasureError(str(error)) from error
    except (Exception, SystemExit) as error:
        raise MeasureError(f"{wanted.function} raised {type(error).__name__}: {error}") from error
    if (
        wanted.has_bounds
        and isinstance(found, int | float)
        and not isinstance(found, bool)
        and isfinite(found)
    ):
        return float(found)
    if isinstance(found, bool) and not wanted.has_bounds:
        return found
    kind = "a number" if wanted.has_bounds else "True or False, or bounds for a number"
    raise MeasureError(f"{wanted.function} gave {found!r}; wanted is {kind}")
