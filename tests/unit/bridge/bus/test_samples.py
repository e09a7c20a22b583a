"""What people and programs see of a sample."""

from __future__ import annotations

import math
import queue
from collections.abc import Iterator
from typing import Any

import pytest

from bridge.bus.messages import AircraftState, Header, Links, encode
from bridge.bus.messages.codec import encoding_of
from bridge.bus.samples import as_text, describe
from bridge.bus.session import JSON, Sample, Session, Stamp, free_port, open_router


@pytest.fixture(scope="module")
def session() -> Iterator[Session]:
    with open_router(f"tcp/127.0.0.1:{free_port()}") as session:
        yield session


def described(session: Session, payload: bytes, encoding: str) -> dict[str, Any]:
    """As it came over a real session, 1.5 s into a run."""
    got: queue.SimpleQueue[Sample] = queue.SimpleQueue()
    session.subscribe("lostlink/a/node/0/logged/x", got.put)
    stamp = Stamp(-1, 1_500_000_000).to_bytes()
    session.put_bytes("lostlink/a/node/0/logged/x", payload, encoding=encoding, attachment=stamp)
    return describe(got.get(timeout=10.0))


@pytest.mark.parametrize(
    ("payload", "value", "shown"),
    [
        (b"36.4", 36.4, "\n  36.4"),
        (b'{"north": 1, "far": [2, 3]}', {"north": 1, "far": [2, 3]}, "\n  north: 1\n  far: [2, 3]"),
        (b"null", None, "\n  null"),
        (
            b'{"a": null, "b": {"c": [null, "x"]}}',
            {"a": None, "b": {"c": [None, "x"]}},
            "\n  a: null\n  b.c: [null, 'x']",
        ),
    ],
)
def test_logged_values_are_values(session: Session, payload: bytes, value: object, shown: str) -> None:
    content = described(session, payload, JSON)
    assert (content["message"], content["sim_time_s"]) == (value, 1.5)
    assert as_text(content).endswith(f" {len(payload)} B  json{shown}")


def test_what_is_not_known_is_nan_for_people_and_null_in_json(session: Session) -> None:
    links = Links(Header.at(0, ""), ("0", "1"), (0,), (1,), (12.0,), (math.nan,))
    content = described(session, encode(links), encoding_of(Links))
    assert content["message"]["received_power_dbm"] == [None]
    assert "\n  distance_m: [12.0]\n  received_power_dbm: [nan]\n" in as_text(content)
    state = AircraftState(Header.at(0, "0"), mode="GUIDED", altitude_rel_m=math.nan)
    text = as_text(described(session, encode(state), encoding_of(AircraftState)))
    assert "\n  mode: GUIDED\n" in text
    assert "\n  altitude_rel_m: nan\n" in text


def test_what_is_said_to_be_json_and_is_none_is_bytes(session: Session) -> None:
    content = described(session, b"\xff{", JSON)
    assert (content["encoding"], content["bytes"]) == (JSON, "ff7b")
