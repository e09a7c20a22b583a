"""What is kept for people to look at, from real samples."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from bridge.bus.keys import Keys
from bridge.bus.messages import AircraftState, Header, Links
from bridge.bus.session import Sample, Session, free_port, open_router
from bridge.fleet.glance import Glance

KEYS = Keys("looked-at")


@pytest.fixture(scope="module")
def session() -> Iterator[Session]:
    with open_router(f"tcp/127.0.0.1:{free_port()}") as opened:
        yield opened


@pytest.fixture
def glance(session: Session) -> Glance:
    return Glance()


def sample_of(session: Session, key: str, message: AircraftState | Links | bytes) -> Sample:
    """As it comes out of Zenoh."""
    came: list[Sample] = []
    there = threading.Event()
    session.subscribe(key, lambda sample: (came.append(sample), there.set()))
    if isinstance(message, bytes):
        session.put_bytes(key, message)
    else:
        session.put(key, message)
    assert there.wait(10.0)
    return came[0]


def links(second: int, sent: int) -> Links:
    header = Header.at(second * 1_000_000_000, "")
    return Links(header, ("0", "1"), (0,), (1,), (10.0,), (-50.0,), (40.0,), (0.0,), (sent,), (sent - 1,))


def test_the_newest_state_of_each_ua_is_there(session: Session, glance: Glance) -> None:
    for node, mode in (("0", "GUIDED"), ("1", "LOITER"), ("0", "RTL")):
        state = AircraftState(Header.at(1, node), mode=mode)
        glance.state_came(sample_of(session, KEYS.state(node), state))
    assert {node: state.mode for node, state in glance.states().items()} == {"0": "RTL", "1": "LOITER"}


def test_links_are_there_now_and_a_second_ago(session: Session, glance: Glance) -> None:
    assert glance.links() == (Links(), Links())
    for number in range(1, 9):
        glance.links_came(sample_of(session, f"{KEYS.tick('links')}{number}", links(number, 4 * number)))
        newest, before = glance.links()
        assert newest.sent[0] == 4 * number
        assert sum(before.sent) == (0 if number == 1 else 4 * max(1, number - 5))


def test_what_cannot_be_read_is_counted(session: Session, glance: Glance) -> None:
    glance.state_came(sample_of(session, KEYS.state("9"), b"garbage"))
    glance.links_came(sample_of(session, f"{KEYS.tick('links')}-bad", b"garbage"))
    assert glance.states() == {}
    assert glance.links()[0] == Links()
    assert glance.malformed == 2
