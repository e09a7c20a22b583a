"""Which agent runs on a node."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field, JsonValue

from bridge.scenario.parts import Finite, Part, PlacedName, Positive


class _HostedAgent(Part):
    """An agent of ours; an ``isolated`` one has a host process of its own."""

    isolated: bool = False


class HoldAgent(_HostedAgent):
    """Takes off and holds over home until the others are done."""

    has_task: ClassVar[bool] = False
    type: Literal["hold"]
    altitude_m: Positive


class OutAndBackAgent(_HostedAgent):
    """Takes off, flies straight out, turns and flies back."""

    has_task: ClassVar[bool] = True
    type: Literal["out_and_back"]
    altitude_m: Positive
    distance_m: Positive
    bearing_deg: Finite = 0.0
    speed_mps: Positive = 10.0


class StillAgent(_HostedAgent):
    """Stays where it is and transmits: for links without flight, ground stations, and tests."""

    has_task: ClassVar[bool] = False
    type: Literal["still"]


class FreeAgent(Part):
    """No agent of ours: a program beside the run transmits as this node, and sim time does not wait for it."""

    has_task: ClassVar[bool] = False
    isolated: ClassVar[bool] = False
    type: Literal["free"]


class OwnAgent(_HostedAgent):
    """An agent of the user's own: a subclass of `bridge.agents.Agent`, in a file or an installed module."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, populate_by_name=True, ser_json_inf_nan="constants"
    )

    type: Literal["own"]
    class_: Annotated[PlacedName, Field(alias="class")]
    has_task: bool = True
    options: dict[str, JsonValue] = Field(default_factory=dict)

    @property
    def place(self) -> str:
        """The file (ending in .py) or module that the class is in."""
        return self.class_.rpartition(":")[0]

    @property
    def class_name(self) -> str:
        """The name of the class there."""
        return self.class_.rpartition(":")[2]


AgentConfig = Annotated[
    HoldAgent | OutAndBackAgent | StillAgent | FreeAgent | OwnAgent, Field(discriminator="type")
]
"""``has_task``: the agent has an end of its own, which the run waits for."""
GroundAgentConfig = Annotated[StillAgent | FreeAgent | OwnAgent, Field(discriminator="type")]
"""Agents that need no aircraft."""
