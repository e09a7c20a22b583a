"""Emitters: stations that radiate and exchange no packets. Sensors measure them; radios near their frequency suffer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from channel.antenna import Isotropic
from channel.checks import FloatArray
from channel.config import Antenna
from channel.draws import Draws, uniform_from_words
from channel.link.emitters.emission import Emission


class Emitter(Emission):
    """One emitter. Its antenna stands upright, with its front to the north."""

    name: str = Field(min_length=1, description="its id: what its draws are keyed by")
    antenna: Antenna = Field(default_factory=Isotropic)

    @property
    def is_pulsed(self) -> bool:
        """Whether it is on in some slots and off in others."""
        return 0.0 < self.duty < 1.0

    def is_on(self, draws: Draws, sim_time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether it transmits at instants: the same for whoever asks, shape (N,)."""
        if not self.is_pulsed:
            return np.full(np.shape(sim_time_ns), self.duty > 0.0)
        return slot_uniform(draws, ("emitter", self.name, "slots"), self.slot_ns, sim_time_ns) < self.duty


def slot_uniform(
    draws: Draws, names: tuple[str, ...], slot_ns: int, sim_time_ns: NDArray[np.int64]
) -> FloatArray:
    """Return the draw of the slot that each instant falls into, shape (N,).

    Args:
        draws: of the run.
        names: of the stream.
        slot_ns: length of a slot.
        sim_time_ns: instants, shape (N,); before 0 it is as at 0.
    """
    slots, which = np.unique(np.maximum(sim_time_ns // slot_ns, 0), return_inverse=True)
    words = [draws.words(names, slot, 1)[0, 0] for slot in slots.tolist()]
    return uniform_from_words(np.array(words, dtype=np.uint64))[which]
