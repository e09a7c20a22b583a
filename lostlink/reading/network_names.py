"""Which radio networks are named in what people read."""

from __future__ import annotations

from collections.abc import Iterable

from bridge.bus.keys import MAIN


def are_named(networks: Iterable[str]) -> bool:
    """Whether those that carried packets are named: several, or the only one where it is not the main one."""
    return not set(networks) <= {MAIN}
