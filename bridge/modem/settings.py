"""Of a modem: its serial line, its buffers, its status, by the medium that its radio is on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from bridge.modem.radio_status import ElrsStatus, ModemStatus, SikStatus
from channel.access.mavlink import handled
from channel.access.packets import PLAIN, Handling
from channel.access.settings.base import Serial
from channel.access.settings.delay import DelayMedium
from channel.access.settings.elrs import ElrsMedium
from channel.access.settings.medium import MediumSettings, goes_by_messages
from channel.access.settings.sik import SikMedium

SIK_BAUD, ELRS_BAUD = 57_600, 460_800
SIK_TO_HOST_BYTES, ELRS_TO_HOST_BYTES = 645, 512
NO_LIMIT: Final = 1 << 30


@dataclass(frozen=True, slots=True)
class ModemSettings:
    """One modem.

    Attributes:
        baud: of the serial line to its host; 0: there is none, bytes pass at once.
        from_host_bytes: of the buffer from its host; bytes that find no room are dropped.
        to_host_bytes: of the buffer to its host, likewise.
        packet_bytes: the longest packet that its medium takes: longer units are cut.
        status: what it tells its host; None: nothing.
    """

    baud: int = 0
    from_host_bytes: int = NO_LIMIT
    to_host_bytes: int = NO_LIMIT
    packet_bytes: int = NO_LIMIT
    status: ModemStatus | None = None


def modem_of(
    medium: MediumSettings, baud: int | None = None, *, is_transmitter: bool = False
) -> ModemSettings:
    """The modem of a radio's medium: SiK's, ExpressLRS's, or one that has no limits of its own.

    Args:
        medium: of the radio.
        baud: in place of the firmware's default.
        is_transmitter: of a pair of ExpressLRS, whether it is the transmitter module, which says nothing to its host.
    """
    if isinstance(medium, SikMedium):
        size_bytes = medium.queue.length_bytes or NO_LIMIT
        status = SikStatus() if medium.framing else None
        return ModemSettings(_or(baud, SIK_BAUD), size_bytes, SIK_TO_HOST_BYTES, status=status)
    if isinstance(medium, ElrsMedium):
        elrs = None if is_transmitter else ElrsStatus()
        return ModemSettings(_or(baud, ELRS_BAUD), medium.buffer_bytes, ELRS_TO_HOST_BYTES, status=elrs)
    longest = medium.max_length_bytes if isinstance(medium, Serial | DelayMedium) else NO_LIMIT
    return ModemSettings(_or(baud, 0), packet_bytes=longest)


def has_transmitter(medium: MediumSettings, nodes: Sequence[str], node: str) -> bool:
    """Whether a node of a network has the transmitter module of a pair of ExpressLRS; of others none has.

    Args:
        medium: of the network.
        nodes: ids of all its nodes, in their order.
        node: id of the node.
    """
    if not isinstance(medium, ElrsMedium):
        return False
    return node in [pair[0] for pair in medium.links(nodes).values()]


def measures(medium: MediumSettings) -> bool:
    """Whether modems on this medium tell their hosts what their radios measure."""
    return isinstance(medium, SikMedium | ElrsMedium)


def peers_of(medium: MediumSettings, nodes: Sequence[str]) -> dict[int, frozenset[int]]:
    """Whose frames each node's radio takes: of paired radios its peers' alone; all by their places among the nodes.

    Args:
        medium: of the network.
        nodes: ids of all its nodes, in their order.
    """
    place = {node: number for number, node in enumerate(nodes)}
    everybody = frozenset(place.values())
    if not isinstance(medium, SikMedium | ElrsMedium):
        return {each: everybody - {each} for each in everybody}
    found: dict[int, frozenset[int]] = dict.fromkeys(everybody, frozenset())
    for ids in medium.links(nodes).values():
        there = frozenset(place[node] for node in ids if node in place)
        found |= {each: there - {each} for each in there}
    return found


def handling_of(medium: MediumSettings, unit: bytes) -> Handling:
    """How a unit is handled: by its MAVLink messages, where the queues of its medium go by these."""
    return handled(unit, PLAIN) if goes_by_messages(medium) else PLAIN


def counts_foreign(medium: MediumSettings) -> bool:
    """Whether a modem on this medium counts frames of other links as errors: SiK with ECC."""
    return isinstance(medium, SikMedium) and medium.ecc


def _or(baud: int | None, default: int) -> int:
    return default if baud is None else baud
