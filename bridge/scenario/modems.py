"""Modems at nodes: what is at the serial side of a radio."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from bridge.scenario.parts import RESERVED_ID, NodeId, Part

SERVE_PORT = 5790
"""Where a ground station's modem is served unless the scenario says otherwise."""
Baud = Annotated[int | None, Field(strict=True, ge=1200, le=4_000_000)]


def _endpoints(value: object) -> object:
    """See that each can be opened: a mistake is better found before the start."""
    if not isinstance(value, list | tuple):
        raise ValueError("has to be a list of addresses, as in ['tcpin::5790']")
    from bridge.endpoints.address import endpoint_of  # few scenarios have any

    for text in value:
        endpoint_of(text)
    return tuple(value)


class UaModem(Part):
    """A modem at a serial port of a UA's autopilot.

    Attributes:
        serial: number of the port, as in ArduPilot's SERIALn parameters; 0 is the daemon's.
        baud: of the line, bit/s; what the firmware has by default unless given.
        to: for whom its frames are: id of a node with a modem on the radio, or `all`; unless given the only other one,
            else all.
    """

    serial: Literal[1, 2] = 1
    baud: Baud = None
    to: NodeId | None = None


class GroundModem(Part):
    """A modem at a ground station's serial port.

    Attributes:
        serve: where ground stations find its serial side; several see the same bytes.
        baud: of the line, bit/s; what the firmware has by default unless given.
        to: for whom its frames are: id of a node with a modem on the radio, or `all`; unless given the only other one,
            else all.
    """

    serve: Annotated[tuple[str, ...], BeforeValidator(_endpoints)] = (f"tcpin::{SERVE_PORT}",)
    baud: Baud = None
    to: NodeId | None = None


def addressee_of(modems: Mapping[str, UaModem | GroundModem], node: str) -> str | None:
    """The node that the frames of a node's modem are for; None: all.

    Args:
        modems: on the radio's network, by id of their nodes.
        node: id of one of these.
    """
    to, others = modems[node].to, [each for each in modems if each != node]
    if to is None:
        return others[0] if len(others) == 1 else None
    return None if to == RESERVED_ID else to
