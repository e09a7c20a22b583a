"""What is seen of a run: lines where the output is no terminal, a view where it is one."""

from __future__ import annotations

import io
import threading
from typing import Any

import pytest
from rich.console import Console

from bridge.bus.messages import AgentStatus, AircraftState, Clock, Header, Links
from lostlink.flight.shown import progress as module
from lostlink.flight.shown.progress import Progress

S = 1_000_000_000


class Output(io.StringIO):
    """Tells when something was written."""

    def __init__(self) -> None:
        super().__init__()
        self.wrote = threading.Condition()

    def write(self, text: str) -> int:
        with self.wrote:
            self.wrote.notify_all()
            return super().write(text)

    def wait_for(self, text: str) -> str:
        with self.wrote:
            assert self.wrote.wait_for(lambda: text in self.getvalue(), 10.0), self.getvalue()
        return self.getvalue()


def clock(seconds: float) -> Clock:
    return Clock(Header.at(round(seconds * S), ""), 1.0, 1.0)


def of_lines(**options: Any) -> tuple[Progress, Output]:
    output = Output()
    return Progress(Console(file=output, width=200), **options), output


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred times as fast."""
    monkeypatch.setattr(module, "LINE_PERIOD_S", 0.02)
    monkeypatch.setattr(module, "LOOK_PERIOD_S", 0.002)


def test_of_a_ua_that_is_unheard_no_numbers_are_shown() -> None:
    nan = float("nan")
    assert module._node_text("0", AircraftState(altitude_rel_m=nan, groundspeed_mps=nan)) == "UA 0 unheard"
    heard = AircraftState(mode="GUIDED", altitude_rel_m=12.3, groundspeed_mps=nan)
    assert module._node_text("0", heard) == "UA 0 GUIDED 12 m"
    station = AircraftState(mode="GROUND", altitude_rel_m=3.0, groundspeed_mps=0.0)
    assert module._node_text("gcs", station) == "node gcs GROUND 3 m 0 m/s"


def test_a_line_says_of_a_link_whose_radio_is_off_that_it_is() -> None:
    nan = float("nan")
    rows = (nan, nan), (nan, nan), (12.0, nan), (12.0, -61.0)
    distances_m, powers_dbm = zip(*rows, strict=True)
    many = [4] * len(rows)
    nodes, tx, rx = ("0", "1", "2", "3"), (0, 1, 2, 3), (1, 2, 3, 1)
    links = Links(
        Header.at(0, ""),
        nodes,
        tx,
        rx,
        distances_m,
        powers_dbm,
        powers_dbm,
        powers_dbm,
        many,
        many,
        (0,),
        ("main",),
        [0] * len(rows),
    )
    shown, output = of_lines()
    assert shown.glance is not None
    shown.glance.links_came(links)
    with shown:
        shown.on_message(clock(0.05))
    since = "4/4 in the last 0.0 s, 4/4 delivered"
    assert output.getvalue().splitlines()[0].split("; ")[1:] == [
        f"0 -> 1: radio off, {since}",
        f"1 -> 2: {since}",
        f"2 -> 3: 12 m, hopeless, {since}",
        f"3 -> 1: 12 m, -61 dBm, {since}",
    ]


def test_a_line_says_how_many_it_leaves_out() -> None:
    """UA by number, then others."""
    nodes = ("gcs", *map(str, range(11)))
    ends = [(tx, rx) for tx in range(12) for rx in range(12) if tx != rx][:5]
    tx, rx = zip(*ends, strict=True)
    numbers = [1.0] * 5
    shown, output = of_lines()
    assert shown.glance is not None
    shown.glance.links_came(
        Links(Header.at(0, ""), nodes, tx, rx, *[numbers] * 4, [4] * 5, [4] * 5, (), ("main",), [0] * 5)
    )
    for node in nodes:
        shown.glance.state_came(node, AircraftState(Header.at(0, node), mode="GUIDED"))
    with shown:
        shown.on_message(clock(0.05))
    parts = output.getvalue().splitlines()[0].split("; ")
    assert [part.split(" GUIDED")[0] for part in parts[1:6]] == [
        "UA 0",
        "UA 1",
        "UA 2",
        "UA 3",
        "and 8 more nodes",
    ]
    assert [part.split(":")[0] for part in parts[6:]] == [
        "gcs -> 0",
        "gcs -> 1",
        "gcs -> 2",
        "gcs -> 3",
        "and 1 more link",
    ]


@pytest.mark.parametrize(
    ("factor", "text"), [(0.0834, "0.083"), (0.5, "0.5"), (0.996, "1.0"), (1.0, "1.0"), (12.34, "12.3")]
)
def test_a_slow_run_is_not_said_to_stand_still(factor: float, text: str) -> None:
    shown, output = of_lines()
    with shown:
        shown.on_message(Clock(Header.at(S, ""), 1.0, factor))
    assert f"real-time factor {text} (target 1)" in output.getvalue()


def test_phases_and_agents_have_lines() -> None:
    shown, output = of_lines()
    with shown:
        shown.on_phase("starts the radio router")
        shown.on_message(AgentStatus(Header.at(0, "1"), "takes off"))
        shown.on_message(AgentStatus(Header.at(0, "gcs"), "listens"))
    lines = output.getvalue().splitlines()
    assert lines == ["starts the radio router", "UA 1 takes off", "node gcs listens"]


def test_ticks_have_a_line_now_and_then(impatient: None) -> None:
    shown, output = of_lines()
    with shown:
        shown.on_message(clock(0.05))
        assert "sim time    0.05 s" in output.getvalue()  # the first one at once
        output.wait_for("sim time    0.05 s, real-time factor 1.0 (target 1); no tick for 0 s")
        shown.on_message(clock(1.0))
        output.wait_for("sim time    1.00 s")


def test_ticks_have_no_more_lines_than_that(monkeypatch: pytest.MonkeyPatch) -> None:
    """A log of a minute has a line each ten seconds."""
    shown, output = of_lines()
    now_s = module.monotonic()
    monkeypatch.setattr(module, "monotonic", lambda: now_s)
    with shown:
        for tick in range(1200):
            now_s += 0.05
            shown.on_message(clock(tick / 20.0))
            shown.on_news(f"writes {tick} rows")
    assert output.getvalue().count("sim time") == 6
    assert "rows" not in output.getvalue()


def test_silence_is_broken_by_what_is_waited_for(impatient: None) -> None:
    shown, output = of_lines()
    with shown:
        shown.on_phase("draws the figure")
        output.wait_for("draws the figure (0 s so far)")
    said = output.getvalue()
    threading.Event().wait(0.05)
    assert output.getvalue() == said  # nothing comes when it is over


def test_quiet_shows_nothing_and_asks_for_nothing(
    capsys: pytest.CaptureFixture[str], impatient: None
) -> None:
    shown, output = of_lines(quiet=True)
    assert shown.glance is None
    with shown:
        shown.on_phase("starts")
        shown.on_message(clock(1.0))
        shown.on_message(AgentStatus(Header.at(0, "1"), "takes off"))
        shown.on_news("writes")
        threading.Event().wait(0.05)
    assert output.getvalue() == ""
    shown.on_error("it broke")
    assert capsys.readouterr().err == "lostlink: it broke\n"


def test_a_terminal_has_a_view_and_no_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    output = Output()
    shown = Progress(Console(file=output, force_terminal=True, width=120, height=30))
    with shown:
        shown.on_phase("waits for the autopilots")
        output.wait_for("waits for the autopilots")
        shown.on_message(clock(0.5))
        shown.on_message(AgentStatus(Header.at(0, "1"), "takes off"))
        said = output.wait_for("takes off")
    assert "flies: sim time    0.50 s" in said
    assert "UA 1 takes off" not in said
