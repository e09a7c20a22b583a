"""The page: map on the left, what is known in detail on the right, time below. One per viewer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from nicegui import ui

from bridge.agents.frames import Frames
from lostlink.view.page.charts import (
    DARK,
    LIGHT,
    Look,
    ModelCurve,
    air_chart,
    delivery_chart,
    link_chart,
    losses_chart,
    matrix_chart,
)
from lostlink.view.page.controls import ViewControls
from lostlink.view.page.logged_panel import LoggedPanel
from lostlink.view.page.onboard_panels import OnboardPanels
from lostlink.view.page.parts import button, chart, set_options, set_rows, table
from lostlink.view.page.scene import Scene
from lostlink.view.page.style import CSS
from lostlink.view.page.tables import (
    AGENT_COLUMNS,
    AIR_COLUMNS,
    EMITTER_COLUMNS,
    FLEET_COLUMNS,
    LOSS_COLUMNS,
    agent_rows,
    air_rows,
    air_words,
    emitter_rows,
    fleet_rows,
    link_words,
    loss_rows,
    losses_words,
    node_words,
    status_words,
    time_words,
)
from lostlink.view.page.timeline import Timeline
from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.picture.plan import PlanDrawing
from lostlink.view.sources.onboard import Onboards
from lostlink.view.sources.operator import Operator
from lostlink.view.sources.time_control import TimeControl

REFRESH_S = 0.5
"""How often numbers are shown anew; the map has a pace of its own."""
CHARTS_EVERY = 2
"""Charts are drawn anew at every so many of these."""
LEGEND = "Colours of links: from red, nothing arrives, to blue, everything does"
LINES_SHOWN = 100
MANY_NODES = 12
"""From so many on the map begins with the links of the chosen node alone."""
SWITCHES = {
    "trails": "trails",
    "losses": "losses",
    "wind": "wind",
    "shapes": "estimates, plans",
    "plan": "mission",
}
"""What of the map can be left out, and what it is called."""
THEMES = {"auto": "as the system", "light": "light", "dark": "dark"}
_NODE_BUTTON = """
<q-td :props="props"><q-btn dense flat no-caps :label="props.value" :aria-pressed="props.row.chosen ? 'true' : 'false'"
  :color="props.row.chosen ? 'primary' : undefined" @click="() => $parent.$emit('choose', props.row.id)" /></q-td>
"""
_WATCH_THEME = """
const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", (e) => emitEvent("ll_dark", e.matches));
emitEvent("ll_dark", dark.matches);
"""


@dataclass(frozen=True, slots=True)
class Shown:
    """What pages show.

    Attributes:
        name: of the run.
        view: the picture, which somebody else feeds.
        model: makes the model's curve on a radio network up to a distance, for packets that are counted by length.
        time_control: None if time cannot be changed.
        operator: who commands; None: nobody may.
        frames: of the fleet; None: where it is on the earth is not known.
        onboards: what autopilots have on board; None: it is not known.
        way: who transmitted the latest packet on a network's link, from its sender on; empty if nobody handed it on.
    """

    name: str
    view: FleetView
    model: Callable[[str, float, Mapping[int, int]], ModelCurve]
    time_control: TimeControl | None = None
    operator: Operator | None = None
    frames: Frames | None = None
    onboards: Onboards | None = None
    way: Callable[[str, int, int], Sequence[int]] = lambda _network, _tx, _rx: ()


class Page:
    """The page of one viewer."""

    def __init__(self, shown: Shown) -> None:
        self._shown, self._view = shown, shown.view
        self._node = -1
        many = len(self._view.nodes) > 1
        self._network, self._link = self._view.networks[0], (0, 1 if many else 0)
        self._is_dark, self._theme = False, "auto"
        self._told = self._forgotten = 0
        ui.add_css(CSS)
        self._dark = ui.dark_mode(None)
        self._build()
        ui.on("ll_dark", self._system_theme)
        ui.run_javascript(_WATCH_THEME)
        self._beats = 0
        ui.timer(REFRESH_S, self._beat)

    @property
    def _look(self) -> Look:
        return DARK if (self._is_dark if self._theme == "auto" else self._theme == "dark") else LIGHT

    def _system_theme(self, event: object) -> None:
        self._is_dark = bool(getattr(event, "args", False))
        self.refresh()

    def _choose_theme(self, theme: str) -> None:
        self._theme = theme
        self._dark.set_value({"auto": None, "light": False, "dark": True}[theme])
        self.refresh()

    # What is where.

    def _build(self) -> None:
        with ui.element("header").classes("row ll-bar full-width"):
            with ui.element("h1"):
                ui.html(f"lostlink: {_escaped(self._shown.name)}", sanitize=False)
            self._time = ui.label().classes("ll-time")
            self._status = ui.label().props('role="status"')
            ui.space()
            if len(self._view.networks) > 1:
                ui.select(
                    list(self._view.networks),
                    value=self._network,
                    on_change=lambda e: self._choose_network(e.value),
                ).props('dense dark borderless options-dense prefix="network" aria-label="Radio network"')
            ui.select(THEMES, value="auto", on_change=lambda e: self._choose_theme(e.value)).props(
                'dense dark borderless options-dense aria-label="Colours"'
            )
        with ui.element("div").classes("ll-main"):
            with ui.element("section").classes("ll-panel").props('aria-label="Map and time"'):
                self._build_map()
                self._timeline = Timeline(self._view, self._shown.time_control)
            with ui.element("section").classes("ll-panel").props('aria-label="Details"'):
                self._build_details()

    def _build_map(self) -> None:
        links = "selected" if len(self._view.nodes) > MANY_NODES else "all"
        with ui.element("div").classes("ll-tools").props('role="toolbar" aria-label="Map"'):
            scene: Scene
            ui.toggle(
                {"map": "Map", "3d": "3-D"}, value="map", on_change=lambda e: scene.look(e.value)
            ).props('dense no-caps aria-label="View"')
            button("Fit", lambda: scene.fit(), "Show the whole fleet")
            button("+", lambda: scene.zoom(1.25), "Zoom in")
            button("-", lambda: scene.zoom(0.8), "Zoom out")
            ui.select(
                {"all": "all links", "selected": "links of the chosen node", "none": "no links"},
                value=links,
                on_change=lambda e: scene.show("links", e.value),
            ).props('dense options-dense borderless aria-label="Links"')
            for what, label in SWITCHES.items():
                ui.checkbox(
                    label, value=True, on_change=lambda e, what=what: scene.show(what, e.value)
                ).props("dense")
            ui.space()
            with ui.element("span").classes("ll-scale").props(f'role="img" aria-label="{LEGEND}"'):
                ui.label("delivery 0")
                ui.element("span").classes("ll-legend")
                ui.label("1")
        with ui.element("div").classes("ll-scene"):
            scene = self._scene = Scene(self._choose_node)
        scene.show("links", links)

    def _build_details(self) -> None:
        self._onboard = self._onboard_panels()
        onboard = ("Plan", "Messages") if self._onboard is not None else ()
        with ui.tabs().props('dense no-caps align="left" aria-label="Details"') as tabs:
            for name in (
                "Fleet",
                *onboard,
                "Link",
                "Delivery",
                "Losses",
                "Air",
                "Matrix",
                "Agents",
                "Logged",
            ):
                ui.tab(name)
        self._tabs = tabs
        with ui.tab_panels(tabs, value="Fleet", on_change=lambda _: self.refresh(), animated=False):
            with ui.tab_panel("Fleet"), ui.element("div").classes("ll-tab"):
                self._build_fleet()
            if self._onboard is not None:
                with ui.tab_panel("Plan"), ui.element("div").classes("ll-tab"):
                    self._onboard.build_plan()
                with ui.tab_panel("Messages"), ui.element("div").classes("ll-tab"):
                    self._onboard.build_messages()
            with ui.tab_panel("Link"), ui.element("div").classes("ll-tab"):
                self._build_link()
            with ui.tab_panel("Delivery"), ui.element("div").classes("ll-tab"):
                self._delivery = chart("Probability of delivery against distance, measured and by the model")
            with ui.tab_panel("Losses"), ui.element("div").classes("ll-tab"):
                self._losses_words = ui.label().classes("ll-words")
                self._losses = chart("Share of packets that were lost to each cause, over sim time")
                self._causes = table("Fates of packets", LOSS_COLUMNS, "cause")
            with ui.tab_panel("Air"), ui.element("div").classes("ll-tab"):
                self._air_words = ui.label().classes("ll-words")
                self._air = chart("Use of the air of each radio network and delay on it, over sim time")
                self._networks = table("Radio networks on which packets take time", AIR_COLUMNS, "network")
            with ui.tab_panel("Matrix"), ui.element("div").classes("ll-tab"):
                self._matrix = chart("Share of packets delivered from each node to each other")
            with ui.tab_panel("Agents"), ui.element("div").classes("ll-tab"):
                self._agents = table("Agents", AGENT_COLUMNS, "id")
            with ui.tab_panel("Logged"), ui.element("div").classes("ll-tab"):
                self._logged = LoggedPanel(self._view, self.refresh)
        name = 'aria-label="What nodes and operators said"'
        with ui.element("div").classes("ll-said").props(f'tabindex="0" role="region" {name}'):
            self._said = ui.element("ol").props(f'role="log" {name}')

    def _onboard_panels(self) -> OnboardPanels | None:
        shown = self._shown
        if shown.onboards is None or shown.frames is None:
            return None
        return OnboardPanels(self._view, shown.onboards, PlanDrawing(shown.frames), shown.operator)

    def _build_fleet(self) -> None:
        self._fleet = table("Fleet", FLEET_COLUMNS, "id").classes("ll-long")
        self._fleet.add_slot("body-cell-node", _NODE_BUTTON)
        self._fleet.on("choose", lambda e: self._choose_node(int(e.args)))
        self._chosen = ui.label().classes("ll-words")
        self._emitters = table("Emitters", EMITTER_COLUMNS, "emitter") if self._view.emitters else None
        self._controls = self._view_controls()

    def _view_controls(self) -> ViewControls | None:
        shown = self._shown
        if shown.operator is None or shown.frames is None:
            return None
        chosen, choose = lambda: self._node, self._choose_node
        return ViewControls(self._view, shown.operator, chosen, choose, self._scene, shown.frames)

    def _build_link(self) -> None:
        names = {number: node.title for number, node in enumerate(self._view.nodes)}
        tx, rx = self._link
        with ui.element("div").classes("ll-tools"):
            self._ends = (
                ui.select(
                    names,
                    value=tx,
                    label="from",
                    on_change=lambda e: self._choose_link(e.value, self._link[1]),
                ),
                ui.select(
                    names, value=rx, label="to", on_change=lambda e: self._choose_link(self._link[0], e.value)
                ),
            )
            for end in self._ends:
                end.props("dense options-dense")
            button("Swap", self._swap_link, "The other direction of the link")
        self._words = ui.label().classes("ll-words")
        self._link_chart = chart("Received power, SNR and delivery of the link over sim time")

    # What a viewer does.

    def _choose_node(self, number: int) -> None:
        self._node = number
        self._scene.select(number)
        if self._onboard is not None:
            self._onboard.choose(number)
        if number >= 0:
            self._logged.choose(number)
        if number >= 0 and len(self._view.nodes) > 1 and number not in self._link:
            self._choose_link(number, self._link[0])
        self.refresh()

    def _choose_network(self, network: str) -> None:
        self._network = network
        self.refresh()

    def _choose_link(self, tx: int, rx: int) -> None:
        if (tx, rx) == self._link:
            return
        self._link = (tx, rx)
        for end, number in zip(self._ends, self._link, strict=True):
            end.set_value(number)
        self.refresh()

    def _swap_link(self) -> None:
        self._choose_link(self._link[1], self._link[0])

    # What is new.

    def _beat(self) -> None:
        self._beats += 1
        self.refresh(charts=self._beats % CHARTS_EVERY == 0)

    def refresh(self, *, charts: bool = True) -> None:
        """Show what is known now: only what is in sight costs anything."""
        view, network, time_control = self._view, self._network, self._shown.time_control
        is_record = time_control is not None and time_control.can_seek
        self._time.set_text(time_words(view, is_record=is_record))
        self._status.set_text(status_words(view, is_record=is_record))
        self._timeline.refresh()
        self._refresh_said()
        if self._onboard is not None:
            self._onboard.refresh(self._scene)
        match self._tabs.value:
            case "Fleet":
                set_rows(self._fleet, fleet_rows(view, network, self._node))
                self._chosen.set_text(node_words(view, self._node))
                if self._controls is not None:
                    self._controls.refresh()
                if self._emitters is not None:
                    set_rows(self._emitters, emitter_rows(view))
            case "Link":
                self._words.set_text(
                    link_words(view, network, *self._link, self._shown.way(network, *self._link))
                )
            case "Losses":
                set_rows(self._causes, loss_rows(view.losses[network]))
                self._losses_words.set_text(losses_words(view.losses[network]))
            case "Air":
                set_rows(self._networks, air_rows(view))
                self._air_words.set_text(air_words(view))
                self._air.set_visibility(bool(view.air.networks))
            case "Agents":
                set_rows(self._agents, agent_rows(view))
            case "Logged":
                self._logged.refresh(self._look if charts else None)
        if charts:
            self._refresh_charts()

    def _refresh_charts(self) -> None:
        view, links, losses = self._view, self._view.links[self._network], self._view.losses[self._network]
        match self._tabs.value:
            case "Link":
                set_options(self._link_chart, link_chart(links.series(*self._link), self._look))
            case "Delivery":
                bins = links.by_distance()
                farthest_m = float(bins.distance_m.max()) + 40.0 if bins.distance_m.size else 100.0
                model = self._shown.model(self._network, farthest_m, losses.lengths)
                set_options(self._delivery, delivery_chart(bins, model, self._look))
            case "Losses":
                set_options(self._losses, losses_chart(*losses.over_time(), self._look))
            case "Air":
                networks = {name: view.air.series(name) for name in view.air.networks}
                set_options(self._air, air_chart(networks, self._look))
            case "Matrix":
                sent, delivered = links.latest("sent"), links.latest("delivered")
                share = delivered / np.where(sent > 0, sent, np.nan)
                set_options(self._matrix, matrix_chart([node.id for node in view.nodes], share, self._look))

    def _refresh_said(self) -> None:
        if self._view.times_forgotten != self._forgotten:
            self._said.clear()
            self._told, self._forgotten = 0, self._view.times_forgotten
        new = min(self._view.lines_told - self._told, len(self._view.lines))
        if not new:
            return
        self._told = self._view.lines_told
        with self._said:
            for line in list(self._view.lines)[-new:]:
                who = (
                    self._view.nodes[self._view.index[line.node]].title
                    if line.node in self._view.index
                    else "run"
                )
                with ui.element("li"):
                    ui.label(f"{line.sim_time_ns / 1e9:8.1f} s  {who}: {line.text}")
        for old in self._said.default_slot.children[:-LINES_SHOWN]:
            old.delete()


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")
