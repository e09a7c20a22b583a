"""One modem: bytes of its host in, units for the air out; and the other way, units of the air in, bytes out."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from aps.wire.framer import Framer
from bridge.modem.heard import RadioMeter
from bridge.modem.radio_status import Buffer, is_status
from bridge.modem.serial_line import SerialLine
from bridge.modem.settings import ModemSettings
from bridge.modem.units import Unit, UnitCutter
from channel.medium.reception import Fate

NO_UNITS: Final[Sequence[Unit]] = ()


class HostBytes(NamedTuple):
    """Bytes that have come out at a modem's serial side.

    Attributes:
        at_ns: when the last of them did.
        data: the bytes, often one MAVLink frame.
    """

    at_ns: int
    data: bytes


@dataclass(slots=True)
class Counts:
    """What became of the bytes and frames of one modem's host.

    Attributes:
        bytes_in: from the host.
        frames_in: MAVLink frames with a good checksum among them.
        dropped_bytes: that found no room in the buffer from the host.
        units_sent: units that were given to the radio.
        units_arrived: that the other modem got; ``bytes_arrived``: what is in them.
        units_lost: by cause, in the record's words; of a unit in several packets by that of the first that was lost.
        frames_out: MAVLink frames with a good checksum that the host gets whole, RADIO_STATUS of modems left out.
        bytes_out: to the host, RADIO_STATUS of this modem left out.
        cut_bytes: for which there was no room in the buffer to the host.
        statuses: RADIO_STATUS to the host.
    """

    bytes_in: int = 0
    frames_in: int = 0
    dropped_bytes: int = 0
    units_sent: int = 0
    units_arrived: int = 0
    bytes_arrived: int = 0
    units_lost: Counter[Fate] = field(default_factory=Counter)
    frames_out: int = 0
    bytes_out: int = 0
    cut_bytes: int = 0
    statuses: int = 0


class Modem:
    """One end. Who has it calls `listen` step by step, as `bridge.modem.pair.ModemPair` does.

    Args:
        settings: of the modem.
        heard: what its radio measures.
        waiting_bytes: gives what waits for the air in the radio.
    """

    def __init__(self, settings: ModemSettings, heard: RadioMeter, waiting_bytes: Callable[[], int]) -> None:
        self.settings, self.heard, self._waiting_bytes = settings, heard, waiting_bytes
        self.counts = Counts()
        self._from_host, self._to_host = SerialLine(settings.baud), SerialLine(settings.baud)
        self._cutter = UnitCutter(self._from_host.span_ns(1))
        self._coming: deque[HostBytes] = deque()
        self._framers = Framer(trusting=True), Framer(trusting=True)
        self._version, self._seq = 1, 0
        period_ns = 0 if settings.status is None else settings.status.period_ns
        self._status_ns = period_ns or None
        self._owes_status, self._owed_bytes = False, 0

    # From the host to the air.

    def receive(self, data: bytes, at_ns: int) -> None:
        """The host sends bytes, from an instant on."""
        self.counts.bytes_in += len(data)
        self.counts.frames_in += len(self._framers[0].receive(data))
        self._from_host.put(data, at_ns)

    @property
    def line_bytes(self) -> int:
        """That the host has sent and that are not yet here."""
        return self._from_host.waiting_bytes

    def acts_ns(self) -> int | None:
        """The next instant at which it may do something by itself; None: it waits."""
        instants = (self._status_ns, self._hears_ns(), self._room_ns() if self._owed_bytes else None)
        return min((at_ns for at_ns in instants if at_ns is not None), default=None)

    def _room_ns(self) -> int | None:
        """When a RADIO_STATUS that found no room does."""
        return self._to_host.arrives_ns(
            self._to_host.waiting_bytes + self._owed_bytes - self.settings.to_host_bytes
        )

    def _hears_ns(self) -> int | None:
        """When its host's bytes may complete a unit, fill its room, or pause."""
        line, gives_up_ns, coming = self._from_host, self._cutter.gives_up_ns, self._from_host.coming
        if coming and (room_bytes := self._room_bytes()) > 0:
            next_ns = line.arrives_ns(1)
            if gives_up_ns is None or (next_ns is not None and next_ns <= gives_up_ns):
                return line.arrives_ns(min(self._cutter.needs_bytes(coming), len(coming), room_bytes))
        return gives_up_ns

    def listen(self, now_ns: int) -> Sequence[Unit]:
        """Take in what has arrived, as far as there is room; returns what goes on the air now.

        Args:
            now_ns: not beyond `acts_ns`; the room was the same since the last call.
        """
        gives_up_ns, units = self._cutter.gives_up_ns, NO_UNITS
        count = self._from_host.arrived(now_ns) if self._from_host.waiting_bytes else 0
        if count:
            kept_bytes = min(count, max(self._room_bytes(), 0))
            self.counts.dropped_bytes += count - kept_bytes
            arrived_ns = self._from_host.arrives_ns(kept_bytes)
            data = self._from_host.take(count)
            if kept_bytes and arrived_ns is not None:
                units = self._cutter.feed(data[:kept_bytes], arrived_ns)
        elif gives_up_ns is not None and gives_up_ns <= now_ns:
            units = self._cutter.give_up()
        for unit in units:
            self._version = unit.version or self._version
        self.counts.units_sent += len(units)
        return units

    def _room_bytes(self) -> int:
        return self.settings.from_host_bytes - self._waiting_bytes() - self._cutter.held_bytes

    # From the air to the host.

    def deliver(self, data: bytes, now_ns: int, parts: int = 1) -> None:
        """The air has brought bytes; those that find no room are dropped.

        Args:
            data: the bytes of a unit.
            now_ns: when the last of them came.
            parts: in how many packets: the firmware writes each as it comes, so the last alone has to find room now.
        """
        written_bytes = len(data) - len(data) // max(parts, 1)
        kept = data[: max(self._room_to_host(now_ns) + written_bytes, 0)]
        self.counts.cut_bytes += len(data) - len(kept)
        if kept:
            self.counts.bytes_out += len(kept)
            self._write(kept, now_ns)

    def was_on_air(self, unit: Unit) -> None:
        """A unit of its host has been sent."""
        status = self.settings.status
        self._owes_status |= status is not None and status.answers(unit)

    def tell(self, now_ns: int) -> None:
        """Tell its host how the link is, if that is due, and if there is room for it."""
        status = self.settings.status
        if status is None:
            return
        if self._status_ns is not None and self._status_ns <= now_ns:
            self._owes_status = True
            self._status_ns += status.period_ns
        if not self._owes_status:
            return
        buffer = Buffer(self._waiting_bytes() + self._cutter.held_bytes, self.settings.from_host_bytes)
        frame = status.frame(self._version, self._seq, self.heard, buffer, now_ns)
        if len(frame) <= self._room_to_host(now_ns):
            self._seq = (self._seq + 1) & 0xFF
            self.counts.statuses += 1
            self._owes_status, self._owed_bytes = False, 0
            self._write(frame, now_ns)
        else:
            self._owed_bytes = len(frame)

    def outputs(self, until_ns: int) -> list[HostBytes]:
        """What has come out at the host up to an instant."""
        out = []
        while self._coming and self._coming[0].at_ns <= until_ns:
            out.append(self._coming.popleft())
        return out

    @property
    def comes_ns(self) -> int | None:
        """When the host gets something next; None: nothing is on its way over the line."""
        return self._coming[0].at_ns if self._coming else None

    def _write(self, data: bytes, now_ns: int) -> None:
        frames = self._framers[1].receive(data)
        self.counts.frames_out += sum(not is_status(frame) for frame in frames)
        self._coming.append(HostBytes(self._to_host.put(data, now_ns), data))

    def _room_to_host(self, now_ns: int) -> int:
        self._to_host.take(self._to_host.arrived(now_ns))
        return self.settings.to_host_bytes - self._to_host.waiting_bytes
