"""The first difference between two runs, and what a comparison went through."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Difference:
    """Where two runs begin to differ.

    Attributes:
        tick_ns: sim time.
        node: whose stream it is; in the deliveries, the sender of the packet.
        stream: its name, such as ``packets/0``, or the table's: ``truth`` or ``deliveries``.
        what: the column, message, byte or row that differs; ``the stream`` if one run lacks it or it ends there.
        a: what the first run has, as text.
        b: what the second run has.
    """

    tick_ns: int
    node: str
    stream: str
    what: str
    a: str
    b: str

    def as_dict(self) -> dict[str, Any]:
        """In plain types."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Comparison:
    """What was compared, up to the first difference.

    Attributes:
        difference: None if the runs are identical.
        streams: names of all streams and tables of either run.
        entries: pairs of entries (and rows of tables) that are equal.
        ticks: of the truth; of records without it, of the stream with the most.
    """

    difference: Difference | None
    streams: tuple[str, ...]
    entries: int
    ticks: int


def seconds(tick_ns: int) -> str:
    """Sim time as people read it: exact, in seconds, with at least two decimals."""
    whole, rest = divmod(tick_ns, 1_000_000_000)
    decimals = f"{rest:09d}".rstrip("0").ljust(2, "0")
    return f"{whole}.{decimals} s"
