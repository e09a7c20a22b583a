"""The ways of routing as a radio's configuration names them: ``routing: {model: flood, hop_limit: 3}``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import BeforeValidator, Field, field_validator

from channel.access.timing import NS_PER_S
from channel.draws import Draws
from channel.own.methods import Made, Method, Numbers
from channel.own.models import own_models
from channel.routing.flood import Flood
from channel.routing.mesh.mesh import Mesh, MeshNumbers
from channel.routing.mesh.originator import (
    BROADCASTS,
    CONTROL_PRIORITY,
    HOP_PENALTY,
    INTERVAL_S,
    JITTER_S,
    OGM_BYTES,
    PURGE_S,
    TQ_MAX,
)
from channel.routing.router import Forwarding, HopRouter
from channel.routing.static import Static, leads_back
from channel.variant import Variant
from sitl_configs.settings import id_as_text

Nodes = Mapping[str, int]
"""The place of each id on the network, in order."""
NodeId = Annotated[str, BeforeValidator(id_as_text)]


class RoutingModel(Variant):
    """Whether and how nodes hand packets on. One of a user's own has `open`."""

    def copies(self, nodes: int) -> int:
        """How often a packet for all is transmitted at most, on a network of so many nodes."""
        del nodes
        return 1


class NoRouting(RoutingModel):
    """A packet goes from its sender to those who hear it, and no further."""

    model: Literal["none"] = "none"


class Relaying(RoutingModel):
    """Nodes hand packets on."""

    processing_s: float = Field(
        default=0.001,
        ge=0.0,
        le=10.0,
        description="between a packet's arrival at a node and its radio, at least",
    )
    jitter_s: float = Field(
        default=0.001, ge=0.0, le=10.0, description="up to so much is added, drawn for each packet and node"
    )

    @property
    def forwarding(self) -> Forwarding:
        """How long nodes take."""
        return Forwarding(round(self.processing_s * NS_PER_S), round(self.jitter_s * NS_PER_S))


class FloodRouting(Relaying):
    """Whoever hears a packet for the first time transmits it once more."""

    model: Literal["flood"] = "flood"
    hop_limit: int = Field(
        default=3, ge=1, le=255, description="transmissions in a row; 1: nobody hands a packet on"
    )
    jitter_s: float = Field(
        default=0.02, ge=0.0, le=10.0, description="up to so much is added, drawn for each packet and node"
    )
    header_bytes: int = Field(
        default=8, ge=0, le=1000, description="that each packet gets: sender, receiver, number, hops"
    )

    def copies(self, nodes: int) -> int:
        """Once by each."""
        return nodes if self.hop_limit > 1 else 1

    def open(self, nodes: Nodes, draws: Draws) -> HopRouter:
        """The router of a network."""
        return Flood(tuple(nodes), draws, self.forwarding, self.hop_limit, self.header_bytes)


class StaticRouting(Relaying):
    """Routes that are written down; a packet for one node goes directly where there is none."""

    model: Literal["static"] = "static"
    routes: dict[NodeId, dict[NodeId, NodeId]] = Field(
        description='by node and destination the next node, all by their ids: {"0": {gcs: "1"}, "1": {gcs: "2"}}'
    )
    header_bytes: int = Field(
        default=8, ge=0, le=1000, description="that each packet gets: sender, receiver, number, hops"
    )

    @field_validator("routes")
    @classmethod
    def _arrive(cls, routes: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
        for node, by_destination in routes.items():
            for destination, following in by_destination.items():
                if node in (destination, following):
                    raise ValueError(f"{node}: {destination}: {following}: a node needs no route to itself")
        back = leads_back(routes)
        if back is not None:
            node, destination, way = back
            raise ValueError(f"{node}: {destination}: leads back: {' > '.join(way)}")
        return routes

    def open(self, nodes: Nodes, draws: Draws) -> HopRouter:
        """The router of a network.

        Raises:
            ValueError: a route of a node that is not there.
        """
        for node, by_destination in self.routes.items():
            for destination, following in by_destination.items():
                for each in (node, destination, following):
                    if each not in nodes:
                        text = (
                            f"routes.{node}.{destination}: {following}: node {each} is not there; there are "
                        )
                        raise ValueError(text + ", ".join(nodes))
        routes = {
            nodes[node]: {nodes[to]: nodes[via] for to, via in by.items()} for node, by in self.routes.items()
        }
        return Static(tuple(nodes), draws, self.forwarding, routes, self.header_bytes)


class MeshRouting(Relaying):
    """Nodes find routes by themselves, as B.A.T.M.A.N. IV does; the defaults are batman-adv's."""

    model: Literal["mesh"] = "mesh"
    ogm_interval_s: float = Field(
        default=INTERVAL_S,
        ge=2.0 * JITTER_S,
        le=3600.0,
        description="between two originator messages of a node",
    )
    hop_penalty: int = Field(
        default=HOP_PENALTY,
        ge=0,
        le=TQ_MAX,
        description=f"of {TQ_MAX}, taken from the transmit quality at each hop",
    )
    purge_s: float = Field(
        default=PURGE_S, gt=0.0, le=86_400.0, description="a neighbour is forgotten after so long in silence"
    )
    broadcasts: int = Field(
        default=BROADCASTS, ge=1, le=255, description="how often each node transmits a packet for all"
    )
    ogm_bytes: int = Field(
        default=OGM_BYTES,
        ge=OGM_BYTES,
        le=1000,
        description="of an originator message, with what is appended to it",
    )
    ogm_priority: int = Field(
        default=CONTROL_PRIORITY, ge=-128, le=127, description="of originator messages in the queue"
    )

    def copies(self, nodes: int) -> int:
        """So often by each."""
        return self.broadcasts * nodes

    def open(self, nodes: Nodes, draws: Draws) -> HopRouter:
        """The router of a network."""
        numbers = MeshNumbers(
            self.ogm_interval_s,
            self.hop_penalty,
            self.purge_s,
            self.broadcasts,
            self.ogm_bytes,
            self.ogm_priority,
        )
        return Mesh(tuple(nodes), draws, self.forwarding, numbers)


def _by_name(value: Any) -> Any:
    """A name alone is that way with its defaults."""
    return {"model": value} if isinstance(value, str) else value


METHODS: Final[Mapping[str, Method]] = {
    "open": Made(HopRouter),
    "copies": Numbers((5,), "nodes", lambda nodes: nodes, low=1.0),
}
_Named = NoRouting | FloodRouting | StaticRouting | MeshRouting
_Written = Literal["none", "flood", "mesh"] | _Named
RoutingSettings = Annotated[
    _Named,
    Field(discriminator="model"),
    *own_models("routing", "open", base=RoutingModel, methods=METHODS),
    BeforeValidator(_by_name, json_schema_input_type=_Written),
]
"""A mapping, or a name alone: ``none``, ``flood``, ``mesh``.

Of one's own as of media: ``class: file.py:Name``, with a method `open`.
"""


def router_of(settings: RoutingSettings, nodes: Nodes, draws: Draws) -> HopRouter | None:
    """The router of a network; None: nodes do not hand packets on.

    Raises:
        ValueError: a route of a node that is not there.
    """
    return None if isinstance(settings, NoRouting) else settings.open(nodes, draws)
