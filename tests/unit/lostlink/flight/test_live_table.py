"""The tables of UA and links."""

from __future__ import annotations

import io
import math
from dataclasses import replace

from rich.console import Console, RenderableType

from bridge.bus.messages import AircraftState, Header, Links
from lostlink.flight.shown.live_table import LinkNow, links_now, links_table, ua_table


def text_of(table: RenderableType) -> list[str]:
    """Its lines, with single blanks."""
    console = Console(file=io.StringIO(), width=160)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    return [" ".join(line.split()) for line in console.file.getvalue().splitlines()]


def report(*rows: tuple[int, int, float, int, int]) -> Links:
    """Of (tx, rx, power, sent, delivered)."""
    tx, rx, power, sent, delivered = zip(*rows, strict=True) if rows else ((), (), (), (), ())
    many = [10.0] * len(rows)
    figures = (many, power, many, many, sent, delivered)
    return Links(Header(), ("0", "1", "gcs"), tx, rx, *figures, network=("main",), radio=[0] * len(rows))


def link(name: str, sent: int, delivered: int) -> LinkNow:
    return LinkNow(name, 10.0, -50.0, 100 * sent, 90 * sent, sent, delivered)


def test_the_last_second_is_what_came_since_the_report_before() -> None:
    newest = report((0, 1, -70.0, 50, 40), (1, 0, math.nan, 50, 50), (2, 0, -60.0, 3, 3))
    found = links_now(newest, report((0, 1, -70.0, 30, 30), (1, 0, -70.0, 50, 50)))
    assert [(each.name, each.sent_lately, each.delivered_lately) for each in found] == [
        ("0 -> 1", 20, 10),
        ("1 -> 0", 0, 0),
        ("gcs -> 0", 3, 3),
    ]
    assert [each.lost_lately for each in found] == [0.5, 0.0, 0.0]
    assert links_now(report(), report()) == []


def test_a_row_for_each_link() -> None:
    newest = report((0, 1, -70.25, 50, 40), (1, 0, math.nan, 50, 50))
    lines = text_of(links_table(links_now(newest, report()), 12, "last 1.0 s"))
    assert lines == [
        "link distance, m power, dBm last 1.0 s so far delivered",
        "0 -> 1 10.0 -70.2 40 / 50 40 / 50 80.0 %",
        "1 -> 0 10.0 - 50 / 50 50 / 50 100.0 %",
    ]


def test_links_of_several_networks_are_told_apart() -> None:
    def on_both(sent: int) -> Links:
        both = report((0, 1, -70.0, sent, sent), (0, 1, -90.0, sent, sent // 2))
        return replace(both, network=("main", "mesh"), radio=(0, 1))

    found = links_now(on_both(30), on_both(20))
    assert [(each.name, each.sent_lately, each.delivered_lately) for each in found] == [
        ("main: 0 -> 1", 10, 10),
        ("mesh: 0 -> 1", 10, 5),
    ]


def test_a_link_with_a_radio_that_is_off_says_so() -> None:
    newest = report((0, 1, math.nan, 50, 40), (1, 2, -50.0, 50, 50), (2, 0, -50.0, 50, 50))
    found = links_now(replace(newest, radio_off=(0,)), report())
    assert [each.is_off for each in found] == [True, False, True]
    assert text_of(links_table(found, 12, "last 1.0 s"))[1] == "0 -> 1 10.0 radio off 40 / 50 40 / 50 80.0 %"


def test_of_many_links_those_that_lose_most_and_all_together() -> None:
    links = [link(f"0 -> {n}", 20, 20 - n) for n in range(10)]
    lines = text_of(links_table(links, 4, "last 1.0 s"))
    assert [line.split(" 10.0")[0] for line in lines[1:4]] == ["0 -> 9", "0 -> 8", "0 -> 7"]
    assert lines[4] == "all 10 - - 155 / 200 18000 / 20000 90.0 %"
    assert len(lines) == 5


def test_a_row_for_each_node_that_is_known() -> None:
    state = AircraftState(
        Header(),
        mode="GUIDED",
        altitude_rel_m=39.96,
        groundspeed_mps=10.0,
        heartbeat_age_s=0.25,
        armed=True,
    )
    idle = AircraftState(Header(), mode="STABILIZE", altitude_rel_m=math.nan)
    lines = text_of(
        ua_table({"1": state, "0": idle}, {"gcs": "listens", "1": "flies out"}, ("0", "1", "2", "gcs"), 9)
    )
    assert lines == [
        "node mode height, m speed, m/s heartbeat, s ago agent",
        "0 STABILIZE, disarmed - 0.0 0.0",
        "1 GUIDED 40.0 10.0 0.2 flies out",
        "gcs - - - - listens",
    ]


def test_of_many_nodes_the_first_and_the_modes_of_the_others() -> None:
    states = {str(n): AircraftState(mode="RTL" if n % 2 else "AUTO", armed=True) for n in range(20)}
    lines = text_of(ua_table(states, {}, [str(n) for n in range(20)], 6))
    assert [line.split()[0] for line in lines[1:6]] == ["0", "1", "2", "3", "4"]
    assert lines[6] == "15 more 7 AUTO, 8 RTL"
