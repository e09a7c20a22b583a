"""What a UA's autopilot has on board, in words: its messages, and home, mission, fence and rally points."""

from __future__ import annotations

import math

from aps.vehicle.missions.items import MissionItem
from aps.wire.dialect import enum_label
from lostlink.view.page.tables import Rows, columns
from lostlink.view.picture.onboard import AutopilotText, Onboard

TEXT_COLUMNS = columns(
    ("time", "sim time s", "right"), ("severity", "severity", "left"), ("text", "message", "left")
)
PLAN_COLUMNS = columns(
    ("number", "item", "right"),
    ("what", "command", "left"),
    ("latitude", "latitude", "right"),
    ("longitude", "longitude", "right"),
    ("height", "height m", "right"),
    ("more", "", "left"),
)
NOT_SEEN = "not transferred in this run"


def text_rows(onboard: Onboard) -> Rows:
    """A row per message of the autopilot, the newest first."""
    return [_text_row(number, text) for number, text in reversed(list(enumerate(onboard.texts)))]


def _text_row(number: int, text: AutopilotText) -> dict[str, object]:
    return {
        "id": number,
        "time": f"{text.sim_time_ns / 1e9:.2f}",
        "severity": enum_label("MAV_SEVERITY", text.severity).lower(),
        "text": text.text,
    }


def onboard_words(onboard: Onboard) -> str:
    """GPS, battery, home and mission in a sentence."""
    fix = "no GPS yet" if onboard.gps_fix < 0 else enum_label("GPS_FIX_TYPE", onboard.gps_fix)
    words = [f"GPS {fix.replace('_', ' ')}, {onboard.satellites} satellites"]
    words += [f"battery {onboard.battery_percent} %"] if onboard.battery_percent >= 0 else []
    if onboard.home is None:
        return "; ".join([*words, "no home yet"])
    lat_deg, lon_deg, alt_m = onboard.home
    return "; ".join([*words, f"home {lat_deg:.6f}, {lon_deg:.6f}, {alt_m:.1f} m above mean sea level"])


def plan_words(onboard: Onboard) -> str:
    """How much of each kind there is, and how far the mission is."""
    counts = {kind: onboard.items(kind) for kind in ("mission", "fence", "rally")}
    words = [f"{kind}: {NOT_SEEN if items is None else _counted(items)}" for kind, items in counts.items()]
    if counts["mission"] and onboard.current >= 0:
        state = onboard.mission_state.replace("_", " ").lower()
        words[0] += f", item {onboard.current} is current{f' ({state})' if state else ''}"
    return "; ".join(words)


def _counted(items: tuple[MissionItem, ...]) -> str:
    return "none" if not items else "1 item" if len(items) == 1 else f"{len(items)} items"


def plan_rows(onboard: Onboard) -> Rows:
    """A row per item: the mission in its order, then fence and rally points."""
    rows: Rows = []
    for number, item in enumerate(onboard.items("mission") or (), onboard.first_item):
        rows.append(_plan_row(item, str(number), "current" if number == onboard.current else ""))
    for kind in ("fence", "rally"):
        for number, item in enumerate(onboard.items(kind) or ()):
            more = f"radius {item.params[0]:g} m" if "circle" in _command(item) else ""
            rows.append(_plan_row(item, f"{kind} {number}", more))
    return rows


def _plan_row(item: MissionItem, number: str, more: str) -> dict[str, object]:
    row: dict[str, object] = {
        "number": number,
        "what": _command(item),
        "latitude": "-",
        "longitude": "-",
        "height": "-",
    }
    if item.is_placed:
        row |= {"latitude": f"{item.params[4]:.6f}", "longitude": f"{item.params[5]:.6f}"}
    if item.is_global and math.isfinite(item.params[6]) and not 5000 < item.command < 5100:
        row["height"] = f"{item.params[6]:.1f}"
    return row | {"more": more}


def _command(item: MissionItem) -> str:
    return enum_label("MAV_CMD", item.command).removeprefix("NAV_").replace("_", " ").lower()
