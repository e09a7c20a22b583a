"""What a run is expected to show: it fails if it does not. `lostlink.expectations` finds out."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from bridge.scenario.expectation_parts import (
    ExpectationPart,
    Interval,
    Nodes,
    Share,
    bounds,
    by_radio,
    check_bounds,
    when,
)
from bridge.scenario.own_measures import FunctionExpectation, LoggedExpectation
from bridge.scenario.parts import Metres, NodeId, Positive
from sitl_configs.settings import refused

INSTANTS = ("end", "ever", "always")
AN_INSTANT: dict[str, Any] = {"anyOf": [{"enum": list(INSTANTS)}, {"type": "number", "minimum": 0}]}


def _instant(value: object) -> object:
    is_time = isinstance(value, int | float) and not isinstance(value, bool) and value >= 0
    if value in INSTANTS or is_time:
        return value
    raise ValueError(f"has to be a sim time in s, or one of: {', '.join(INSTANTS)}")


class DeliveryExpectation(ExpectationPart):
    """The share of packets delivered, of those sent.

    Attributes:
        from_, to: ids of the nodes; all unless given.
        radio: name of the radio network by which they were sent; all together unless given.
        distance_m: only packets whose ends were so far apart, from and to.
        between_s: only packets sent in that interval of sim time.
        each_link: the worst of the links counts, not all of them together.
        at_least, at_most: bounds of the share.
    """

    type: Literal["delivery"]
    from_: Annotated[NodeId | None, Field(alias="from")] = None
    to: NodeId | None = None
    radio: str | None = None
    distance_m: Interval | None = None
    between_s: Interval | None = None
    each_link: bool = False
    at_least: Share | None = None
    at_most: Share | None = None

    @model_validator(mode="after")
    def _has_a_bound(self) -> DeliveryExpectation:
        if self.at_least is None and self.at_most is None:
            raise ValueError("give at_least, at_most or both, a share from 0 to 1")
        check_bounds(self.at_least, self.at_most)
        if self.to is not None and self.to == self.from_:
            raise refused("a node sends nothing to itself", "to")
        return self

    @property
    def nodes(self) -> Nodes:
        """The nodes that it names, by key."""
        return {key: (node,) for key, node in (("from", self.from_), ("to", self.to)) if node is not None}

    @property
    def title(self) -> str:
        """What reports call it."""
        parts = [f"delivery {self.from_ or 'all'} to {self.to or 'all'}", *by_radio(self.radio)]
        if self.each_link:
            parts.append("on each link")
        if self.distance_m:
            parts.append(f"at {self.distance_m[0]:g} to {self.distance_m[1]:g} m")
        return self.name or " ".join([*parts, *when(self.between_s)])

    @property
    def wanted(self) -> str:
        """The bounds in words."""
        return bounds(self.at_least, self.at_most)


class PositionExpectation(ExpectationPart):
    """A node is near a place.

    Attributes:
        node: its id.
        north_m, east_m, height_m: the place, from the origin; without ``height_m`` only the ground distance counts.
        within_m: how near.
        at: a sim time in s, ``end``, ``ever`` (at least once) or ``always``.
    """

    may_name_emitters: ClassVar[bool] = True

    type: Literal["position"]
    node: NodeId
    north_m: Metres
    east_m: Metres
    height_m: Metres | None = None
    within_m: Positive
    at: Annotated[float | str, BeforeValidator(_instant), WithJsonSchema(AN_INSTANT)] = "end"

    @property
    def nodes(self) -> Nodes:
        """The nodes that it names, by key."""
        return {"node": (self.node,)}

    @property
    def title(self) -> str:
        """What reports call it."""
        height = "" if self.height_m is None else f", {self.height_m:g} m high"
        when = {"end": "at the end"}.get(
            str(self.at), self.at if isinstance(self.at, str) else f"at {self.at:g} s"
        )
        return self.name or f"node {self.node} near {self.north_m:g} m N, {self.east_m:g} m E{height} {when}"

    @property
    def wanted(self) -> str:
        """The bound in words."""
        return f"within {self.within_m:g} m"


class AgeExpectation(ExpectationPart):
    """How old the newest packet that a node has heard of another is, at most.

    Attributes:
        node: who hears.
        from_: of whom; of each other node unless given.
        radio: name of the radio network by which it came; whichever unless given.
        between_s: only in that interval of sim time.
        at_most_s: the bound.
    """

    type: Literal["age"]
    node: NodeId
    from_: Annotated[NodeId | None, Field(alias="from")] = None
    radio: str | None = None
    between_s: Interval | None = None
    at_most_s: Positive

    @model_validator(mode="after")
    def _are_two(self) -> AgeExpectation:
        if self.node == self.from_:
            raise refused("a node sends nothing to itself", "from")
        return self

    @property
    def nodes(self) -> Nodes:
        """The nodes that it names, by key."""
        return {"node": (self.node,)} if self.from_ is None else {"node": (self.node,), "from": (self.from_,)}

    @property
    def title(self) -> str:
        """What reports call it."""
        words = [f"age at {self.node} of what {self.from_ or 'each other node'} sent", *by_radio(self.radio)]
        return self.name or " ".join([*words, *when(self.between_s)])

    @property
    def wanted(self) -> str:
        """The bound in words."""
        return f"at most {self.at_most_s:g} s"


class SeparationExpectation(ExpectationPart):
    """How near any two nodes come to each other, and how far from each other they are, at any tick.

    Attributes:
        among: ids of the nodes; all UA unless given.
        between_s: only in that interval of sim time.
        at_least_m, at_most_m: bounds of the distance.
    """

    may_name_emitters: ClassVar[bool] = True

    type: Literal["separation"]
    among: Annotated[tuple[NodeId, ...] | None, Field(min_length=2)] = None
    between_s: Interval | None = None
    at_least_m: Positive | None = None
    at_most_m: Positive | None = None

    @model_validator(mode="after")
    def _has_a_bound(self) -> SeparationExpectation:
        if self.at_least_m is None and self.at_most_m is None:
            raise ValueError("give at_least_m, at_most_m or both")
        if self.among is not None and len(set(self.among)) < len(self.among):
            raise refused("a node is named twice", "among")
        check_bounds(self.at_least_m, self.at_most_m, "_m")
        return self

    @property
    def nodes(self) -> Nodes:
        """The nodes that it names, by key."""
        return {} if self.among is None else {"among": self.among}

    @property
    def title(self) -> str:
        """What reports call it."""
        who = "UA" if self.among is None else ", ".join(self.among)
        return self.name or " ".join([f"separation of {who}", *when(self.between_s)])

    @property
    def wanted(self) -> str:
        """The bounds in words."""
        return bounds(self.at_least_m, self.at_most_m, " m")


class HostLossesExpectation(ExpectationPart):
    """Packets that this machine lost before they got to the radio: losses that no model says anything of."""

    type: Literal["host_losses"]
    at_most: Annotated[int, Field(strict=True, ge=0)] = 0

    @property
    def nodes(self) -> Nodes:
        """It names none."""
        return {}

    @property
    def title(self) -> str:
        """What reports call it."""
        return self.name or "packets lost by the host"

    @property
    def wanted(self) -> str:
        """The bound in words."""
        return f"at most {self.at_most}"


class EndingExpectation(ExpectationPart):
    """How the run ends: all tasks done, or sim time up."""

    type: Literal["ending"]
    ending: Literal["done", "duration"]

    @property
    def nodes(self) -> Nodes:
        """It names none."""
        return {}

    @property
    def title(self) -> str:
        """What reports call it."""
        return self.name or "ending"

    @property
    def wanted(self) -> str:
        """The ending."""
        return self.ending


Expectation = Annotated[
    DeliveryExpectation
    | PositionExpectation
    | AgeExpectation
    | SeparationExpectation
    | LoggedExpectation
    | FunctionExpectation
    | HostLossesExpectation
    | EndingExpectation,
    Field(discriminator="type"),
]
