"""Radio physics and the fate of packets: pure functions of geometry, time and a seed, without clock or socket."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from channel import fit
    from channel.link.radio import Radio
    from channel.medium.medium import Medium
    from channel.medium.simulate import simulate
    from channel.presets import load_radio

__all__ = ["Medium", "Radio", "fit", "load_radio", "simulate"]
_HOME = {
    "Medium": "channel.medium.medium",
    "Radio": "channel.link.radio",
    "load_radio": "channel.presets",
    "simulate": "channel.medium.simulate",
}


def __getattr__(name: str) -> object:
    """Import a name when it is first asked for: scipy and pydantic take longer than all else."""
    if name not in _HOME:
        raise AttributeError(f"module 'channel' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
