"""Keys are those of the design, and parse back."""

from __future__ import annotations

import pytest

from bridge.bus.keys import Keys, checked_chunk

KEYS = Keys("r1")


def test_keys_of_a_ua() -> None:
    assert KEYS.state("0") == "lostlink/r1/node/0/state"
    assert KEYS.command("0", "arm") == "lostlink/r1/node/0/cmd/arm"
    assert KEYS.rx("1", "0", "team") == "lostlink/r1/node/1/rx/0/team"
    assert KEYS.comm_status("1") == "lostlink/r1/node/1/comm_status"
    assert KEYS.tx("0", "team") == "lostlink/r1/node/0/tx/main/all/team"
    assert KEYS.answer("0") == "lostlink/r1/node/0/answer"
    assert KEYS.heard("host-1") == "lostlink/r1/host/host-1/heard"
    assert KEYS.tick("links") == "lostlink/r1/tick/links"
    assert KEYS.truth("gcs") == "lostlink/r1/truth/gcs"
    assert KEYS.clock == "lostlink/r1/clock"


def test_keys_parse_back() -> None:
    assert KEYS.address_of(KEYS.tx("gcs", "team", to="1")) == ("gcs", "main", "1", "team")
    assert KEYS.address_of(KEYS.enter("gcs", "ip", to="1", radio="mesh")) == ("gcs", "mesh", "1", "ip")
    assert KEYS.node_of(KEYS.agent("7")) == "7"
    assert KEYS.last_chunk(KEYS.truth("7")) == "7"


@pytest.mark.parametrize("bad", ["", "a/b", "*", "a b", "@x", "-a", "a" * 256])
def test_chunk_that_cannot_stand_in_a_key(bad: str) -> None:
    with pytest.raises(ValueError, match="cannot be part of a key"):
        checked_chunk(bad)


def test_a_chunk_has_room_for_any_name_that_a_file_has() -> None:
    assert checked_chunk("a" * 255) == "a" * 255
