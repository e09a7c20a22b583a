"""What came of a link: a line while it is up, and a summary at its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from bridge.modem.modem import Counts
from bridge.modem.pair import AIR, ENDS, GROUND
from lostlink.modem.live import NS_PER_S, LiveLink

WAYS: Final = {"up": GROUND, "down": AIR}
"""Each way by the end that sends: up from the ground station, down from the autopilot."""


@dataclass(frozen=True, slots=True)
class Tally:
    """What was counted up to an instant: its bytes at the hosts, by end that sent them."""

    at_ns: int
    arrived_bytes: dict[int, int]

    @classmethod
    def of(cls, live: LiveLink) -> Tally:
        """The present one."""
        modems = live.link.pair.modems
        return cls(live.now_ns, {end: modems[1 - end].counts.bytes_out for end in ENDS})


def progress(live: LiveLink, since: Tally) -> tuple[str, Tally]:
    """One line about what went since another tally, and the present tally."""
    now = Tally.of(live)
    span_s = max(now.at_ns - since.at_ns, 1) / NS_PER_S
    parts = []
    for way, end in WAYS.items():
        counts = live.link.pair.modems[end].counts
        rate = (now.arrived_bytes[end] - since.arrived_bytes[end]) / span_s
        waiting_bytes = live.link.pair.waiting_bytes(end)
        parts.append(f"{way} {rate:.0f} B/s, {_percent(loss(counts))} lost, {waiting_bytes} B wait")
        if counts.dropped_bytes:
            parts[-1] += f", {counts.dropped_bytes} B dropped"
    return f"{now.at_ns / NS_PER_S:.0f} s  {';  '.join(parts)}", now


def loss(counts: Counts) -> float | None:
    """Share of what was given to the radio, and is decided, that was lost; None: nothing is decided."""
    lost = counts.units_lost.total()
    decided = lost + counts.units_arrived
    return lost / decided if decided else None


def _percent(share: float | None) -> str:
    return "none" if share is None else f"{100.0 * share:.1f} %"


def summary(live: LiveLink, head: dict[str, Any]) -> dict[str, Any]:
    """All that was counted, for JSON.

    Args:
        live: the link.
        head: what it was made of.
    """
    duration_s = live.now_ns / NS_PER_S
    lateness = live.lateness
    return {
        **head,
        "duration_s": round(duration_s, 3),
        **{way: _way(live, end, duration_s) for way, end in WAYS.items()},
        "late": {
            "outputs": lateness.outputs,
            "late": lateness.late,
            "worst_ms": round(lateness.worst_ns / 1e6, 3),
        },
    }


def _way(live: LiveLink, end: int, duration_s: float) -> dict[str, Any]:
    sender, receiver = live.link.pair.modems[end], live.link.pair.modems[1 - end]
    sent, came = sender.counts, receiver.counts
    return {
        "frames_in": sent.frames_in,
        "frames_out": came.frames_out,
        "bytes_in": sent.bytes_in,
        "bytes_out": came.bytes_out,
        "bytes_per_s": round(came.bytes_out / duration_s, 1),
        "loss": loss(sent),
        "units": sent.units_sent,
        "lost": dict(sorted((cause.value, count) for cause, count in sent.units_lost.items())),
        "dropped_bytes": sent.dropped_bytes,
        "cut_bytes": came.cut_bytes,
        "overrun_bytes": live.overrun_bytes[end],
        "unread_bytes": live.endpoints[1 - end].unread_bytes,
        "waiting_bytes": live.link.pair.waiting_bytes(end) + sender.line_bytes,
        "radio_status": sent.statuses,
    }


def summary_lines(told: dict[str, Any]) -> list[str]:
    """The summary for people."""
    lines = [f"{told['duration_s']:.0f} s over {told['radio']}, seed {told['seed']}"]
    for way in WAYS:
        each = told[way]
        lost = ", ".join(f"{count} {cause}" for cause, count in each["lost"].items())
        line = (
            f"{way}: {each['frames_in']} frames in, {each['frames_out']} out, {each['bytes_per_s']:.0f} B/s"
        )
        line += f"; {_percent(each['loss'])} lost on the air" + (f" ({lost})" if lost else "")
        dropped = {
            "found the modem's buffer full": each["dropped_bytes"],
            "found the buffer to the host full": each["cut_bytes"],
            "came faster than the line": each["overrun_bytes"],
            "nobody read": each["unread_bytes"],
        }
        line += "".join(f"; {count} B {why}" for why, count in dropped.items() if count)
        lines.append(line)
    late = told["late"]
    if late["late"]:
        lines.append(
            f"{late['late']} of {late['outputs']} outputs came more than 10 ms late, the worst "
            f"{late['worst_ms']:.0f} ms: this machine was busy"
        )
    return lines
