"""Events: payloads laid out by hand, as the guide has them (id, time, sequence, destination, levels, arguments)."""

import contextlib
import json
import lzma
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aps.vehicle.events import EventTexts
from aps.wire.framer import Frame

MANUAL, HOLD = 1 << 16, 4 << 16 | 3 << 24
NUMBER = {"type": "uint32_t"}
METADATA = {
    "components": {
        "1": {
            "namespace": "px4",
            "enums": {
                "why_t": {"type": "uint8_t", "entries": {"6": {"name": "landing", "description": "by landing"}}},
                "bits_t": {
                    "type": "uint16_t",
                    "is_bitfield": True,
                    "entries": {"1": {"name": "gyro"}, "4": {"name": "mag"}},
                },
            },
            "event_groups": {
                "default": {
                    "events": {
                        "5": {"message": "Disarmed {1}", "arguments": [{"type": "px4::why_t"}]},
                        "6": {
                            "message": "Climb to {1:.1m_v}, {2}",
                            "arguments": [{"type": "float"}, {"type": "int8_t"}],
                        },
                        "7": {"message": "{1} of \\<all\\>", "arguments": [{"type": "bits_t"}]},
                        "8": {"message": "Summary", "type": "summary"},
                    }
                },
                "arming_check": {"events": {"9": {"message": "No sticks", "arguments": [NUMBER]}}},
            },
            "navigation_mode_groups": {"groups": {"0": [MANUAL], "4": [HOLD]}},
        }
    }
}  # fmt: skip


def event(sub_id, level, arguments=b"", component=1):
    payload = struct.pack("<IIHBBB", component << 24 | sub_id, 1234, 7, 0, 0, 0x10 | level) + arguments
    return Frame(b"\xfd" + bytes(9) + payload + bytes(2), 410, 1, 1, 0, 0, 10, len(payload))


@pytest.fixture
def texts():
    known = EventTexts()
    known.learn(lzma.compress(json.dumps(METADATA).encode()))
    return known


@pytest.mark.parametrize(
    ("sub_id", "arguments", "text"),
    [
        (5, bytes([6]), "Disarmed by landing"),
        (5, bytes([99]), "Disarmed 99"),
        (6, struct.pack("<fb", 10.04, -3), "Climb to 10.0 m, -3"),
        (6, b"", "Climb to 0.0 m, 0"),
        (7, bytes([5, 0]), "gyro|mag of <all>"),
        (1000, b"", "event 0x010003e8, whose text is not known"),
    ],
)
def test_texts_are_filled_in(texts, sub_id, arguments, text):
    found = texts.take(event(sub_id, 6, arguments), HOLD)
    assert (found.text, found.severity) == (text, 6)


def test_what_is_not_for_people_is_not_told(texts):
    assert texts.take(event(8, 6), HOLD) is None
    assert texts.take(event(5, 8), HOLD) is None, "a level of the protocol"


@pytest.mark.parametrize(
    ("mode", "level", "severity"), [(MANUAL, 6, 4), (MANUAL, 3, 3), (HOLD, 3, 5), (0, 6, 6)]
)
def test_a_check_counts_where_it_matters(texts, mode, level, severity):
    """Bit 0 of its modes is MANUAL's group: a warning at least there, a notice at most elsewhere."""
    assert texts.take(event(9, level, bytes([1, 0, 0, 0])), mode).severity == severity


@given(st.binary(max_size=80))
def test_any_payload_is_taken(payload):
    texts = EventTexts()
    texts.learn(json.dumps(METADATA).encode())
    texts.take(Frame(b"\xfd" + bytes(9) + payload + bytes(2), 410, 1, 1, 0, 0, 10, len(payload)), HOLD)


@given(
    st.binary(max_size=80)
    | st.recursive(
        st.none() | st.integers() | st.text(),
        lambda x: (
            st.lists(x)
            | st.dictionaries(st.sampled_from(["components", "1", "enums", "event_groups", "events"]), x)
        ),
    ).map(lambda x: json.dumps(x).encode())
)
def test_what_is_no_metadata_is_an_error(content):
    texts = EventTexts()
    with contextlib.suppress(ValueError):
        texts.learn(content)
        assert texts.known
        return
    assert not texts.known
