"""What a person sees while a run goes on: sim time, real-time factor, separation, power and deliveries."""

from __future__ import annotations

import math
from time import monotonic
from types import TracebackType
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from bridge.bus.messages import AgentStatus, Clock, Links, Message

REFRESH_PER_S = 4
LINE_PERIOD_S = 2.0
"""How often a line is printed where the output is not a terminal."""
LINKS_SHOWN_MAX = 12
LINKS_IN_A_LINE_MAX = 4


class Progress:
    """Shows a run's messages; a live view on a terminal, a line now and then elsewhere, nothing if quiet."""

    def __init__(self, console: Console, *, quiet: bool = False) -> None:
        self._console = console
        self._quiet = quiet
        self._phase = ""
        self._clock = Clock()
        self._links = Links()
        self._activity: dict[str, str] = {}
        self._next_line = 0.0
        self._live: Live | None = None
        if console.is_terminal and not quiet:
            self._live = Live(get_renderable=self._view, console=console, refresh_per_second=REFRESH_PER_S)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def on_phase(self, phase: str) -> None:
        """Show what the supervisor is doing."""
        self._phase = phase
        if self._live is None and not self._quiet:
            self._console.print(phase, highlight=False)

    def on_message(self, message: Message) -> None:
        """Take a message of the run."""
        if isinstance(message, Clock):
            if message.header.stamp.ns and not self._clock.header.stamp.ns:
                self._phase = "flies"
            self._clock = message
            self._maybe_line()
        elif isinstance(message, Links):
            self._links = message
        elif isinstance(message, AgentStatus):
            self._activity[message.header.frame_id] = message.activity
            if self._live is None and not self._quiet:
                self._console.print(f"UA {message.header.frame_id} {message.activity}", highlight=False)

    def _maybe_line(self) -> None:
        if self._live is not None or self._quiet or monotonic() < self._next_line:
            return
        self._next_line = monotonic() + LINE_PERIOD_S
        rows = range(min(len(self._links.tx), LINKS_IN_A_LINE_MAX))
        links = "".join(f"; {_one_line(self._links, row)}" for row in rows)
        self._console.print(f"{self._time()}{links}", highlight=False, soft_wrap=True)

    def _time(self) -> str:
        clock = self._clock
        target = "max" if math.isinf(clock.speed) else f"{clock.speed:g}"
        stalled = f", stalled: UA {', '.join(clock.stalled)}" if clock.stalled else ""
        seconds = clock.header.stamp.ns / 1e9
        return f"sim time {seconds:7.2f} s, real-time factor {clock.real_time_factor:.1f} (target {target}){stalled}"

    def _view(self) -> Group:
        lines = [Text(f"{self._phase}: {self._time()}", style="bold")]
        lines += [Text(f"  UA {node} {activity}") for node, activity in sorted(self._activity.items())]
        return Group(*lines, self._table())

    def _table(self) -> Table:
        table = Table(box=None, pad_edge=True)
        for name in (
            "link",
            "separation, m",
            "received power, dBm",
            "PER",
            "delivered / sent",
            "delivered, %",
        ):
            table.add_column(name, justify="right", style="cyan" if name == "link" else None)
        links = self._links
        for row in range(min(len(links.tx), LINKS_SHOWN_MAX)):
            sent, delivered = links.sent[row], links.delivered[row]
            table.add_row(
                _name(links, row),
                f"{links.distance_m[row]:.1f}",
                f"{links.received_power_dbm[row]:.1f}",
                f"{links.per[row]:.3f}",
                f"{delivered} / {sent}",
                f"{100 * delivered / sent if sent else math.nan:.1f}",
            )
        return table


def _name(links: Links, row: int) -> str:
    return f"{links.node[links.tx[row]]} -> {links.node[links.rx[row]]}"


def _one_line(links: Links, row: int) -> str:
    return (
        f"{_name(links, row)}: {links.distance_m[row]:.0f} m, {links.received_power_dbm[row]:.0f} dBm, "
        f"{links.delivered[row]}/{links.sent[row]} delivered"
    )
