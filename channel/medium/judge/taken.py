"""What is drawn on links, on its way to a judge: at once, or noted for later, when it is known what counts."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.link.decision import Signal
from channel.link.radio import Radio
from channel.medium.links import LinksOfPass


class Taken(NamedTuple):
    """What was drawn on L links between two kinds of radios: see `Judge.take`.

    Attributes:
        radio: of the links.
        links: the links.
        mean_power_dbm: of the link budget.
        noise_dbm: noise floor and interference there; broadcasts.
        signal: as drawn.
        erased: whether the draw of the error model lost the packet.
        base_lost: which the base loss lost; None: the radio has none.
    """

    radio: Radio
    links: LinksOfPass
    mean_power_dbm: FloatArray
    noise_dbm: FloatArray | float
    signal: Signal
    erased: NDArray[np.bool_]
    base_lost: NDArray[np.bool_] | None = None


class Witness(Protocol):
    """Who takes in what is drawn."""

    def begin(self, links: LinksOfPass) -> None:
        """Take note of all links of a pass, before what is drawn on those of each two kinds of radios."""

    def take(
        self,
        radio: Radio,
        links: LinksOfPass,
        mean_power_dbm: FloatArray,
        noise_dbm: FloatArray | float,
        signal: Signal,
        erased: NDArray[np.bool_],
    ) -> None:
        """Take in what was drawn on links."""

    def take_base_losses(self, radio: Radio, lost: NDArray[np.bool_]) -> None:
        """Take in which packets the base loss of a radio lost, on the links that were taken last."""


class Notebook:
    """Notes what is drawn."""

    def __init__(self) -> None:
        self._taken: list[Taken] = []

    def begin(self, links: LinksOfPass) -> None:
        """Note nothing: what is drawn has its links beside it."""

    def take(
        self,
        radio: Radio,
        links: LinksOfPass,
        mean_power_dbm: FloatArray,
        noise_dbm: FloatArray | float,
        signal: Signal,
        erased: NDArray[np.bool_],
    ) -> None:
        """Note what was drawn on links."""
        self._taken.append(Taken(radio, links, mean_power_dbm, noise_dbm, signal, erased))

    def take_base_losses(self, radio: Radio, lost: NDArray[np.bool_]) -> None:
        """Note which packets the base loss of a radio lost."""
        assert self._taken[-1].radio is radio
        self._taken[-1] = self._taken[-1]._replace(base_lost=lost)

    def taken(self) -> list[Taken]:
        """What was noted since the last call."""
        taken, self._taken = self._taken, []
        return taken
