"""The media of `channel.access` as a radio's configuration names them: ``medium: {model: csma, rate_mbps: 6}``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final

from pydantic import Field

from channel.access.media.medium import AccessMedium
from channel.access.reception.carriers import Carriers
from channel.access.settings.air_time import AirTimeMedium
from channel.access.settings.base import Ideal
from channel.access.settings.csma import CsmaMedium
from channel.access.settings.delay import DelayMedium
from channel.access.settings.elrs import ElrsMedium
from channel.access.settings.sik import SikMedium
from channel.access.settings.tdma import TdmaMedium
from channel.own.methods import Made, Method, Numbers
from channel.own.models import own_models
from channel.variant import name_of

METHODS: Final[Mapping[str, Method]] = {
    "open": Made(AccessMedium),
    "capacity_bps": Numbers((200, 1e6), "length_bytes", lambda length_bytes, _: length_bytes, low=0.0),
}
MediumSettings = Annotated[
    Ideal | AirTimeMedium | TdmaMedium | CsmaMedium | DelayMedium | ElrsMedium | SikMedium,
    Field(discriminator="model"),
    *own_models("medium", "takes_time", "open", "capacity_bps", methods=METHODS),
]


def rate_mistake(settings: MediumSettings, first_bps: float, other_bps: float) -> str:
    """Why two radios of these bit rates cannot share a medium; empty if they can.

    A medium that says itself how long frames last, by a rate of its own, says so of all nodes.
    """
    has_own_rate = (
        isinstance(settings, CsmaMedium | ElrsMedium | SikMedium)
        or getattr(settings, "bit_rate_bps", None) is not None
    )
    if first_bps == other_bps or not has_own_rate:
        return ""
    return (
        f"its bit_rate_bps is {other_bps:g} bit/s, that of the first {first_bps:g} bit/s: with the medium "
        f"{name_of(settings)} frames of all nodes last as long as at one rate"
    )


def up_share_of(settings: MediumSettings) -> float:
    """The share of packets that meet no outage of a medium, which the radio's probabilities know nothing of."""
    return settings.up_share if isinstance(settings, DelayMedium) else 1.0


def goes_by_messages(settings: MediumSettings) -> bool:
    """Whether the queues of a medium, one's own too, go by the MAVLink messages that packets consist of."""
    return bool(getattr(getattr(settings, "queue", None), "mavlink", False))


def carriers_of(settings: MediumSettings) -> Carriers | None:
    """Where a medium is on the air, one's own too: on the radio's carrier unless it says so; None: nowhere."""
    found: Carriers | None = getattr(settings, "carriers", Carriers)()
    return found
