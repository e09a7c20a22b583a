"""Whether autopilots hear soon enough that the buffer of their modem is filling up."""

from __future__ import annotations

from collections.abc import Iterator

from bridge.modem.settings import modem_of
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import medium_on
from channel.access.settings.base import Ideal

PARAMETERS_SHARE = 0.3
"""ArduPilot's `GCS_Param.cpp`: of the line, for a list of parameters."""
FREE_SHARE = 1 / 3
"""Likewise: of the modem's buffer; it goes on while more is free."""
LATE_TICKS = 3
"""From a modem that has no room to an autopilot that knows it: serial bytes are exchanged while the fleet is held."""
BITS_PER_BYTE = 10


def overflows(scenario: Scenario) -> Iterator[str]:
    """Warnings: modems whose buffer a list of parameters overflows before the autopilot hears of it."""
    late_s = LATE_TICKS / scenario.tick_rate_hz
    for node in scenario.ua:
        for network, config in node.modems.items():
            medium = medium_on(scenario, network, node.node)
            if isinstance(medium, Ideal):
                continue
            modem = modem_of(medium, config.baud)
            written_bytes = PARAMETERS_SHARE * modem.baud / BITS_PER_BYTE * late_s
            if modem.status is not None and written_bytes > FREE_SHARE * modem.from_host_bytes:
                yield (
                    f"node {node.node}: ArduPilot hears RADIO_STATUS of its modem at radio {network} about "
                    f"{1000 * late_s:.0f} ms late, and writes {written_bytes:.0f} bytes of parameters meanwhile at "
                    f"{modem.baud} baud: its buffer of {modem.from_host_bytes} bytes overflows, as a real one "
                    "does not; give the modem a lower baud, like 57600"
                )
