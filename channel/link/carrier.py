"""Which laws of a radio are not made for its carrier: known before anything is sent."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from channel.config import RadioConfig
from channel.propagation import gain_map
from channel.propagation.gain_map import GainMap
from channel.validity import OUTSIDE_KEY, RangedVariant

HZ_PER_MHZ = 1e6


class LawOffCarrier(NamedTuple):
    """A law that was made for other carriers than the radio's.

    Attributes:
        key: of the radio: propagation, atmosphere or noise.
        model: what it is called.
        outside: what it does then: refuse, warn, clamp or, of a gain map, fallback.
        told: all that in words.
        remedy: what may be done about one that refuses, in words.
    """

    key: str
    model: str
    outside: str
    told: str
    remedy: str


def laws_off_carrier(config: RadioConfig) -> Iterator[LawOffCarrier]:
    """Yield the laws of a radio that were not made for its carrier."""
    for key in ("propagation", "atmosphere", "noise"):
        law = getattr(config, key)
        span_hz = law.frequencies_hz if isinstance(law, RangedVariant | GainMap) else None
        if span_hz is None or span_hz[0] <= config.frequency_hz <= span_hz[1]:
            continue
        model = str(getattr(law, "model", type(law).__name__))
        low, high, own = (each / HZ_PER_MHZ for each in (*span_hz, config.frequency_hz))
        told = (
            f"{model} is made for {low:g} to {high:g} MHz, and frequency_hz of {config.name} is {own:g} MHz"
        )
        if isinstance(law, GainMap):
            told, remedy = f"{told} ({law.file})", f"take another map; {gain_map.OUTSIDE_KEY}"
        else:
            remedy = f"take another model; {OUTSIDE_KEY}"
        yield LawOffCarrier(key, model, law.outside, told, remedy)
