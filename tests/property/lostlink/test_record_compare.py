"""A comparison finds the earliest of any changes, and explains any bytes without failing."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.record.names import Kind
from lostlink.compare.compare import compare
from lostlink.compare.explain import describe, explain
from tests.unit.bridge.record.runs import RunContent, content, make_run

PAYLOADS = [entry.payload for entries in content(2).streams.values() for entry in entries]
MUTATED = st.tuples(st.sampled_from(PAYLOADS), st.integers(0, 400), st.binary(min_size=1, max_size=4)).map(
    lambda t: t[0][: t[1]] + t[2] + t[0][t[1] + len(t[2]) :]
)
BYTES = st.one_of(st.binary(max_size=80), st.sampled_from(PAYLOADS), MUTATED)


@given(st.sampled_from(Kind), BYTES, BYTES, st.binary(max_size=40))
def test_any_bytes_are_explained(kind: Kind, a: bytes, b: bytes, before: bytes) -> None:
    explained = explain(kind, a, b, before)
    assert explained.what
    assert a == b or explained.a != explained.b
    assert describe(kind, a, before)


CHANGES = st.lists(
    st.tuples(st.integers(0, 5), st.integers(0, 3), st.integers(0, 400), st.integers(1, 255)),
    min_size=1,
    max_size=4,
)


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(CHANGES)
def test_earliest_changed_byte_is_found(changes: list[tuple[int, int, int, int]]) -> None:
    ticks: dict[tuple[int, int, int], int] = {}

    def change(run: RunContent) -> None:
        for number, index, place, mask in changes:
            stream = list(run.streams)[number]
            entries = run.streams[stream]
            at = index % len(entries)
            payload = bytearray(entries[at].payload)
            where = (number, at, place % len(payload))
            if where in ticks:
                continue
            payload[where[2]] ^= mask
            run.change(stream, at, bytes(payload))
            ticks[where] = entries[at].tick_ns

    with tempfile.TemporaryDirectory() as folder:
        a, b = make_run(Path(folder) / "a", ticks=6), make_run(Path(folder) / "b", change, ticks=6)
        found = compare(a, b)
    assert found is not None
    assert found.tick_ns == min(ticks.values())
    assert found.a != found.b
