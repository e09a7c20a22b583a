"""Who an interferer is: what its draws are keyed by, wherever it is listed."""

from __future__ import annotations

from collections import Counter

from channel.config import RadioConfig
from channel.phy.interference import Interferer

UNNAMED = Interferer.model_fields["name"].default


def interferer_names(config: RadioConfig) -> tuple[str, ...]:
    """Return a name for each interferer of a radio: the same for the same one in other radios and other lists.

    Its own name and its place; without a name of its own its place, carrier, power, bandwidth, duty and slots. Several
    that are alike in one list are told apart by their order.
    """
    found: Counter[str] = Counter()
    names = []
    for each in config.interference.interferers:
        name = _name_of(each, config.frequency_hz)
        found[name] += 1
        names.append(name if found[name] == 1 else f"{name} {found[name]}")
    return tuple(names)


def _name_of(interferer: Interferer, carrier_hz: float) -> str:
    place = ", ".join(_number(each) for each in interferer.position_ned_m)
    if interferer.name != UNNAMED:
        return f"interferer {interferer.name!r} at {place}"
    traits = (
        interferer.frequency_hz or carrier_hz,
        interferer.power_dbm,
        interferer.bandwidth_hz,
        interferer.duty,
        interferer.slot_s,
    )
    return f"interferer at {place}: {', '.join(map(_number, traits))}"


def _number(value: float) -> str:
    """All of it; 0 has no sign."""
    return repr(float(value) + 0.0)
