"""What all kinds of expectations are made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from pydantic import AfterValidator, ConfigDict, Field

from bridge.scenario.parts import Part
from sitl_configs.settings import refused

Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]


def _rising(interval: tuple[float, float]) -> tuple[float, float]:
    begin, end = interval
    if begin > end:
        raise ValueError(f"[{begin:g}, {end:g}]: nothing lies between these; write [{end:g}, {begin:g}]")
    return interval


Interval = Annotated[tuple[Seconds, Seconds], AfterValidator(_rising)]
"""From and to, both inside."""
Nodes = Mapping[str, tuple[str, ...]]


class ExpectationPart(Part):
    """Common to all.

    Attributes:
        name: what reports call it; made of what it says unless given.
        may_name_emitters: whether it is about where nodes are, and not about what they send, hear or log.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)
    may_name_emitters: ClassVar[bool] = False

    name: str = ""


def check_bounds(at_least: float | None, at_most: float | None, unit: str = "") -> None:
    """See that something lies between two bounds.

    Args:
        at_least: the lower bound; None: there is none.
        at_most: the upper one.
        unit: what the names of their keys end in.

    Raises:
        ValueError: nothing does.
    """
    if at_least is not None and at_most is not None and at_least > at_most:
        raise refused(f"{at_most:g} is below at_least{unit}, {at_least:g}: nothing is both", f"at_most{unit}")


def bounds(at_least: float | None, at_most: float | None, unit: str = "") -> str:
    """Bounds in words; None: there is none."""
    words = (("at least", at_least), ("at most", at_most))
    return " and ".join(f"{word} {bound:g}{unit}" for word, bound in words if bound is not None)


def when(between_s: Interval | None) -> list[str]:
    """An interval in words; none for all of the run."""
    return [] if between_s is None else [f"from {between_s[0]:g} to {between_s[1]:g} s"]


def by_radio(radio: str | None) -> list[str]:
    """A radio network in words; none for all of them."""
    return [] if radio is None else [f"by {radio}"]
