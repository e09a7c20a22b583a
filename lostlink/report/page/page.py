"""The page of a report, from its numbers and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from lostlink.flight.exits import RunOutcome
from lostlink.reading.air.capacity import rate_text
from lostlink.reading.air.use import BUSY_NS, NS_PER_S
from lostlink.reading.named import named
from lostlink.report.packets import link_name
from lostlink.report.page.words import NOTHING, count, num, share
from lostlink.report.pictures.all import key_of
from lostlink.report.pictures.radio import told_of_delivery

if TYPE_CHECKING:
    from jinja2 import Environment

LINKS_MAX = 100
EVENTS_MAX = 200
MULTIPLE_FROM = 10.0
"""Shares from here on are told as multiples."""
SECTIONS = (
    ("ran", "What ran"),
    ("judged", "Verdict"),
    ("flown", "Where they were"),
    ("delivery", "Delivery and power"),
    ("links", "Links"),
    ("losses", "Losses"),
    ("air", "Air"),
    ("ages", "Ages and latency"),
    ("machine", "Machine"),
    ("events", "Events"),
)
STATUS = {RunOutcome.PASS: "pass", RunOutcome.FAIL: "fail", RunOutcome.BROKE_OFF: "fail"}
"""Outcomes that have a colour."""
Row = list[Any]


@cache
def environment() -> Environment:
    """Templates of this folder; what they are given is escaped, and a name that is missing is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("lostlink.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {"num": num, "share": share, "count": count}
    return made


def render(template: str, pictures: Mapping[str, str], **values: Any) -> str:
    """A page of a template; pictures and style sheet are taken as they are."""
    from markupsafe import Markup

    made = environment()
    assert made.loader is not None
    style = Markup(made.loader.get_source(made, "style.css")[0])
    drawn = {name: Markup(picture) for name, picture in pictures.items()}
    return made.get_template(template).render(pictures=drawn, style=style, **values)


def page_of(content: dict[str, Any], pictures: Mapping[str, str]) -> str:
    """The whole page: one file that asks for nothing."""
    several = len(content["run"]["radio_networks"]) > 1
    networks = [
        each
        | {"on": f" on {each['radio']}" if several else "", "key": key_of(content, each["radio"])}
        | {"power_rows": [_power(box) for box in each["powers"]["boxes"]]}
        for each in content["networks"]
    ]
    return render(
        "report.html.j2",
        pictures,
        c=content,
        networks=networks,
        totals=networks or [content["totals"] | {"on": ""}],
        status=STATUS.get(content["run"]["outcome"], ""),
        sections=SECTIONS,
        facts=_facts(content["run"]),
        versions=_versions(content["provenance"]),
        expectations=[_expectation(each) for each in content["expectations"]],
        checks=[
            [c["name"], count(c["size"]), num(c["found"]), num(c["chance"]), _sees(c), _passed(c["passed"])]
            for c in content["checks"]
        ],
        nodes=[_node(node) for node in content["nodes"]],
        delivery_caption=told_of_delivery(content) if content["bins"] else "",
        links=[_link(link, is_only=not several) for link in _worst(content["links"])],
        links_caption=_links_caption(len(content["links"])),
        routes=[_route(route) for route in _most_used(content["routes"])],
        routes_caption=_routes_caption(len(content["routes"])),
        routing=[row for each in content["routing"] for row in _routing(each, content["run"])],
        causes=[row for each in networks for row in _causes(each, is_only=not several)],
        air=[row for each in content["air"] for row in _air(each)],
        air_use_captions={each["radio"]: _air_use_caption(each) for each in content["air"]},
        timed=[row for each in networks for row in _timed(each)],
        machine=_machine(content),
        counters=[
            [reporter, name, count(number)]
            for reporter, counters in content["host"]["counters"].items()
            for name, number in counters.items()
        ],
        events=[
            [num(e["sim_time_ns"] / 1e9), e["node"], e["kind"], e["text"]]
            for e in content["events"][:EVENTS_MAX]
        ],
        events_caption=_events_caption(len(content["events"])),
    )


def _sees(check: dict[str, Any]) -> str:
    return f"{check['wrong']}: {check['power']:.0%}" if check.get("power") is not None else ""


def _facts(run: dict[str, Any]) -> list[Row]:
    rows: list[Row] = [
        ["scenario", run["scenario"]],
        ["radio", run["radio"]],
        ["medium", run["medium"]],
        ["autopilot", run["autopilot"]],
        ["seed", run["seed"]],
        ["speed asked for", run["speed"]],
        ["ticks", f"{run['tick_rate_hz']} per second of sim time"],
        ["ending", run["ending"]],
        ["digest", run["digest"] or "none: the run has no end"],
    ]
    rows += [["not that of the record", line] for line in run["summary_mistakes"]]
    if run["unfinished"]:
        rows.append(["not finished", named([*map(str, run["unfinished"])])])
    if run["redecided_from"]:
        rows.append(["decided anew from", run["redecided_from"]])
    return rows


def _versions(provenance: dict[str, Any] | None) -> list[Row]:
    if provenance is None:
        return []
    rows: list[Row] = []
    for name, value in provenance.items():
        if isinstance(value, dict):
            rows += [[f"{name}: {key}", _flat(each)] for key, each in value.items()]
        elif value:
            rows.append([name, _flat(value)])
    return rows


def _flat(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_flat(each)}" for key, each in value.items() if each)
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _expectation(each: dict[str, Any]) -> Row:
    nothing = each.get("error") or "nothing of the kind"
    found = nothing if each["found"] is None else f"{num(each['found'])} {each['unit']}".strip()
    return [each["name"], each["wanted"], found, _passed(each["passed"])]


def _passed(is_passed: bool) -> Any:
    return environment().get_template("parts.html.j2").make_module().passed(is_passed)  # type: ignore[attr-defined]


def _node(node: dict[str, Any]) -> Row:
    numbers = ("height_min_m", "height_max_m", "farthest_m", "way_m", "speed_max_mps")
    return [node["title"], node["kind"], *(num(node[name], 1) for name in numbers)]


def _power(box: dict[str, Any]) -> Row:
    numbers = [num(box[name], 1) for name in ("low", "q1", "median", "q3", "high")]
    distance = f"{box['distance_min_m']:g} to {box['distance_max_m']:g}"
    return [distance, count(box["packets"]), count(box["without_power"]), *numbers]


def _worst(links: Sequence[dict[str, Any]]) -> Sequence[dict[str, Any]]:
    """All of a few links; of many those that lose most."""
    if len(links) <= LINKS_MAX:
        return links
    return sorted(links, key=lambda link: link["delivery"] if link["delivery"] is not None else 2.0)[
        :LINKS_MAX
    ]


def _most_used(routes: Sequence[dict[str, Any]]) -> Sequence[dict[str, Any]]:
    """All of a few links; of many those on which most packets came."""
    if len(routes) <= LINKS_MAX:
        return routes
    return sorted(routes, key=lambda route: -route["delivered"])[:LINKS_MAX]


def _routes_caption(routes: int) -> str:
    told = "By which nodes packets came: the most used way of each link, and its share"
    if routes <= LINKS_MAX:
        return told
    return f"{told}; the {LINKS_MAX} links of {routes} on which most packets came, all are in the JSON"


def _links_caption(links: int) -> str:
    if links <= LINKS_MAX:
        return "Each directed link"
    return f"The {LINKS_MAX} directed links of {links} that lose most; all are in the JSON"


def _link(link: dict[str, Any], *, is_only: bool) -> Row:
    lost = ", ".join(f"{cause.replace('_', ' ')} {count(number)}" for cause, number in link["lost"].items())
    ages = [num(link[name]) for name in ("age_mean_s", "age_p95_s", "age_peak_s")]
    late = [num(link[name]) for name in ("latency_mean_s", "latency_max_s")]
    head = [
        link_name(link["tx"], link["rx"], link["radio"], is_only=is_only),
        count(link["sent"]),
        count(link["delivered"]),
        share(link["delivery"]),
    ]
    return [*head, *ages, *late, lost]


def _route(route: dict[str, Any]) -> Row:
    way = " > ".join([*route["way"], route["rx"]])
    numbers = [count(route["delivered"]), num(route["hops_mean"]), count(route["changes"])]
    return [f"{route['tx']} to {route['rx']}", *numbers, way, share(route["share"])]


def _routing(counts: dict[str, Any], run: dict[str, Any]) -> list[Row]:
    radio, sim_s = counts["radio"], run["sim_duration_s"]

    def on_air(name: str) -> str:
        on_air_s = counts[name] / NS_PER_S
        return f"{num(on_air_s)} s" + (f", {share(on_air_s / sim_s)} of the time" if sim_s else "")

    return [
        [f"packets on {radio}: transmitted by their senders", count(counts["sent"])],
        ["by others, who handed them on", count(counts["handed_on"])],
        ["both on the air", on_air("packet_air_ns")],
        ["received again by a node that had them", count(counts["duplicates"])],
        [f"notices of routes on {radio}", count(counts["notices"])],
        ["on the air", on_air("notice_air_ns")],
    ]


def _causes(network: dict[str, Any], *, is_only: bool) -> list[Row]:
    on = "" if is_only else f"{network['radio']}: "
    return [
        [f"{on}{cause.replace('_', ' ')}", count(number), share(number / network["sent"])]
        for cause, number in network["lost"].items()
    ]


def _air(air: dict[str, Any]) -> list[Row]:
    whose = f", of the busiest {air['shared_by']}," if not air["is_shared"] else ""
    carrier = f"the medium carries{whose}" if air["takes_time"] else "the radio’s bit rate would carry"
    capacity = air["capacity_bps"]
    rows: list[Row] = [
        [
            f"medium of {air['radio']}",
            air["medium"] if air["takes_time"] else f"{air['medium']}: packets take no time",
        ],
        ["packets given to the radio", count(air["packets"])],
        ["their payload", rate_text(air["offered_bps"])],
        [f"what {carrier} of such packets", NOTHING if capacity is None else rate_text(capacity)],
        ["load offered, as a share of that", _times(air["share"])],
        [f"in the busiest {BUSY_NS / NS_PER_S:g} s", _times(air["busiest_share"])],
        [f"most payload received, by node {air['received_most_node']}", rate_text(air["received_most_bps"])],
    ]
    if air["takes_time"]:
        rows += [
            ["time in which frames were on the air, added up", share(air["use_share"])],
            ["wait before the transmission, median and 95 %", _two(air, "wait")],
            ["delay from the agent’s word to arrival, median and 95 %", _two(air, "delay")],
            ["receptions lost for want of time on the air", count(air["lost_waiting"])],
            ["of these, waiting when the run ended", count(air["waiting_at_end"])],
            ["of these, replaced by newer packets with their key", count(air["replaced"])],
        ]
    return rows


def _air_use_caption(air: dict[str, Any]) -> str:
    """What the line of use is, or why it is missing."""
    if air["series"]["use_share"] is not None:
        return (
            " Use is the time in which frames are on the air, added up over senders, so that frames at once count "
            "several times."
        )
    if air["is_routed"] and air["takes_time"]:
        return " Use is not drawn over time: nodes hand packets on, and the record has the sum of all hops, below."
    return ""


def _times(value: float) -> str:
    """A share in per cent, or as a multiple where it is one."""
    return share(value) if value < MULTIPLE_FROM else f"{value:.3g} times"


def _two(air: dict[str, Any], name: str) -> str:
    return f"{num(air[f'{name}_p50_s'])} s, {num(air[f'{name}_p95_s'])} s"


def _timed(network: dict[str, Any]) -> list[Row]:
    on = network["on"]
    return [
        [f"age{on}, mean over time and links", num(network["age_mean_s"])],
        [f"age that the worst link{on} does not exceed for 95 % of the time", num(network["age_p95_s"])],
        [f"greatest age of any link{on}", num(network["age_peak_s"])],
        [f"latency{on}, mean of the links", num(network["latency_mean_s"])],
        [f"greatest latency of any packet{on}", num(network["latency_max_s"])],
    ]


def _machine(content: dict[str, Any]) -> list[Row]:
    run, host = content["run"], content["host"]
    lost = ", ".join(f"node {node}: {count(number)}" for node, number in host["lost"].items())
    refused = ", ".join(
        f"{reason.replace('_', ' ')}: {count(number)}" for reason, number in host["refused"].items()
    )
    return [
        ["sim time", f"{num(run['sim_duration_s'])} s"],
        ["wall time", f"{num(run['wall_duration_s'])} s"],
        ["real-time factor", num(run["real_time_factor"])],
        ["packets lost by the host before the radio", lost or "none"],
        ["not accepted by the radio", refused or "nothing"],
    ]


def _events_caption(events: int) -> str:
    return "What the run's processes reported" + (
        f"; the first {EVENTS_MAX} of {events}" if events > EVENTS_MAX else ""
    )
