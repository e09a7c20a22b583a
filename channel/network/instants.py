"""When what happened to receptions, as columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from channel.medium.reception import Receptions

NEVER_NS = -1
"""Of an instant that did not come."""


@dataclass(frozen=True, slots=True)
class InstantColumns:
    """When what happened to R receptions, ns of sim time, shape (R,) each; NEVER_NS where it did not.

    Attributes:
        entered_ns: the packet entered its radio.
        started_ns, ended_ns: the transmission that decided.
        arrived_ns: it was there, or lost for good.
        attempts: how often it was on the air.
    """

    entered_ns: NDArray[np.int64]
    started_ns: NDArray[np.int64]
    ended_ns: NDArray[np.int64]
    arrived_ns: NDArray[np.int64]
    attempts: NDArray[np.int32]

    @classmethod
    def at_once(cls, receptions: Receptions) -> InstantColumns:
        """Of packets that take no time: all at the instant at which they were sent."""
        sent_ns = receptions.packets.sim_time_ns[receptions.packet]
        return cls(sent_ns, sent_ns, sent_ns, sent_ns, np.ones(receptions.size, dtype=np.int32))
