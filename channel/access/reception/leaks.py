"""What of a signal comes in on other channels: by who transmits it and who hears it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Leaks:
    """Shares of power on channels beside a signal's own.

    Attributes:
        kinds: of radios, by node; nodes without one have the first.
        shares: of what a kind (first index) transmits another takes in 1, 2, ... channels away; nothing beyond.
    """

    kinds: Mapping[int, int] = field(default_factory=lambda: MappingProxyType({}))
    shares: tuple[tuple[tuple[float, ...], ...], ...] = (((),),)
    _is_any: bool = field(init=False, repr=False, default=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_is_any", any(one for row in self.shares for one in row))

    @classmethod
    def of_all(cls, *shares: float) -> Leaks:
        """Where all radios are alike: the shares 1, 2, ... channels away."""
        return cls(shares=((shares,),))

    def __bool__(self) -> bool:
        """Whether anything leaks at all."""
        return self._is_any

    def share(self, tx: int, rx: int, channels: int) -> float:
        """Of a node's signal so many channels away, at another."""
        kinds, shares = self.kinds, self.shares
        found = shares[kinds.get(tx, 0)][kinds.get(rx, 0)]
        return found[channels - 1] if channels <= len(found) else 0.0
