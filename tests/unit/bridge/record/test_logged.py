"""What agents may log, and how it comes back."""

from __future__ import annotations

import contextlib
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bridge.agents.client import LOGGED_MAX, UaClient
from bridge.bus.messages import AgentStatus, Header
from bridge.record import names
from bridge.record.logged import (
    LoggedValue,
    as_json,
    checked_value,
    decode_logged,
    encode_logged,
    kind_of,
    logged_of,
)
from bridge.record.streams import StreamError, StreamWriter

SCALARS = st.one_of(
    st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), st.text(max_size=50)
)
VECTORS = st.lists(st.one_of(st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False)), max_size=20)
KEYS = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,20}", fullmatch=True)
VALUES = st.one_of(SCALARS, VECTORS, st.dictionaries(KEYS, st.one_of(SCALARS, VECTORS), max_size=10))


@given(st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,40}", fullmatch=True), VALUES)
@example("least", -(2**63))
def test_a_value_comes_back_as_it_was(name: str, value: object) -> None:
    item = LoggedValue(name, checked_value(name, value))
    found = decode_logged(encode_logged(item))
    assert isinstance(found, LoggedValue)
    assert found == item
    assert repr(found.value) == repr(value)  # True is not 1, and 1 is not 1.0


@given(st.binary(max_size=60))
def test_any_bytes_are_an_entry_or_a_value_error(payload: bytes) -> None:
    with contextlib.suppress(ValueError):
        decode_logged(payload)


def test_an_entry_that_is_none_is_told_with_file_and_tick(tmp_path: Path) -> None:
    path = names.logged("1").path(tmp_path)
    with StreamWriter(path) as writer:
        writer.write(5, encode_logged(LoggedValue("a", 1.5)))
        writer.write(7, b"none")
    items = logged_of(tmp_path, "1")
    assert next(items) == (5, LoggedValue("a", 1.5))
    with pytest.raises(StreamError, match=rf"{path}: at 7 ns: 4 bytes that are nothing an agent logged"):
        next(items)
    assert list(logged_of(tmp_path, "2")) == []


def test_a_report_comes_back() -> None:
    status = AgentStatus(Header.at(5, "1"), "climbs", done=True, sent=7, received=3)
    assert decode_logged(encode_logged(status)) == status


def test_numpy_is_taken_as_plain() -> None:
    assert checked_value("x", np.float32(0.5)) == 0.5
    assert checked_value("x", np.bool_(True)) is True
    assert checked_value("x", np.arange(3)) == [0, 1, 2]
    assert checked_value("x", {"v": np.array([1.5]), "n": np.int64(4)}) == {"v": [1.5], "n": 4}
    assert checked_value("x", (1, 2.5)) == [1, 2.5]


def test_numbers_that_json_lacks_are_kept_and_shown_as_null() -> None:
    item = LoggedValue("x", checked_value("x", {"a": math.inf, "v": [math.nan, 1.0]}))
    found = decode_logged(encode_logged(item))
    assert repr(found) == repr(item)
    assert json.loads(as_json(item.value)) == {"a": None, "v": [None, 1.0]}


@pytest.mark.parametrize(
    ("value", "error", "words"),
    [
        (None, TypeError, "log('x'): a value of type NoneType; allowed is a number, a bool, a text"),
        (b"raw", TypeError, "a value of type bytes"),
        (1j, TypeError, "a value of type complex"),
        ([[1.0]], TypeError, "list in a vector, which has numbers only"),
        (np.eye(2), TypeError, "list in a vector"),
        (["a"], TypeError, "str in a vector"),
        ({"a": {"b": 1}}, TypeError, "log('x.a'): a value of type dict"),
        ({1: 2}, ValueError, "key 1; a key is a letter"),
        ({"a b": 2}, ValueError, "key 'a b'"),
        (2**63, ValueError, "does not fit 64 bits"),
        (-(2**63) - 1, ValueError, "does not fit 64 bits"),
        ("a" * 4097, ValueError, "a text of 4097 characters"),
        ([0.0] * 1025, ValueError, "1025 items in a vector"),
        ({f"k{i}": i for i in range(65)}, ValueError, "65 names in a mapping"),
    ],
)
def test_what_cannot_be_logged_is_told(value: object, error: type[Exception], words: str) -> None:
    with pytest.raises(error) as caught:
        checked_value("x", value)
    assert words in str(caught.value)


class Outlet:
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.items: list[LoggedValue] = []

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:
        self.items.append(item)


def test_a_name_keeps_its_kind_and_a_tick_has_a_limit() -> None:
    outlet = Outlet()
    ua = UaClient("1", outlet)  # type: ignore[arg-type]
    ua.log("mode", "search")
    with pytest.raises(TypeError, match=r"log\('mode'\): 3 is a number; the values before were of kind text"):
        ua.log("mode", 3)
    for name in ("a/b", "_a", "a b", "", "é"):
        told = f"log({name!r}): a name is a letter or digit, then up to 63 letters, digits, '_', '-' and '.'"
        with pytest.raises(ValueError, match=f"^{re.escape(told)}$"):
            ua.log(name, 1)
    with pytest.raises(ValueError, match="up to 64 characters"):
        ua.log("a" * 65, 1)
    ua.log("n", 1)
    ua.log("n", 1.5)
    for _ in range(LOGGED_MAX - 3):
        ua.log("n", 2)
    with pytest.raises(ValueError, match=f"{LOGGED_MAX} values at this tick already"):
        ua.log("n", 2)
    ua.take_clock(50_000_000)
    ua.log("n", 2)
    ua.is_over = True
    ua.log("n", 2)
    assert len(outlet.items) == LOGGED_MAX + 1
    assert [kind_of(each.value) for each in outlet.items[:3]] == ["text", "number", "number"]
