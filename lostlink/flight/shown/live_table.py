"""Tables of UA and links for a terminal, as they are now."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rich.table import Table

from bridge.bus.messages import AircraftState, Links


@dataclass(frozen=True, slots=True)
class LinkNow:
    """One directed link, or several together.

    Attributes:
        name: of both ends; with the radio network's, if there are several.
        distance_m: of the latest packet.
        received_power_dbm: likewise; nan if it was hopeless.
        sent: so far.
        delivered: so far.
        sent_lately: since an earlier report, a second of sim time or more ago.
        delivered_lately: likewise.
        is_off: whether the radio of an end is off.
    """

    name: str
    distance_m: float
    received_power_dbm: float
    sent: int
    delivered: int
    sent_lately: int
    delivered_lately: int
    is_off: bool = False

    @property
    def lost_lately(self) -> float:
        """Share of these packets; 0 if there were none."""
        return 1.0 - self.delivered_lately / self.sent_lately if self.sent_lately else 0.0


def links_now(newest: Links, before: Links) -> list[LinkNow]:
    """All links, from the newest report and an earlier one."""
    counts = zip(before.sent, before.delivered, strict=True)
    was = dict(zip(zip(before.radio, before.tx, before.rx, strict=True), counts, strict=True))
    rows = zip(
        newest.radio,
        newest.tx,
        newest.rx,
        newest.distance_m,
        newest.received_power_dbm,
        newest.sent,
        newest.delivered,
        strict=True,
    )
    found = []
    for radio, tx, rx, distance_m, power_dbm, sent, delivered in rows:
        sent_then, delivered_then = was.get((radio, tx, rx), (0, 0))
        on = f"{newest.network[radio]}: " if len(newest.network) > 1 else ""
        name = f"{on}{newest.node[tx]} -> {newest.node[rx]}"
        lately = int(sent - sent_then), int(delivered - delivered_then)
        is_off = tx in newest.radio_off or rx in newest.radio_off
        found.append(LinkNow(name, distance_m, power_dbm, int(sent), int(delivered), *lately, is_off))
    return found


def lately(newest: Links, before: Links) -> str:
    """Since when links are looked at: how much sim time is between two reports."""
    return f"last {(newest.header.stamp.ns - before.header.stamp.ns) / 1e9:.1f} s"


def links_table(links: Sequence[LinkNow], rows_max: int, since: str) -> Table:
    """A row per link; of more than ``rows_max`` those that lose most now, and one for all.

    Args:
        links: as `links_now` gives them.
        rows_max: rows at most.
        since: as `lately` says it.
    """
    table = _table("link", "distance, m", "power, dBm", since, "so far", "delivered")
    shown = list(links)
    if len(links) > rows_max:
        shown = sorted(links, key=lambda link: -link.lost_lately)[: max(1, rows_max - 1)]
    for link in shown:
        table.add_row(*_link_row(link), style="red" if link.lost_lately > 0.5 else None)
    if len(links) > len(shown):
        table.add_row(*_link_row(_together(links)), style="bold")
    return table


def _link_row(link: LinkNow) -> tuple[str, ...]:
    lately = f"{link.delivered_lately} / {link.sent_lately}" if link.sent_lately else "-"
    share = f"{100.0 * link.delivered / link.sent:.1f} %" if link.sent else "-"
    so_far = f"{link.delivered} / {link.sent}"
    power = "radio off" if link.is_off else _number(link.received_power_dbm, 1)
    return link.name, _number(link.distance_m, 1), power, lately, so_far, share


def _together(links: Sequence[LinkNow]) -> LinkNow:
    counts = [
        sum(getattr(link, name) for link in links)
        for name in ("sent", "delivered", "sent_lately", "delivered_lately")
    ]
    return LinkNow(f"all {len(links)}", math.nan, math.nan, *counts)


def ua_table(
    states: Mapping[str, AircraftState], activity: Mapping[str, str], nodes: Sequence[str], rows_max: int
) -> Table:
    """A row per node of which anything is known; of more than ``rows_max`` the first ones, and how the others fare.

    Args:
        states: of UA, by id.
        activity: what agents say of themselves, by node.
        nodes: ids in their order.
        rows_max: rows at most.
    """
    table = _table("node", "mode", "height, m", "speed, m/s", "heartbeat, s ago", "agent", left=("agent",))
    known = [node for node in nodes if node in states or node in activity]
    shown = known if len(known) <= rows_max else known[: max(1, rows_max - 1)]
    for node in shown:
        table.add_row(node, *_state_cells(states.get(node)), activity.get(node, ""))
    rest = known[len(shown) :]
    if rest:
        modes = Counter(states[node].mode for node in rest if node in states)
        text = ", ".join(f"{count} {mode or '-'}" for mode, count in sorted(modes.items()))
        table.add_row(f"{len(rest)} more", text, style="dim")
    return table


def _state_cells(state: AircraftState | None) -> tuple[str, str, str, str]:
    if state is None:
        return "-", "-", "-", "-"
    mode = f"{state.mode or '-'}{'' if state.armed else ', disarmed'}"
    numbers = state.altitude_rel_m, state.groundspeed_mps, state.heartbeat_age_s
    return mode, _number(numbers[0], 1), _number(numbers[1], 1), _number(numbers[2], 1)


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def _table(*columns: str, left: Sequence[str] = ()) -> Table:
    table = Table(box=None, pad_edge=True)
    for index, name in enumerate(columns):
        style = "cyan" if index == 0 else None
        table.add_column(name, justify="left" if name in left else "right", style=style, no_wrap=True)
    return table
