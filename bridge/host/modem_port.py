"""The serial side of a node's modem: its host is heard and spoken to at held instants, as autopilots are."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Protocol

from bridge.record.inputs.file import RecordedInput
from bridge.record.names import Kind


class Device(Protocol):
    """What is at a modem's serial side."""

    def read(self) -> bytes:
        """What it has sent since the last call."""

    def write(self, pieces: Sequence[bytes]) -> None:
        """Give it bytes, each piece as it came out of the modem."""


class SerialRecord(Protocol):
    """Where it is written down, with its instant."""

    def write_serial(self, radio: str, kind: Kind, data: bytes) -> None:
        """Bytes went to a modem, or came from it."""

    def write_input(self, item: RecordedInput) -> None:
        """An input from outside takes effect."""


class ModemPort:
    """One modem's serial line at a node.

    Args:
        radio: name of the modem's radio.
        device: the host.
        record: of the node.
        is_outside: whether what the host sends is an input from outside, which a record of it repeats.
    """

    def __init__(self, radio: str, device: Device, record: SerialRecord, *, is_outside: bool) -> None:
        self.radio = radio
        self._device, self._record, self._is_outside = device, record, is_outside
        self._coming: deque[tuple[int, bytes]] = deque()
        self._recorded: deque[RecordedInput] | None = None

    def repeat(self, inputs: Sequence[RecordedInput]) -> None:
        """From now on a host outside says what a record has of it, and nothing else."""
        if self._is_outside:
            self._recorded = deque(item for item in inputs if item.radio == self.radio)

    def came(self, at_ns: int, data: bytes) -> None:
        """Bytes come out of the modem at an instant."""
        self._coming.append((at_ns, data))

    def exchange(self, now_ns: int) -> bytes:
        """The fleet is held: give the host what has come out by now, and return what it has sent."""
        due = []
        while self._coming and self._coming[0][0] <= now_ns:
            due.append(self._coming.popleft()[1])
        if due:
            self._record.write_serial(self.radio, Kind.FROM_MODEM, b"".join(due))
            self._device.write(due)
        sent = self._device.read() if self._recorded is None else self._repeated(self._recorded, now_ns)
        if sent:
            self._record.write_serial(self.radio, Kind.TO_MODEM, sent)
            if self._is_outside:
                self._record.write_input(RecordedInput.serial(now_ns, self.radio, sent))
        return sent

    @staticmethod
    def _repeated(recorded: deque[RecordedInput], now_ns: int) -> bytes:
        sent = b""
        while recorded and recorded[0].tick_ns <= now_ns:
            sent += recorded.popleft().data
        return sent
