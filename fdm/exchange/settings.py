"""The settings of an exchange, in one process or over several."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Literal, TypedDict, get_args

from fdm.clock.events import UaEvent
from fdm.clock.status import ClockSettings, ClockStatus, nanoseconds
from fdm.model.truth import TrueState

Workers = int | Literal["auto"]
"""How many processes; see fdm.workers.fleet_exchange.worker_count."""
Coupling = Literal["serial", "parallel"]
"""Who computes when, autopilot and physics in turns or at the same time; see fdm.exchange.exchange.Exchange."""

Placement = Literal["auto", "spread", "shared"]
"""On which cores exchange and autopilots run; see fdm.exchange.exchange.Exchange."""


class ExchangeSettings(TypedDict, total=False):
    """The settings that both kinds of exchange take; see fdm.exchange.exchange.Exchange."""

    host: str
    coupling: Coupling
    placement: Placement
    speed: float
    window_ns: int | None
    stall_timeout_s: float
    tick_period_ns: int
    hold_ticks: bool
    start_together: bool
    start_timeout_s: float
    on_truth: Callable[[TrueState], object] | None
    on_tick: Callable[[ClockStatus], object] | None
    on_event: Callable[[UaEvent], object] | None


DEFAULTS: ExchangeSettings = {
    "host": "127.0.0.1",
    "coupling": "serial",
    "placement": "auto",
    "speed": 1.0,
    "window_ns": None,
    "stall_timeout_s": 1.0,
    "tick_period_ns": 50_000_000,
    "hold_ticks": False,
    "start_together": True,
    "start_timeout_s": 60.0,
    "on_truth": None,
    "on_tick": None,
    "on_event": None,
}
FOR_WORKERS = frozenset(
    {
        "coupling",
        "placement",
        "speed",
        "window_ns",
        "stall_timeout_s",
        "tick_period_ns",
        "start_together",
        "start_timeout_s",
    }
)


def core_count() -> int:
    """How many cores this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def check_coupling(coupling: str) -> None:
    """See that `coupling` is one.

    Raises:
        ValueError: it is not.
    """
    if coupling not in get_args(Coupling):
        raise ValueError(f"coupling = {coupling!r}: must be one of {', '.join(get_args(Coupling))}")


def check_placement(placement: str) -> None:
    """See that `placement` is one.

    Raises:
        ValueError: it is not.
    """
    if placement not in get_args(Placement):
        raise ValueError(f"placement = {placement!r}: must be one of {', '.join(get_args(Placement))}")


def check_settings(ids: Sequence[int], workers: int, options: ExchangeSettings) -> None:
    """See that the settings of a fleet of the UA `ids` are in their ranges.

    Raises:
        ValueError: one is not.
    """
    if not ids:
        raise ValueError("a fleet needs at least one UA")
    if len(set(ids)) != len(ids):
        raise ValueError(f"ua_id twice in {ids}")
    check_coupling(options["coupling"])
    check_placement(options["placement"])
    if not 1 <= workers <= len(ids):
        raise ValueError(f"workers = {workers}: must be from 1 to {len(ids)}, the number of UA")
    ClockSettings(
        speed=options["speed"],
        window_ns=options["window_ns"],
        tick_period_ns=options["tick_period_ns"],
        stall_timeout_ns=nanoseconds("stall_timeout_s", options["stall_timeout_s"]),
        start_timeout_ns=nanoseconds("start_timeout_s", options["start_timeout_s"]),
    )
