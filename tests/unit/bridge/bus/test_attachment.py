"""The layout of attachments is that of the docs, by which programs in other languages read them."""

from __future__ import annotations

import re
import struct
from pathlib import Path

from bridge.bus.reception import Instants, attachment
from bridge.bus.session import Stamp

DOCS = Path(__file__).parents[4] / "docs" / "explanation" / "architecture.md"


def test_attachments_are_laid_out_as_the_docs_say() -> None:
    stamp_format, signal_format = re.findall(r"`(<[a-zA-Z0-9]+)`", DOCS.read_text(encoding="utf-8"))
    stamp, signal = struct.Struct(stamp_format), struct.Struct(signal_format)
    raw = attachment(Stamp(4, 5, b"me").to_bytes(), -80.0, 9.5, Instants(1, 2, 3, 4), "mesh")
    assert stamp.size == Stamp.SIZE_BYTES == 33
    assert stamp.unpack_from(raw) == (4, 5, 16, b"me".ljust(16, b"\0"))
    assert signal.unpack_from(raw, stamp.size) == (-80.0, 9.5, 1, 2, 3, 4)
    assert raw[stamp.size + signal.size :] == b"mesh"
