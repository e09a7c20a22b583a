"""MAVLink 2 signing of one link: frames are signed on the way out and verified on the way in. No I/O.

Source: mavlink.io, "Message Signing". The signature is link id, timestamp (10 us since 2015, six bytes) and the first
six bytes of SHA-256 over key, frame, link id and timestamp. A timestamp counts once per sender and its link id, by
whichever link of ours it comes (as in ArduPilot: else what was said could be said again from another port). A sender
that is new may not be more than a minute behind.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from fastcrc.crc16 import mcrf4xx

from aps.wire.dialect import CRC_EXTRA
from aps.wire.framer import CRC_BYTES, INCOMPAT_SIGNED, MAGIC_V2, SIGNATURE_BYTES, Frame

KEY_BYTES: Final = 32
EPOCH_UNIX_US: Final = 1_420_070_400_000_000
"""2015-01-01, from which timestamps count."""
UNIT_US: Final = 10
LAST_UNITS: Final = (1 << 48) - (1 << 32)
"""Timestamps from here on (in 2104) are refused: ours have to come after all that were heard, in six bytes."""
OLDEST_UNITS: Final = 60_000_000 // UNIT_US
"""How far behind the first frame of a sender may be."""
TIMESTAMP_BYTES: Final = 6
DIGEST_BYTES: Final = 6
MAX_SENDERS: Final = 256
RADIO_STATUS: Final = 109
"""Comes from radios, which have no key: taken unsigned, as ArduPilot does."""
SETUP_SIGNING: Final = (256).to_bytes(3, "little")
_ID: Final = slice(7, 10)
"""Of the message id in a frame of MAVLink 2."""


@dataclass(slots=True)
class SigningCounters:
    """What became of the frames."""

    signed: int = 0
    verified: int = 0
    unsigned: int = 0
    """Refused: without a signature."""
    bad: int = 0
    """Refused: with a wrong one, or a timestamp that none can come after."""
    old: int = 0
    """Refused: a timestamp that was there before, or is long past."""
    not_signable: int = 0
    """Not sent: MAVLink 1 has no signatures."""


def read_key(path: Path) -> bytes:
    """The key in a file: 64 hexadecimal digits, or a passphrase whose SHA-256 it is (as in MAVProxy).

    Raises:
        OSError: it cannot be read.
        ValueError: it is empty.
    """
    text = path.read_text(encoding="utf-8").strip()
    if not text:
        raise ValueError(f"{path} has no key: 64 hexadecimal digits or a passphrase are expected")
    if len(text) == 2 * KEY_BYTES and all(digit in "0123456789abcdefABCDEF" for digit in text):
        return bytes.fromhex(text)
    return hashlib.sha256(text.encode()).digest()


@dataclass(slots=True)
class HeardStreams:
    """What was heard with one key."""

    latest: int = 0
    """Timestamp."""
    by_sender: dict[tuple[int, int, int], int] = field(default_factory=dict)
    """sysid, compid, link id -> latest timestamp."""


class Signing:
    """One link's key, timestamps and link id.

    Args:
        key: 32 bytes that both sides have.
        clock_us: us since 1970.
        link_id: of ours, 0..255.

    Attributes:
        counters: what became of the frames.
        link_id: as given: of each link another, or a receiver takes what is late on one for what it has had by another.
        heard: with this key; links that share one take each frame once.
    """

    def __init__(self, key: bytes, clock_us: Callable[[], int], link_id: int = 0) -> None:
        if len(key) != KEY_BYTES or not 0 <= link_id <= 255:
            raise ValueError(
                f"a key has {KEY_BYTES} bytes and a link id is in 0..255, not {len(key)} and {link_id}"
            )
        self.counters = SigningCounters()
        self.heard = HeardStreams()
        self.link_id = link_id
        self._key, self._clock_us = key, clock_us
        self._latest = 0

    def verify(self, frame: Frame) -> bool:
        """Whether a frame that came may be taken."""
        if not frame.signed:
            if frame.msg_id == RADIO_STATUS:
                return True
            self.counters.unsigned += 1
            return False
        raw = frame.raw
        body, signature = raw[:-DIGEST_BYTES], raw[-DIGEST_BYTES:]
        if not hmac.compare_digest(self._digest(body), signature):
            self.counters.bad += 1
            return False
        timestamp = int.from_bytes(body[-TIMESTAMP_BYTES:], "little")
        if timestamp >= LAST_UNITS:
            self.counters.bad += 1
            return False
        sender = (frame.sysid, frame.compid, raw[-SIGNATURE_BYTES])
        heard = self.heard
        oldest = heard.by_sender.get(sender, max(heard.latest, self._now()) - OLDEST_UNITS)
        if timestamp <= oldest:
            self.counters.old += 1
            return False
        if sender not in heard.by_sender and not self._has_room():
            self.counters.old += 1
            return False
        heard.by_sender[sender] = timestamp
        heard.latest = max(heard.latest, timestamp)
        self.counters.verified += 1
        return True

    def _has_room(self) -> bool:
        """Whether one more sender can be kept; those are forgotten of whom nothing would be taken as of a new one."""
        heard = self.heard
        if len(heard.by_sender) < MAX_SENDERS:
            return True
        oldest = max(heard.latest, self._now()) - OLDEST_UNITS
        heard.by_sender = {sender: at for sender, at in heard.by_sender.items() if at > oldest}
        return len(heard.by_sender) < MAX_SENDERS

    def sign(self, raw: bytes) -> bytes | None:
        """A whole frame with our signature; one that has somebody's already as it is; ``None`` for MAVLink 1."""
        if raw[0] != MAGIC_V2:
            self.counters.not_signable += 1
            return None
        if raw[2] & INCOMPAT_SIGNED:
            return raw
        frame = _with_flags(raw, raw[2] | INCOMPAT_SIGNED)
        self._latest = max(self._latest + 1, self.heard.latest + 1, self._now())
        body = frame + bytes([self.link_id]) + self._latest.to_bytes(TIMESTAMP_BYTES, "little")
        self.counters.signed += 1
        return body + self._digest(body)

    def _now(self) -> int:
        return (self._clock_us() - EPOCH_UNIX_US) // UNIT_US

    def _digest(self, body: bytes) -> bytes:
        return hashlib.sha256(self._key + body).digest()[:DIGEST_BYTES]


def loggable(raw: bytes) -> bytes | None:
    """A whole frame as a log may have it ("Logging" in the source): without its signature; none if it brings a key."""
    if raw[0] != MAGIC_V2:
        return raw
    if raw[_ID] == SETUP_SIGNING:
        return None
    if raw[2] & INCOMPAT_SIGNED:
        return _with_flags(raw[:-SIGNATURE_BYTES], raw[2] & ~INCOMPAT_SIGNED)
    return raw


def _with_flags(raw: bytes, incompat: int) -> bytes:
    """A frame without a signature, with other flags, and the checksum that these need."""
    covered = raw[1:2] + bytes([incompat]) + raw[3:-CRC_BYTES]
    return raw[:1] + covered + mcrf4xx(covered + _extra_of(raw)).to_bytes(CRC_BYTES, "little")


def _extra_of(raw: bytes) -> bytes:
    """The byte of a frame's message definition; of an unknown one found by its checksum."""
    extra = CRC_EXTRA.get(int.from_bytes(raw[_ID], "little"))
    if extra is not None:
        return extra
    covered, crc = raw[1:-CRC_BYTES], int.from_bytes(raw[-CRC_BYTES:], "little")
    candidates = (bytes([value]) for value in range(256))
    return next(extra for extra in candidates if mcrf4xx(covered + extra) == crc)
