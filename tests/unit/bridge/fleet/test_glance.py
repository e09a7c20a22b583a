"""What is kept for people to look at."""

from __future__ import annotations

import pytest

from bridge.bus.keys import Keys
from bridge.bus.messages import AircraftState, Header, Links, encode
from bridge.fleet.glance import Glance
from lostlink.flight.shown.live_table import lately

KEYS = Keys("looked-at")


@pytest.fixture
def glance() -> Glance:
    return Glance()


def links(second: float, sent: int) -> Links:
    header = Header.at(round(second * 1e9), "")
    figures = ((10.0,), (-50.0,), (40.0,), (0.0,), (sent,), (sent - 1,))
    return Links(header, ("0", "1"), (0,), (1,), *figures, network=("main",), radio=(0,))


def test_the_newest_state_of_each_ua_is_there(glance: Glance) -> None:
    for node, mode in (("0", "GUIDED"), ("1", "LOITER"), ("0", "RTL")):
        state = AircraftState(Header.at(1, node), mode=mode)
        glance.state_came(KEYS.state(node), encode(state))
    assert {node: state.mode for node, state in glance.states().items()} == {"0": "RTL", "1": "LOITER"}


def test_links_are_there_now_and_a_second_ago(glance: Glance) -> None:
    assert glance.links() == (Links(), Links())
    for number in range(1, 9):
        glance.links_came(encode(links(number, 4 * number)))
        newest, before = glance.links()
        assert newest.sent[0] == 4 * number
        assert sum(before.sent) == 4 * (number - 1)


def test_lately_is_a_second_or_since_the_report_before_that(glance: Glance) -> None:
    for tenths, sent in ((0, 1), (6, 2), (10, 3), (16, 4), (60, 5), (120, 6)):
        glance.links_came(links(tenths / 10.0, sent))
        newest, before = glance.links()
        found = lately(newest, before), sum(newest.sent) - sum(before.sent)
        assert (
            found
            == {
                0: ("last 0.0 s", 1),
                6: ("last 0.6 s", 1),
                10: ("last 1.0 s", 2),
                16: ("last 1.0 s", 2),
                60: ("last 4.4 s", 1),
                120: ("last 6.0 s", 1),
            }[tenths]
        )


def test_what_cannot_be_read_is_counted(glance: Glance) -> None:
    glance.state_came(KEYS.state("9"), b"garbage")
    glance.links_came(b"garbage")
    assert glance.states() == {}
    assert glance.links()[0] == Links()
    assert glance.malformed == 2
