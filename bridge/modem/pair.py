"""Two modems and the medium between them: bytes of either host in, bytes for either host out, at exact instants.

    pair = ModemPair(medium, settings, heard, cause)
    pair.receive(0, data, at_ns)
    for end, (at_ns, data) in pair.advance(until_ns): ...

What comes out depends on bytes and their instants alone: not on how many calls brought them, nor on when `advance` was
called.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

from bridge.modem.heard import RadioMeter
from bridge.modem.modem import Modem
from bridge.modem.network import CauseOf, ModemNetwork, OnAir, Output
from bridge.modem.settings import ModemSettings
from channel.access.media.medium import AccessMedium
from channel.access.packets import PLAIN, AirFate, AirPacket, Handling

GROUND, AIR = 0, 1
"""The two ends. Of ExpressLRS the first has the transmitter module."""
ENDS: Final = (GROUND, AIR)


class ModemPair:
    """The link.

    Args:
        medium: of nodes 0 and 1, on which nothing was sent.
        settings: of both modems.
        heard: what their radios measure.
        cause: says why a packet was lost.
        handling: says how a unit is handled.
    """

    def __init__(
        self,
        medium: AccessMedium,
        settings: Mapping[int, ModemSettings],
        heard: Mapping[int, RadioMeter],
        cause: CauseOf,
        handling: Callable[[bytes], Handling] = lambda _unit: PLAIN,
    ) -> None:
        self.modems = {
            end: Modem(settings[end], heard[end], partial(medium.waiting_bytes, end)) for end in ENDS
        }
        self._medium, self._handling = medium, handling
        self._network = ModemNetwork(self.modems, self._offer, cause)
        self._numbers = dict.fromkeys(ENDS, 0)
        self.now_ns = 0

    def receive(self, end: int, data: bytes, at_ns: int) -> None:
        """The host of an end sends bytes from an instant on.

        Raises:
            ValueError: that instant has passed.
        """
        if at_ns < self.now_ns:
            raise ValueError(f"bytes at {at_ns} ns: it is {self.now_ns} ns already")
        self.modems[end].receive(data, at_ns)

    def advance(self, until_ns: int) -> list[Output]:
        """Let the link live up to an instant; what has come out by then, in the order of instants."""
        network, medium = self._network, self._medium
        while (at_ns := network.next_ns(medium.agenda.next_ns)) <= until_ns:
            now_ns = int(at_ns)
            network.listen(now_ns - 1)
            network.step(now_ns, [each for each in medium.run(now_ns) if isinstance(each, AirFate)])
        network.listen(until_ns)
        self.now_ns = max(self.now_ns, until_ns)
        return network.outputs(until_ns)

    @property
    def next_ns(self) -> int | None:
        """When `advance` is due again, at the latest; None: nothing is under way, any time will do."""
        instants = [at_ns for modem in self.modems.values() for at_ns in (modem.comes_ns, modem.acts_ns())]
        if self._network.units_under_way:
            instants.append(self._medium.agenda.next_ns)
        return min((at_ns for at_ns in instants if at_ns is not None), default=None)

    def waiting_bytes(self, end: int) -> int:
        """For the air, in an end's radio."""
        return self._medium.waiting_bytes(end)

    @property
    def units_under_way(self) -> int:
        """Given to a radio, and neither arrived nor lost."""
        return self._network.units_under_way

    def _offer(self, end: int, data: bytes, now_ns: int) -> OnAir:
        number = self._numbers[end]
        self._numbers[end] += 1
        self._medium.offer(AirPacket(end, number, 1 - end, len(data), now_ns, *self._handling(data)))
        return OnAir(number, (1 - end,))
