"""What a person sees while a run goes on: tables of UA and links on a terminal, lines elsewhere; never silence."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from bridge.bus.messages import GROUND_MODE, AgentStatus, AircraftState, Clock, Message
from bridge.fleet.glance import Glance
from bridge.timeouts import LOG_PERIOD_S
from lostlink.flight.flight import Watcher
from lostlink.flight.shown.live_table import LinkNow, lately, links_now, links_table, ua_table
from lostlink.flight.shown.say import factor_text, say

REFRESH_PER_S = 2
LINE_PERIOD_S = LOG_PERIOD_S
"""How often a line is printed where the output is not a terminal: also if nothing is new."""
LOOK_PERIOD_S = 0.2
ROWS_MAX = 12
"""Of each table."""
OTHER_LINES = 6
"""Of a terminal, beside the rows of the tables."""
IN_A_LINE_MAX = 4
"""UA, and links, that a line names."""


class Progress(Watcher):
    """Shows a run's messages; a live view on a terminal, a line now and then elsewhere, nothing if quiet.

    Args:
        console: where to.
        quiet: errors and warnings alone.
        on_unread: called when nobody reads any more, in whichever thread finds it.

    Attributes:
        glance: where states and link reports are to be kept for it; None: it shows none.
    """

    def __init__(
        self, console: Console, *, quiet: bool = False, on_unread: Callable[[], object] = lambda: None
    ) -> None:
        self.glance = None if quiet else Glance()
        self._console, self._on_unread = console, on_unread
        self._quiet = quiet
        self._phase = "starts"
        self._phase_s = self._said_s = self._tick_s = monotonic()
        self._next_line_s = 0.0
        self._clock = Clock()
        self._activity: dict[str, str] = {}
        self._live: Live | None = None
        self._over = threading.Event()
        self._pulse: threading.Thread | None = None
        if quiet:
            return
        if console.is_terminal:
            self._live = Live(get_renderable=self._view, console=console, refresh_per_second=REFRESH_PER_S)
        else:
            self._pulse = threading.Thread(target=self._speak_up, name="progress", daemon=True)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        if self._pulse is not None:
            self._pulse.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()
        if self._pulse is not None:
            self._over.set()
            self._pulse.join()

    # What is reported.

    def on_phase(self, phase: str) -> None:
        """Show what is being done."""
        self._begin(phase)
        self._say(phase)

    def on_message(self, message: Message) -> None:
        """Take a message of the run."""
        if isinstance(message, Clock):
            if message.header.stamp.ns and not self._clock.header.stamp.ns:
                self._begin("flies")
            self._clock, self._tick_s = message, monotonic()
            if self._tick_s >= self._next_line_s and self._pulse is not None:
                self._next_line_s = self._tick_s + LINE_PERIOD_S
                self._say(self._line())
        elif isinstance(message, AgentStatus):
            self._activity[message.header.frame_id] = message.activity
            node = message.header.frame_id
            self._say(f"{'UA' if node.isdecimal() else 'node'} {node} {message.activity}")

    def on_error(self, text: str) -> None:
        """Show what went wrong, also if quiet."""
        with self._unread_told():
            say(f"lostlink: {text}", err=True)

    def on_warning(self, text: str) -> None:
        """Show what somebody must see, also if quiet."""
        with self._unread_told():
            say(f"warning: {text}", err=True)

    def on_news(self, text: str) -> None:
        """Show how far something long is."""
        self._phase = text

    def _begin(self, phase: str) -> None:
        self._phase, self._phase_s = phase, monotonic()

    # As lines.

    def _say(self, text: str) -> None:
        """Print a line, if this is how it is shown."""
        if self._pulse is not None:
            self._said_s = monotonic()
            self.tell(text)

    def tell(self, text: str) -> None:
        """Print a line."""
        with self._unread_told():
            self._console.print(text, soft_wrap=True)

    @contextmanager
    def _unread_told(self) -> Iterator[None]:
        try:
            yield
        except (BrokenPipeError, SystemExit):  # the second is rich's, which prints nothing from then on
            self._on_unread()

    def _speak_up(self) -> None:
        """In a thread: when nothing was printed for a while, print what is waited for."""
        while not self._over.wait(LOOK_PERIOD_S):
            now_s = monotonic()
            if now_s - self._said_s >= LINE_PERIOD_S:
                self._say(self._waiting(now_s))

    def _waiting(self, now_s: float) -> str:
        if self._phase == "flies":
            silent_s = now_s - self._tick_s
            return (
                f"{self._time()}; no tick for {silent_s:.0f} s" if silent_s >= LINE_PERIOD_S else self._time()
            )
        return f"{self._phase} ({now_s - self._phase_s:.0f} s so far)"

    def _line(self) -> str:
        states, links, since = self._look()
        parts = [self._time()]
        parts += [_node_text(node, states[node]) for node in _in_order(states)[:IN_A_LINE_MAX]]
        parts += _and_more(len(states), "node")
        parts += [_link_text(link, since) for link in links[:IN_A_LINE_MAX]]
        parts += _and_more(len(links), "link")
        return "; ".join(parts)

    # On a terminal.

    def _view(self) -> RenderableType:
        states, links, since = self._look()
        nodes = _in_order({*states, *self._activity})
        rows = max(2, min(ROWS_MAX, (self._console.height - OTHER_LINES) // 2))
        flying = self._phase == "flies"
        seconds = "" if flying else f" ({monotonic() - self._phase_s:.0f} s)"
        parts: list[RenderableType] = [Text(f"{self._phase}{seconds}: {self._time()}", style="bold")]
        if nodes:
            parts.append(ua_table(states, self._activity, nodes, rows))
        if links:
            parts.append(links_table(links, rows, since))
        return Group(*parts)

    # Both.

    def _look(self) -> tuple[dict[str, AircraftState], list[LinkNow], str]:
        if self.glance is None:
            return {}, [], ""
        reports = self.glance.links()
        return self.glance.states(), links_now(*reports), lately(*reports)

    def _time(self) -> str:
        clock = self._clock
        target = "max" if math.isinf(clock.speed) else f"{clock.speed:g}"
        stalled = f", stalled: UA {', '.join(clock.stalled)}" if clock.stalled else ""
        seconds = clock.header.stamp.ns / 1e9
        factor = factor_text(clock.real_time_factor)
        return f"sim time {seconds:7.2f} s, real-time factor {factor} (target {target}){stalled}"


def _in_order(nodes: Iterable[str]) -> list[str]:
    """UA by number, then other nodes."""
    return sorted(nodes, key=lambda node: (not node.isdecimal(), len(node), node))


def _and_more(count: int, what: str) -> list[str]:
    """What a line says of those that it does not name."""
    more = count - IN_A_LINE_MAX
    return [f"and {more} more {what}{'s' * (more > 1)}"] if more > 0 else []


def _node_text(node: str, state: AircraftState) -> str:
    told = [
        f"{value:.0f} {unit}"
        for value, unit in ((state.altitude_rel_m, "m"), (state.groundspeed_mps, "m/s"))
        if math.isfinite(value)
    ]
    who = f"node {node}" if state.mode == GROUND_MODE else f"UA {node}"
    return " ".join([who, state.mode or "unheard", *told])


def _link_text(link: LinkNow, since: str) -> str:
    drawn = [f"{link.distance_m:.0f} m", _power_text(link)] if math.isfinite(link.distance_m) else []
    told = [
        *(["radio off"] if link.is_off else drawn),
        f"{link.delivered_lately}/{link.sent_lately} in the {since}",
        f"{link.delivered}/{link.sent} delivered",
    ]
    return f"{link.name}: {', '.join(told)}"


def _power_text(link: LinkNow) -> str:
    return "hopeless" if math.isnan(link.received_power_dbm) else f"{link.received_power_dbm:.0f} dBm"
