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


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text("0159", max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)
pieces = [
    "{1}",
    "{2:.1m_v}",
    "{1:.5000000000}",
    "{9" + "9" * 5000 + "}",
    "{",
    "}",
    "\\",
    "a",
    "\ud800",
    "\u0665",
]
some_text = st.lists(st.sampled_from(pieces), max_size=4).map("".join)
numbers = st.sampled_from(["1", "2", "-1", "255", "1" * 5000, "x"])


def one_of(**expected):
    """A mapping with some of the keys, each with what belongs there, or with anything."""
    return st.fixed_dictionaries({}, optional={key: one | anything for key, one in expected.items()})


def all_of(**expected):
    """A mapping with all keys, and what belongs there."""
    return st.fixed_dictionaries(expected)


types = st.sampled_from(["uint8_t", "int64_t", "float", "why_t", "px4::why_t", "none"])
entries = st.dictionaries(numbers, one_of(name=some_text, description=some_text) | anything, max_size=3)
enums = one_of(type=types, is_bitfield=st.booleans(), entries=entries) | anything
arguments = st.lists(one_of(type=types) | anything, max_size=3)
events = one_of(message=some_text, name=some_text, type=st.just("summary"), arguments=arguments) | anything
groups = all_of(arming_check=all_of(events=st.dictionaries(st.sampled_from(["1", "2"]), events, min_size=2)))
bits = one_of(groups=st.dictionaries(numbers, st.lists(st.integers()), max_size=2))
components = all_of(
    namespace=st.just("px4"), enums=all_of(why_t=enums), event_groups=groups, navigation_mode_groups=bits
)
metadata = all_of(components=st.fixed_dictionaries({"1": components}))


@given(
    st.binary(max_size=80)
    | (metadata | one_of(components=one_of(**{"1": anything})) | anything).map(
        lambda tree: json.dumps(tree).encode()
    ),
    st.lists(
        st.tuples(st.sampled_from([1, 2]), st.integers(0, 7), st.binary(max_size=40)), min_size=2, max_size=4
    ),
)
def test_whatever_the_metadata_is_an_event_is_told_in_a_line_or_by_its_number(content, said):
    texts = EventTexts()
    with contextlib.suppress(ValueError):
        texts.learn(content)
        assert texts.known
    for sub_id, level, arguments in said:
        found = texts.take(event(sub_id, level, arguments), MANUAL)
        assert found is None or len(found.text.encode()) <= 4000


@pytest.mark.parametrize(
    "broken",
    [
        "hello",
        {"message": 5},
        {"message": "{1}", "arguments": 5},
        {"message": "{1}", "arguments": ["a"]},
        {"message": "{1}", "arguments": [{"type": []}]},
    ],
)
def test_an_event_that_is_not_well_formed_is_told_by_its_number_and_others_by_their_texts(broken):
    tree = json.loads(json.dumps(METADATA))
    tree["components"]["1"]["event_groups"]["default"]["events"]["10"] = broken
    texts = EventTexts()
    texts.learn(json.dumps(tree).encode())
    assert texts.take(event(10, 6, b"\1\2"), HOLD).text == "event 0x0100000a, whose text is not known"
    assert texts.take(event(7, 6, bytes([5, 0])), HOLD).text == "gyro|mag of <all>"


@pytest.mark.parametrize(
    ("message", "text"),
    [("{1:.5000000000}", "7.000000000"), ("{99999999999999999999}", "?"), ("a" * 5000, "a" * 1000)],
)
def test_lengths_have_bounds(message, text):
    one = {"message": message, "arguments": [{"type": "uint8_t"}]}
    tree = {"components": {"1": {"event_groups": {"g": {"events": {"1": one}}}}}}
    texts = EventTexts()
    texts.learn(json.dumps(tree).encode())
    assert texts.take(event(1, 6, b"\7"), HOLD).text == text


def test_what_is_no_metadata_changes_nothing(texts):
    with pytest.raises(ValueError, match="no metadata of events"):
        texts.learn(b'{"components": {"1": {"event_groups": {"g": {"events": {"5": {}}}}, "enums": 5}}}')
    assert texts.take(event(5, 6, bytes([6])), HOLD).text == "Disarmed by landing"
