"""Two modems and the medium between them: bytes of either host in, bytes for either host out, at exact instants.

    pair = ModemPair(medium, settings, heard)
    pair.receive(0, data, at_ns)
    for end, (at_ns, data) in pair.advance(until_ns): ...

What comes out depends on bytes and their instants alone: not on how many calls brought them, nor on when `advance` was
called.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Final, NamedTuple

from bridge.modem.heard import RadioMeter
from bridge.modem.modem import HostBytes, Modem
from bridge.modem.settings import ModemSettings
from bridge.modem.units import Unit
from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFate, AirPacket, Loss

GROUND, AIR = 0, 1
"""The two ends. Of ExpressLRS the first has the transmitter module."""
ENDS: Final = (GROUND, AIR)


class Output(NamedTuple):
    """Bytes for the host of an end."""

    end: int
    bytes: HostBytes


@dataclass(slots=True)
class _Sent:
    """A unit on the air: its packets that have no fate yet, and why it is lost, if it is."""

    unit: Unit
    open_packets: int
    loss: Loss | None = None
    was_on_air: bool = False


class ModemPair:
    """The link.

    Args:
        medium: of nodes 0 and 1, on which nothing was sent.
        settings: of both modems.
        heard: what their radios measure.
    """

    def __init__(
        self, medium: AccessMedium, settings: Mapping[int, ModemSettings], heard: Mapping[int, RadioMeter]
    ) -> None:
        self.modems = {
            end: Modem(settings[end], heard[end], partial(medium.waiting_bytes, end)) for end in ENDS
        }
        self._medium = medium
        self._sent: dict[tuple[int, int], _Sent] = {}
        """Units by end and number of each of their packets."""
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
        while (at_ns := self._next_step_ns()) <= until_ns:
            self._step(int(at_ns))
        self.now_ns = max(self.now_ns, until_ns)
        outputs = [Output(end, each) for end in ENDS for each in self.modems[end].outputs(until_ns)]
        outputs.sort(key=lambda output: (output.bytes.at_ns, output.end))
        return outputs

    @property
    def next_ns(self) -> int | None:
        """When `advance` is due again, at the latest; None: nothing is under way, any time will do."""
        instants = [at_ns for modem in self.modems.values() for at_ns in (modem.comes_ns, modem.acts_ns())]
        if self._sent:
            instants.append(self._medium.agenda.next_ns)
        return min((at_ns for at_ns in instants if at_ns is not None), default=None)

    def waiting_bytes(self, end: int) -> int:
        """For the air, in an end's radio."""
        return self._medium.waiting_bytes(end)

    @property
    def units_under_way(self) -> int:
        """Given to a radio, and neither arrived nor lost."""
        return len({id(sent) for sent in self._sent.values()})

    # Steps.

    def _next_step_ns(self) -> float:
        """The next instant at which anything can happen."""
        agenda_ns = self._medium.agenda.next_ns
        at_ns = inf if agenda_ns is None else agenda_ns
        for modem in self.modems.values():
            acts_ns = modem.acts_ns()
            if acts_ns is not None and acts_ns < at_ns:
                at_ns = acts_ns
        if at_ns < inf:
            for modem in self.modems.values():
                byte_ns = modem.next_byte_ns(int(at_ns))
                if byte_ns is not None and byte_ns < at_ns:
                    at_ns = byte_ns
        return at_ns

    def _step(self, now_ns: int) -> None:
        """Nothing happened since the last step; all that happens now."""
        fates = [each for each in self._medium.run(now_ns) if isinstance(each, AirFate)]
        for end, modem in self.modems.items():
            for unit in modem.listen(now_ns):
                self._send(end, unit, now_ns)
        for fate in fates:
            self._settle(fate, now_ns)
        for modem in self.modems.values():
            modem.tell(now_ns)

    def _send(self, end: int, unit: Unit, now_ns: int) -> None:
        """Give a unit to the radio, in packets that its medium takes."""
        longest = self.modems[end].settings.packet_bytes
        lengths = [min(longest, len(unit.data) - begin) for begin in range(0, len(unit.data), longest)]
        sent = _Sent(unit, len(lengths))
        for length_bytes in lengths:
            number = self._numbers[end]
            self._numbers[end] += 1
            self._sent[end, number] = sent
            self._medium.offer(AirPacket(end, number, 1 - end, length_bytes, now_ns))

    def _settle(self, fate: AirFate, now_ns: int) -> None:
        """A packet has arrived or is lost; a unit is lost with any of its packets."""
        end = fate.packet.node
        sent = self._sent.pop((end, fate.packet.number))
        sent.open_packets -= 1
        sent.loss = sent.loss or fate.loss
        sent.was_on_air |= fate.started_ns >= 0
        if sent.open_packets:
            return
        sender, counts = self.modems[end], self.modems[end].counts
        if sent.was_on_air:
            sender.was_on_air(sent.unit)
        if sent.loss is not None:
            counts.units_lost[sent.loss] += 1
            return
        counts.units_arrived += 1
        counts.bytes_arrived += len(sent.unit.data)
        self.modems[1 - end].deliver(sent.unit.data, now_ns, fate.attempts)
