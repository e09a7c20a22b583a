"""Originator messages of B.A.T.M.A.N. IV, and its numbers.

By the source of batman-adv (open-mesh-mirror/batman-adv f3c33e7f, 2026-08): `main.h`, `mesh-interface.c`,
`bat_iv_ogm.c`, `send.c`, `batadv_packet.h`.
"""

from __future__ import annotations

from typing import Final, NamedTuple

TQ_MAX: Final = 255
"""BATADV_TQ_MAX_VALUE: transmit quality of a way without loss."""
LOCAL_WINDOW: Final = 64
"""BATADV_TQ_LOCAL_WINDOW_SIZE: sequence numbers over which messages and echoes are counted."""
GLOBAL_WINDOW: Final = 5
"""BATADV_TQ_GLOBAL_WINDOW_SIZE: values of which the quality of a way is the mean."""
TTL: Final = 50
"""BATADV_TTL: transmissions of a message or packet in a row."""
JITTER_S: Final = 0.02
"""BATADV_JITTER: own messages are that much early or late at most, others are handed on within half of it."""
INTERVAL_S: Final = 1.0
"""orig_interval: between two messages of a node."""
HOP_PENALTY: Final = 30
"""hop_penalty: of TQ_MAX, at each hop."""
PURGE_S: Final = 200.0
"""BATADV_PURGE_TIMEOUT: a neighbour is forgotten after so long in silence, an originator after twice that."""
BROADCASTS: Final = 3
"""BATADV_NUM_BCASTS_WIRELESS: how often each node transmits a packet for all."""
BROADCAST_GAP_S: Final = 0.005
"""Between these (`batadv_send_outstanding_bcast_packet`)."""
BIDIRECTIONAL_LEAST: Final = 1
"""BATADV_TQ_LOCAL_BIDRECT_SEND_MINIMUM, ..._RECV_MINIMUM and BATADV_TQ_TOTAL_BIDRECT_LIMIT."""
TTL_SIMILAR: Final = 3
"""A second copy of a message counts if it came over at most so many hops more."""
OGM_BYTES: Final = 24
"""struct batadv_ogm_packet, without what other features append."""
ETHERNET_BYTES: Final = 14
UNICAST_BYTES: Final = 10 + ETHERNET_BYTES
"""struct batadv_unicast_packet, and the header of the frame in it."""
BROADCAST_BYTES: Final = 14 + ETHERNET_BYTES
"""struct batadv_bcast_packet, likewise."""
CONTROL_PRIORITY: Final = 7
"""TC_PRIO_CONTROL, the highest of Linux."""


class Ogm(NamedTuple):
    """An originator message.

    Attributes:
        originator: whose.
        sequence: its number.
        ttl: how often it may be transmitted yet.
        quality: of the way from its originator to its transmitter, 0 to TQ_MAX.
        previous: who transmitted it before.
        is_direct: its transmitter had it from the originator itself.
        is_best: its transmitter had it from its best next node to the originator, or is the originator.
    """

    originator: int
    sequence: int
    ttl: int
    quality: int
    previous: int
    is_direct: bool = False
    is_best: bool = True


def after_hop(quality: int, penalty: int) -> int:
    """The quality of a way one hop longer (`batadv_hop_penalty`)."""
    return quality * (TQ_MAX - penalty) // TQ_MAX


def combined(quality: int, received: int, echoed: int, interface: int) -> int:
    """The quality of a way over a neighbour (`batadv_iv_ogm_calc_tq`).

    Args:
        quality: as the neighbour says.
        received: of the neighbour's own messages in the window.
        echoed: of one's own messages in the window that came back from the neighbour.
        interface: TQ_MAX, or less where it is to be handed on over the same half-duplex radio.
    """
    both = min(echoed, received)
    own = TQ_MAX * both // received if both >= BIDIRECTIONAL_LEAST else 0
    asymmetry = TQ_MAX - TQ_MAX * (LOCAL_WINDOW - received) ** 3 // LOCAL_WINDOW**3
    return quality * own * asymmetry * interface // TQ_MAX**3
