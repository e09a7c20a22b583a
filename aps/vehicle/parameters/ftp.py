"""Reading a file of the autopilot over MAVLink FTP, and its packed list of all parameters. No I/O, no clock.

The file is opened, read in bursts, and closed; what is missing of a burst is asked for again. A NAK with the code for
"end of file" that is the first answer to a request ends it: one behind a burst's pieces does not tell whether they all
came. A request that was not answered is repeated with its sequence number, and the autopilot repeats its answer: it
does not open a file twice. The pieces of a burst are numbered on from their request, and the number of the next request
is beyond them all, heard or not. (https://mavlink.io/en/services/ftp.html, ArduPilot's GCS_FTP.cpp; the packed list:
AP_Filesystem_Param.cpp)
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, Final

from aps.timeouts import TRANSFER_TIMEOUTS_S
from aps.vehicle.execution import NS_PER_S, Execution, Outcome
from aps.vehicle.telemetry import VehicleState
from aps.wire.dialect import AUTOPILOT_COMPID, mavlink

PACKED_PARAMETERS: Final = "@PARAM/param.pck"
DATA_BYTES: Final = 239
MAX_FILE_BYTES: Final = 1 << 20
MAX_HOLES: Final = 64
"""Pieces beyond a gap that are kept: an autopilot that sends more out of order is asked again."""
FEEDBACK_BYTES: Final = 4096
_HEADER: Final = struct.Struct("<HBBBBBxI")
_TERMINATE, _OPEN_RO, _BURST = 1, 4, 15
_ACK, _NAK = 128, 129
_END_OF_FILE: Final = 6
_SEQ_MASK: Final = 0xFFFF
_SEQ_STRIDE: Final = 1024
"""From one request's sequence number to the next: ArduPilot answers one with 501 messages at most (GCS_FTP.cpp), PX4
with 35 kB and what its transmit buffer holds (mavlink_ftp.cpp)."""
_SIZE: Final = struct.Struct("<I")
_VIRTUAL: Final = "@"
"""Begins the paths of ArduPilot's virtual files, whose sizes are limits or made up (AP_Filesystem_Param, _Sys and
_Mission)."""
_NS_PER_MS: Final = 1_000_000
_ERRORS: Final = {
    1: "failed",
    2: "failed with an error of its file system",
    3: "invalid size",
    4: "invalid session",
    5: "no session is free",
    6: "end of file",
    7: "unknown command",
    8: "the file exists",
    9: "the file is protected",
    10: "no such file",
}


class ReadExecution(Execution):
    """Reads a file: the result's value is its bytes.

    Args:
        state: the UA now.
        path: of the file on the autopilot.
        verb: what it is called.
    """

    wanted = frozenset({110})  # FILE_TRANSFER_PROTOCOL

    def __init__(self, state: VehicleState, path: str, verb: str = "file_read") -> None:
        super().__init__(verb, "files")
        name = path.encode("utf-8") if isinstance(path, str) else b""
        if not 0 < len(name) <= DATA_BYTES:
            raise ValueError(f"path {path!r} must have 1 to {DATA_BYTES} bytes")
        self._sysid, self._path = state.sysid, path
        self._name = name
        self._seq: int | None = None
        """Of our last request."""
        self._asked: Any = None
        """The request that nothing has answered yet."""
        self._session: int | None = None
        self._size = 0
        """Of the file when it was opened, bytes; 0 where that is not known."""
        self._content = bytearray()
        self._holes: dict[int, bytes] = {}
        """Pieces behind a gap, by offset."""
        self._tries = 0
        self._due_at_ns = 0
        self._open_tries = len(TRANSFER_TIMEOUTS_S)
        self._parting: list[Any] = []

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:  # noqa: ARG002
        if now_ns < self._due_at_ns:
            return []
        most = self._open_tries if self._session is None else len(TRANSFER_TIMEOUTS_S)
        if self._tries >= most:
            self._finish(
                Outcome.TIMED_OUT, f"no answer after {self._tries} tries ({len(self._content)} bytes)"
            )
        else:
            self._due_at_ns = now_ns + round(TRANSFER_TIMEOUTS_S[self._tries] * NS_PER_S)
            self._tries += 1
        if self.result is not None:
            return self._parting
        if self._asked is None:
            self._asked = self._request(now_ns)
        return [self._asked]

    def _request(self, now_ns: int) -> Any:
        if self._seq is None:  # not that of a transfer before, whose answer the autopilot may still keep
            self._seq = now_ns // _NS_PER_MS & _SEQ_MASK
        if self._session is None:
            return self._message(_OPEN_RO, 0, 0, self._name)
        return self._message(_BURST, self._session, len(self._content), b"", DATA_BYTES)

    def poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        """As of every execution; at the end it closes the file."""
        if self.result is not None and self._parting:
            messages, self._parting = self._parting, []
            return messages
        messages = super().poll(state, now_ns)
        if self.result is not None:
            self._parting = []
        return messages

    def _due_ns(self) -> int | None:
        return self._due_at_ns

    def _message(self, opcode: int, session: int, offset: int, data: bytes, size: int | None = None) -> Any:
        size = len(data) if size is None else size
        self._seq = ((self._seq or 0) + _SEQ_STRIDE) & _SEQ_MASK
        payload = _HEADER.pack(self._seq, session, opcode, size, 0, 0, offset) + data
        return mavlink.MAVLink_file_transfer_protocol_message(
            0, self._sysid, AUTOPILOT_COMPID, list(payload.ljust(_HEADER.size + DATA_BYTES, b"\0"))
        )

    def _finish(self, outcome: Outcome, reason: str = "", value: Any = None) -> None:
        if self._session is not None and self.result is None:
            self._parting = [self._message(_TERMINATE, self._session, 0, b"")]
        self.end(outcome, reason, value)

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:
        """FILE_TRANSFER_PROTOCOL."""
        if name != "FILE_TRANSFER_PROTOCOL" or self.result is not None:
            return
        payload = bytes(fields["payload"])
        seq, session, opcode, size, asked, complete, offset = _HEADER.unpack_from(payload)
        data = payload[_HEADER.size : _HEADER.size + size]
        number = seq - (self._seq or 0) - 1 & _SEQ_MASK  # of the answers to our last request, from 0
        is_late = number >= _SEQ_STRIDE
        if self._session is None:
            if asked == _OPEN_RO and number == 0:
                self._asked = None
                self._opened(opcode, session, data)
        elif asked == _BURST and session == self._session:
            if not is_late:
                self._asked = None
            if opcode == _ACK and data:
                self._piece(bool(complete) and not is_late, offset, data, now_ns)
            elif opcode == _NAK and not is_late:
                self._on_nak(number, data)

    def _opened(self, opcode: int, session: int, data: bytes) -> None:
        if opcode == _NAK:
            self.refuse(f"{self._path}: {_error(data)}")
        elif opcode == _ACK:
            self._session, self._tries, self._due_at_ns = session, 0, 0
            if len(data) >= _SIZE.size and not self._path.startswith(_VIRTUAL):
                (self._size,) = _SIZE.unpack_from(data)
            self.tell("accepted", f"{self._path} is open")

    def _on_nak(self, number: int, data: bytes) -> None:
        """A NAK, by its number among the answers to the last request."""
        if data[:1] != bytes([_END_OF_FILE]):
            self._finish(Outcome.REFUSED, f"{self._path}: {_error(data)}")
        elif number:  # behind pieces that may not all have come
            self._due_at_ns = 0
        else:
            self._ended()

    def _ended(self) -> None:
        """No byte follows those that came."""
        whole = max([self._size, *(at + len(data) for at, data in self._holes.items())])
        if len(self._content) < whole:
            self._finish(Outcome.REFUSED, f"{self._path} ends after {len(self._content)} of {whole} bytes")
        else:
            self._finish(Outcome.REACHED, value=bytes(self._content))

    def _piece(self, complete: bool, offset: int, data: bytes, now_ns: int) -> None:
        before = len(self._content)
        self._keep(offset, data)
        if len(self._content) > MAX_FILE_BYTES:
            self._finish(Outcome.REFUSED, f"{self._path} is longer than {MAX_FILE_BYTES} bytes")
        if len(self._content) // FEEDBACK_BYTES > before // FEEDBACK_BYTES:
            self.tell("feedback", f"{self._path}: {len(self._content)} bytes", done=len(self._content))
        if len(self._content) > before:
            self._tries = 0
            self._due_at_ns = now_ns + round(TRANSFER_TIMEOUTS_S[0] * NS_PER_S)
        if complete:
            self._due_at_ns = 0

    def _keep(self, offset: int, data: bytes) -> None:
        if offset > len(self._content):
            if len(self._holes) < MAX_HOLES:
                self._holes[offset] = data
            return
        self._content += data[len(self._content) - offset :]
        while self._holes and min(self._holes) <= len(self._content):
            start = min(self._holes)
            self._content += self._holes.pop(start)[len(self._content) - start :]


def _error(data: bytes) -> str:
    code = data[0] if data else 0
    return _ERRORS.get(code, f"error {code}")


class PackedExecution(ReadExecution):
    """Gets all parameters as ArduPilot's packed file: the result's value is name -> number.

    Args:
        state: the UA now.
        open_tries: how often to ask for the file.
    """

    def __init__(self, state: VehicleState, open_tries: int = len(TRANSFER_TIMEOUTS_S)) -> None:
        super().__init__(state, PACKED_PARAMETERS, "parameters")
        self.occupies = "parameters"
        self._open_tries = open_tries

    def end(self, outcome: Outcome, reason: str = "", value: Any = None) -> None:
        """Set the result, unpacked."""
        if outcome is Outcome.REACHED:
            try:
                value = unpacked(value)
            except ValueError as error:
                outcome, reason, value = Outcome.REFUSED, str(error), None
        super().end(outcome, reason, value)


_MAGIC: Final = 0x671B
_FILE_HEADER: Final = struct.Struct("<HHH")
_TYPES: Final = {
    1: struct.Struct("<b"),
    2: struct.Struct("<h"),
    3: struct.Struct("<i"),
    4: struct.Struct("<f"),
}


def unpacked(content: bytes) -> dict[str, float]:
    """The parameters of ArduPilot's packed file.

    After a header (magic, how many follow, how many there are) each has a byte of type and flags, one of how many
    characters it shares with the name before (low half) and how many follow less one (high half), these characters, and
    its value. Zeros before it are padding.

    Raises:
        ValueError: the content is no such file, or not all of one.
    """
    if len(content) < _FILE_HEADER.size:
        raise ValueError(f"{len(content)} bytes are no packed parameters")
    magic, count, _ = _FILE_HEADER.unpack_from(content)
    if magic != _MAGIC:
        raise ValueError(f"magic number {magic:#06x} of packed parameters is not {_MAGIC:#06x}")
    found: dict[str, float] = {}
    at, name = _FILE_HEADER.size, b""
    while at < len(content):
        if content[at] == 0:
            at += 1
            continue
        value_of = _TYPES.get(content[at] & 0x0F)
        if value_of is None or at + 2 > len(content):
            raise ValueError(f"byte {at} of the packed parameters has no type that is known")
        shared, more = content[at + 1] & 0x0F, (content[at + 1] >> 4) + 1
        end = at + 2 + more
        if end + value_of.size > len(content) or shared > len(name):
            raise ValueError("the packed parameters end in the middle of one")
        name = name[:shared] + content[at + 2 : end]
        found[name.decode("ascii", "replace")] = float(value_of.unpack_from(content, end)[0])
        at = end + value_of.size
    if len(found) != count:
        raise ValueError(f"the packed file has {len(found)} parameters and should have {count}")
    return found
