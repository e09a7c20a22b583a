"""The fixture `modem_link`, as tests of users have it."""

from __future__ import annotations

from pathlib import Path

import pytest

from lostlink.testing.modem_link import Came, ModemLinks, ScriptedLink
from tests.unit.bridge.modem.frames import decoded, frame_of, heartbeat

LOSSY = ("radio.base_loss=0.2",)


def exchange(link: ScriptedLink, until_s: float = 10.0) -> tuple[list[int], list[int]]:
    """Two hosts that talk; which frames came, by their number."""
    for n in range(int(until_s * 20)):
        link.autopilot.send(frame_of(60, n), n / 20)
    for n in range(int(until_s)):
        link.gcs.send(heartbeat(n), n + 0.013)
    link.run(until_s=until_s + 1.0)
    down = [each.data[10 + 3] | each.data[10 + 4] << 8 for each in link.gcs.came if len(each.data) == 60]
    up = [each.data[4] for each in link.autopilot.came if len(each.data) == 21 and each.data[7] == 0]
    return down, up


@pytest.mark.slow
def test_a_scripted_exchange_loses_the_same_frames_each_time(modem_link: ModemLinks) -> None:
    first, again, other = (
        exchange(modem_link("sik-433", distance_m=500.0, seed=seed, settings=LOSSY)) for seed in (3, 3, 4)
    )
    assert first == again
    assert first != other
    assert 0.6 * 200 < len(first[0]) < 0.95 * 200
    assert first[0] == sorted(first[0])


@pytest.mark.slow
def test_nothing_comes_over_a_distance_that_is_too_far(modem_link: ModemLinks) -> None:
    link = modem_link("sik-433", distances=[(0.0, 200.0), (5.0, 200.0), (6.0, 500e3), (60.0, 500e3)])
    down, _ = exchange(link, 12.0)
    assert max(down) < 20 * 7, "after 6 s it is 500 km away"
    assert len(down) > 20 * 4
    told = [m for m in decoded(link.gcs.data) if m.get_type() == "RADIO_STATUS"]
    assert len(told) == 12, "a station keeps hearing its own modem"
    assert (told[3].remrssi > 0, told[-1].remrssi, told[-1].txbuf) == (True, 0, 100)


@pytest.mark.slow
def test_distances_of_a_file(modem_link: ModemLinks, tmp_path: Path) -> None:
    file = tmp_path / "away.csv"
    file.write_text("time_s,distance_m\n0,200\n5,200\n6,500000\n")
    by_file = exchange(modem_link(distances=file), 8.0)
    assert by_file == exchange(modem_link(distances=[(0.0, 200.0), (5.0, 200.0), (6.0, 500e3)]), 8.0)


def test_what_was_said_for_the_past_is_refused(modem_link: ModemLinks) -> None:
    link = modem_link()
    link.run(until_s=1.0)
    link.gcs.send(b"x", 0.5)
    with pytest.raises(ValueError, match="it is 1000000000 ns already"):
        link.run(until_s=2.0)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"radio": "sik-434"}, "did you mean sik-433"),
        ({"settings": ("base_loss=1",)}, "only the radio can be changed here"),
        ({"settings": ("radio.bas_loss=1",)}, "bas_loss"),
        ({"distance_m": -1.0}, "a distance of -1 m"),
        ({"heights_m": (-1.0, 2.0)}, "heights -1 and 2 m"),
        ({"baud": -5}, "-5 baud"),
    ],
)
def test_mistakes_are_named(modem_link: ModemLinks, asked: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        modem_link(**asked)  # type: ignore[arg-type]


def test_what_an_assertion_shows_of_a_link_is_short(modem_link: ModemLinks) -> None:
    link = modem_link()
    link.gcs.came += [Came(1.0, b"abc"), Came(2.0, b"d" * 300)]
    assert (
        repr(link)
        == "<ScriptedLink: gcs <End: 2 frames came, 303 bytes>, autopilot <End: 0 frames came, 0 bytes>>"
    )
