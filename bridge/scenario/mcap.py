"""What the MCAP file of a run is to have in it."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

from bridge.scenario.parts import Part

Topic = Literal[
    "clock",
    "truth",
    "pose",
    "fix",
    "tf",
    "state",
    "measurements",
    "links",
    "communication",
    "fates",
    "packets",
    "mavlink",
    "agent",
    "log",
    "events",
    "text",
]
"""Kinds of topics. ``measurements``: of RF sensors; ``log``: what agents log; ``agent``: what they say of their work;
``text``: logs of processes."""
TOPICS: tuple[str, ...] = get_args(Topic)
RATES_HZ: dict[str, float] = {
    "truth": 5.0,
    "state": 5.0,
    "pose": 10.0,
    "fix": 2.0,
    "tf": 5.0,
    "links": 2.0,
}
"""Most messages per second of sim time of one topic, unless said otherwise; the other kinds have no limit."""


class McapSettings(Part):
    """What goes into `run.mcap`.

    Attributes:
        write: whether a run makes it at its end; `lostlink export RUN --mcap` makes it at any time.
        compression: of its chunks.
        payloads: whether transmitted packets have their payloads; else only their lengths.
        mavlink: ``frames`` as bytes, ``messages`` decoded, with a topic per type, or ``none``.
        rates_hz: by kind of topic, how many messages per second of sim time it has at most; 0 leaves the kind out.
        sizes_bytes: by kind of topic, the longest message; longer ones are left out and counted.
    """

    write: bool = True
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    payloads: bool = False
    mavlink: Literal["frames", "messages", "none"] = "frames"
    rates_hz: dict[Topic, Annotated[float, Field(ge=0.0, allow_inf_nan=False)]] = Field(default_factory=dict)
    sizes_bytes: dict[Topic, Annotated[int, Field(strict=True, ge=1)]] = Field(default_factory=dict)

    def rate_hz(self, kind: str) -> float | None:
        """The limit of a kind of topic; None if it has none."""
        limits: dict[str, float] = RATES_HZ | {str(name): rate for name, rate in self.rates_hz.items()}
        return limits.get(kind)

    def has(self, kind: str) -> bool:
        """Whether topics of this kind are written at all."""
        return self.rate_hz(kind) != 0.0 and not (kind == "mavlink" and self.mavlink == "none")

    def size_bytes(self, kind: str) -> int | None:
        """The longest message of a kind of topic; None if any length will do."""
        return {str(name): size for name, size in self.sizes_bytes.items()}.get(kind)
