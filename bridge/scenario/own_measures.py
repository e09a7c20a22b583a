"""Expectations on measures of the user's own: what agents logged, and functions of the whole record."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, JsonValue, model_validator

from bridge.scenario.expectation_parts import (
    ExpectationPart,
    Interval,
    Nodes,
    bounds,
    check_bounds,
    when,
)
from bridge.scenario.parts import Finite, NodeId, PlacedName


class _Measured(ExpectationPart):
    """Common to both.

    Attributes:
        at_least, at_most: bounds of the measure.
    """

    at_least: Finite | None = None
    at_most: Finite | None = None

    @model_validator(mode="after")
    def _bounds_are_in_order(self) -> Self:
        check_bounds(self.at_least, self.at_most)
        return self

    def holds(self, value: float) -> bool:
        """Whether a number is within the bounds; one that is none is not."""
        low = float("-inf") if self.at_least is None else self.at_least
        return low <= value <= (float("inf") if self.at_most is None else self.at_most)


class LoggedExpectation(_Measured):
    """Numbers that agents logged under a name.

    Attributes:
        value: the name.
        key: of mappings and vectors, which number, as in `logged.parquet` (``to_m.0``).
        node: whose agent; of several that logged it, the worst counts.
        between_s: only what was logged in that interval of sim time.
        for_: the share of what was logged that has to be within the bounds.
    """

    type: Literal["logged"]
    value: str
    key: str | None = None
    node: NodeId | None = None
    between_s: Interval | None = None
    for_: Annotated[float, Field(alias="for", gt=0, le=1)] = 1.0

    @model_validator(mode="after")
    def _has_a_bound(self) -> LoggedExpectation:
        if self.at_least is None and self.at_most is None:
            raise ValueError("give at_least, at_most or both")
        return self

    @property
    def nodes(self) -> Nodes:
        """The nodes that it names, by key."""
        return {} if self.node is None else {"node": (self.node,)}

    @property
    def title(self) -> str:
        """What reports call it."""
        what = self.value if self.key is None else f"{self.value}.{self.key}"
        who = [] if self.node is None else [f"of {self.node}"]
        return self.name or " ".join([f"logged {what}", *who, *when(self.between_s)])

    @property
    def wanted(self) -> str:
        """The bounds in words."""
        return f"{bounds(self.at_least, self.at_most)} for at least {self.for_:g} of the values"


class FunctionExpectation(_Measured):
    """What a function of the user's says of the run: a number within the bounds or, without bounds, whether it holds.

    Attributes:
        function: ``FILE.py:NAME`` or ``module:NAME``; it is called with the run (`lostlink.Run`) and the options.
        options: further arguments, by name.
    """

    type: Literal["function"]
    function: PlacedName
    options: dict[str, JsonValue] = Field(default_factory=dict)

    @property
    def nodes(self) -> Nodes:
        """It names none."""
        return {}

    @property
    def place(self) -> str:
        """The file (ending in .py) or module that the function is in."""
        return self.function.rpartition(":")[0]

    @property
    def function_name(self) -> str:
        """The name of the function there."""
        return self.function.rpartition(":")[2]

    @property
    def has_bounds(self) -> bool:
        """Whether it wants a number."""
        return self.at_least is not None or self.at_most is not None

    @property
    def title(self) -> str:
        """What reports call it."""
        arguments = ", ".join(f"{name} {value}" for name, value in self.options.items())
        return self.name or (f"{self.function_name} ({arguments})" if arguments else self.function_name)

    @property
    def wanted(self) -> str:
        """The bounds in words."""
        return bounds(self.at_least, self.at_most) if self.has_bounds else "that it holds"
