"""The fleet in words: what the map, the matrix and the log say, for tables and screen readers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bridge.bus.messages import AircraftState
from lostlink.flight.shown.say import factor_text
from lostlink.view.picture.fleet_view import FleetView, NodeInfo
from lostlink.view.picture.losses import Losses

Rows = list[dict[str, Any]]


STILL_S = 3.0
"""Wall time without a tick after which sim time stands still; a run that is slow may take long for one."""
FIRST_S = 1.0
"""A page that is there so early has seen the run from its beginning."""


def columns(*of: tuple[str, str, str], sortable: bool = False) -> Rows:
    """Columns as Quasar's table takes them: of each its name, label and side."""
    more = {"sortable": True} if sortable else {}
    return [{"name": name, "label": label, "field": name, "align": align} | more for name, label, align in of]


FLEET_COLUMNS = columns(
    ("node", "node", "left"),
    ("mode", "mode", "left"),
    ("north", "north m", "right"),
    ("east", "east m", "right"),
    ("height", "height m", "right"),
    ("speed", "m/s", "right"),
    ("hears", "hears", "right"),
    ("heard", "heard by", "right"),
    ("delay", "delay s", "right"),
    sortable=True,
)
AGENT_COLUMNS = columns(
    ("node", "node", "left"), ("activity", "its agent", "left"), ("logged", "names it logs", "left")
)
EMITTER_COLUMNS = columns(
    ("emitter", "emitter", "left"),
    ("frequency", "MHz", "right"),
    ("power", "dBm", "right"),
    ("north", "north m", "right"),
    ("east", "east m", "right"),
    ("height", "height m", "right"),
)
LOGGED_COLUMNS = columns(
    ("name", "name", "left"),
    ("time", "sim time s", "right"),
    ("value", "value", "left"),
    ("drawn", "drawn as", "left"),
)
LOSS_COLUMNS = columns(
    ("cause", "fate", "left"), ("packets", "packets", "right"), ("share", "share", "right")
)
AIR_COLUMNS = columns(
    ("network", "network", "left"),
    ("use", "air in use", "right"),
    ("waiting", "packets waiting", "right"),
    ("wait", "wait s", "right"),
    ("delay", "delay s", "right"),
)


def fleet_rows(view: FleetView, network: str, chosen: int = -1) -> Rows:
    """A row per node: where it is, and who hears whom on a radio network."""
    losses = view.losses[network]
    hears, heard = losses.heard.sum(axis=1), losses.heard.sum(axis=0)
    rows: Rows = []
    for number, node in enumerate(view.nodes):
        north, east, down = view.position_ned_m[number].tolist()
        state = view.news[node.id].state
        rows.append(
            {
                "id": number,
                "node": node.title,
                "chosen": number == chosen,
                "mode": _mode_words(node, state, is_off=number in view.radios_off),
                "north": _number(north),
                "east": _number(east),
                "height": _number(-down),
                "speed": _number(float(np.linalg.norm(view.velocity_ned_mps[number]))),
                "hears": f"{int(hears[number])}/{int(losses.known[number].sum())}",
                "heard": f"{int(heard[number])}/{int(losses.known[:, number].sum())}",
                "delay": _delay(float(losses.delay_s[number].max(initial=0.0))) or "-",
            }
        )
    return rows


def _mode_words(node: NodeInfo, state: AircraftState | None, *, is_off: bool) -> str:
    is_disarmed = node.kind == "ua" and state is not None and not state.armed
    words = [] if state is None else [state.mode, "disarmed" if is_disarmed else ""]
    words += ["radio off"] if is_off else []
    return ", ".join(filter(None, words)) or "-"  # before its first heartbeat an autopilot has no mode


def node_words(view: FleetView, number: int) -> str:
    """What the autopilot of the node that is chosen says of battery and GPS, and its agent of itself; else ""."""
    state = view.news[view.nodes[number].id].state if number >= 0 else None
    if state is None or not state.mav_id:
        return ""
    place = (
        f"{state.latitude_deg:.6f}, {state.longitude_deg:.6f}" if np.isfinite(state.latitude_deg) else "none"
    )
    ready = "armed" if state.armed else "ready to arm" if state.ready_to_arm else "not ready to arm"
    agent = view.news[view.nodes[number].id].agent
    steered = f"; its agent: {agent.activity}" if agent is not None and agent.activity else ""
    return (
        f"{view.nodes[number].title}: {ready}; battery {_number(state.voltage_v)} V, {_number(state.current_a)} A; "
        f"GPS {place}, {_number(state.altitude_rel_m)} m above home{steered}"
    )


def time_words(view: FleetView, *, is_record: bool) -> str:
    """How far it is, and how fast a simulation goes; how fast a record is played is what viewers chose."""
    words = f"{view.sim_time_ns / 1e9:.1f} s of sim time"
    if is_record:
        return words
    if view.still_s >= STILL_S:
        return f"{words}, stands still for {view.still_s:.0f} s"
    return f"{words}, {factor_text(view.clock.real_time_factor)} x real time"


def place_words(view: FleetView) -> str:
    """How far it is of how far it goes."""
    return f"{view.sim_time_ns / 1e9:.1f} / {view.duration_s:.1f} s"


def status_words(view: FleetView, *, is_record: bool) -> str:
    """Whether time goes on."""
    clock = view.clock
    if view.is_over:
        return "over"
    if is_record:
        speed = "as fast as possible" if np.isinf(clock.speed) else f"{clock.speed:g} x"
        return "record, paused" if clock.paused else f"record, played {speed}"
    going = "waits for a tick" if view.still_s >= STILL_S else "running"
    words = "paused" if clock.paused else going if view.sim_time_ns else "waits for the first tick"
    return f"{words}; not waited for: {', '.join(clock.stalled)}" if clock.stalled else words


def emitter_rows(view: FleetView) -> Rows:
    """A row per RF emitter: what it radiates, and where it is."""
    rows: Rows = []
    for emitter, place in zip(view.emitters, view.emitter_position_ned_m.tolist(), strict=True):
        north, east, down = place
        rows.append(
            {
                "emitter": emitter.id,
                "frequency": f"{emitter.frequency_hz / 1e6:.6g}",
                "power": _number(emitter.power_dbm),
                "north": _number(north),
                "east": _number(east),
                "height": _number(-down),
            }
        )
    return rows


def agent_rows(view: FleetView) -> Rows:
    """A row per node: what its agent reports, and how many values it logs."""
    return [
        {
            "id": node.id,
            "node": node.title,
            "activity": agent.activity if (agent := view.news[node.id].agent) else "-",
            "logged": len(view.logged.latest[node.id]),
        }
        for node in view.nodes
    ]


def logged_rows(view: FleetView, node: str) -> Rows:
    """A row per name under which a node's agent logged: the newest value."""
    return [
        {
            "name": name,
            "time": f"{latest.sim_time_ns / 1e9:.2f}",
            "value": latest.text,
            "drawn": str(latest.shape or "-"),
        }
        for name, latest in sorted(view.logged.latest[node].items())
    ]


def loss_rows(losses: Losses) -> Rows:
    """A row per fate."""
    total = max(1, losses.total.total())
    return [
        {"cause": cause.replace("_", " "), "packets": count, "share": f"{100 * count / total:.1f} %"}
        for cause, count in losses.total.most_common()
    ]


def losses_words(losses: Losses) -> str:
    """From when on fates are counted, where that is not the run's first second."""
    since_s = losses.since_s
    if since_s is None or not losses.total:
        return "no packet yet since this page is open"
    return "" if since_s < FIRST_S else f"since {since_s:.1f} s of sim time, when a page was opened"


def air_words(view: FleetView) -> str:
    """Why nothing is known of the air, or of some networks delays alone."""
    if not view.air.networks:
        return "no frame yet: nothing was sent, or the medium is ideal, where packets take no time"
    if routed := view.air.routed:
        return (
            f"{', '.join(routed)}: use and waits are left out, as nodes hand packets on (routing), and the radio's "
            "picture has one hop of each packet alone; the run's summary and report have use_share, of all hops"
        )
    return ""


def air_rows(view: FleetView) -> Rows:
    """A row per network that has had a frame: means of its newest whole second or, later in a long run, more."""
    rows: Rows = []
    for name in view.air.networks:
        series = view.air.series(name)
        if series.use.size:
            use, waiting, wait_s, delay_s = (
                float(values[-1]) for values in (series.use, series.waiting, series.wait_s, series.delay_s)
            )
            rows.append(
                {
                    "network": name,
                    "use": f"{100 * use:.0f} %" if np.isfinite(use) else "",
                    "waiting": f"{waiting:.1f}" if np.isfinite(waiting) else "",
                    "wait": _delay(wait_s),
                    "delay": _delay(delay_s),
                }
            )
    return rows


def link_words(view: FleetView, network: str, tx: int, rx: int, way: Sequence[int] = ()) -> str:
    """One link of a network in a sentence; ``way``: who transmitted its latest packet, from the sender on."""
    links = view.links[network]
    distance_m, power_dbm, snr_db, sent, delivered = (
        float(links.latest(name)[tx, rx])
        for name in ("distance_m", "received_power_dbm", "snr_db", "sent", "delivered")
    )
    names = f"{view.nodes[tx].title} to {view.nodes[rx].title}"
    absent = [view.nodes[end].title for end in (tx, rx) if not view.is_on(end, network)]
    if absent:
        return f"{names}: {' and '.join(absent)} {'is' if len(absent) == 1 else 'are'} not on {network}"
    if not np.isfinite(sent):
        return f"{names}: no packet yet"
    late = _delay(float(view.losses[network].delay_s[rx, tx]))
    silent = [view.nodes[end].title for end in (tx, rx) if end in view.radios_off]
    if silent:
        off = f"radio of {' and of '.join(silent)} off"
        return f"{names}: {off}; {delivered:.0f} of {sent:.0f} packets delivered"
    if view.are_apart(tx, rx):
        return f"{names}: a partition is between them; {delivered:.0f} of {sent:.0f} packets delivered"
    figures = (
        f"{distance_m:.0f} m, {_number(power_dbm)} dBm, SNR {_number(snr_db)} dB, probability of delivery "
        f"{links.probability[tx, rx]:.2f}"
        if np.isfinite(distance_m)
        else "its latest packet never was on the air"
    )
    return (
        f"{names}: {figures}; {delivered:.0f} of {sent:.0f} packets delivered"
        f"{f', the latest after {late} s' if late else ''}{_by_way_of(view, way)}"
    )


def _by_way_of(view: FleetView, way: Sequence[int]) -> str:
    """Who handed packets on."""
    if not way:
        return ""
    relays = ", ".join(view.nodes[node].title for node in way[1:])
    return f", by way of {relays}" if relays else ", directly"


def _delay(delay_s: float) -> str:
    """A delay in seconds, to 1 ms; empty if nothing takes time."""
    return f"{delay_s:.3f}" if delay_s > 0.0 else ""


def _number(value: float) -> str:
    return f"{round(value, 1) + 0.0:.1f}" if np.isfinite(value) else "-"
