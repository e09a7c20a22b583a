"""Commands to aircraft and radios, there with `--control` only, and each asked about before it is given."""

from __future__ import annotations

import math
from collections.abc import Callable

from nicegui import ui

from bridge.agents.frames import Frames
from bridge.bus.messages import CommandGoal
from bridge.bus.radio_command import RADIO, radio_goal
from lostlink.view.page.scene import Scene
from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.sources.operator import Operator

MODES = ("GUIDED", "LOITER", "RTL", "LAND", "AUTO", "ALT_HOLD", "STABILIZE", "CIRCLE", "FBWA", "MANUAL")
"""What is offered; any other name can be typed."""
RADIO_OFF, RADIO_ON = "Radio off", "Radio on"
TAKE_OFF_M = 20.0
EFFECT = "It takes effect at the next tick and is recorded as an input of the run"
WARNING = (
    f"{EFFECT}, and interrupts what the node's agent does: those that ship yield, your own may end the run."
)
OF_RADIO = f"{EFFECT}. The node's agent goes on and is not told."
AIM = "click a place on the map, or pan its middle there and press Enter; Escape leaves it"


class ViewControls:
    """Buttons for the node that is chosen.

    Args:
        view: the picture.
        operator: who commands.
        chosen: says which node is chosen; -1: none.
        choose: chooses one.
        scene: the map, on which a place to go to is chosen.
        frames: of the fleet.
    """

    def __init__(
        self,
        view: FleetView,
        operator: Operator,
        chosen: Callable[[], int],
        choose: Callable[[int], None],
        scene: Scene,
        frames: Frames,
    ) -> None:
        self._view, self._operator, self._chosen = view, operator, chosen
        self._scene, self._frames = scene, frames
        scene.on_aimed, scene.on_unaimed = self._go_to, self._unaim
        self._nodes = {n: node.title for n, node in enumerate(view.nodes) if node.takes_commands}
        with ui.element("div").classes("ll-tools").props('role="group" aria-label="Commands"'):
            self._node = ui.select(
                self._nodes, label="command", on_change=lambda e: self._offered(e.value, choose)
            )
            self._node.props("dense options-dense").style("min-width:120px")
            arm = ui.button("Arm", on_click=self._arm).props("dense no-caps")
            take_off = ui.button("Take off", on_click=self._take_off).props("dense no-caps")
            self._height = ui.number("m above home", value=TAKE_OFF_M, min=1.0).props("dense")
            self._height.style("width:100px")
            self._go = ui.button("Go here", on_click=self._aim).props("dense no-caps aria-pressed=false")
            rtl = ui.button("RTL", on_click=self._rtl).props('dense no-caps aria-label="Return to launch"')
            self._mode = ui.select(list(MODES), label="mode", with_input=True, new_value_mode="add").props(
                "dense options-dense"
            )
            self._mode.style("width:130px")
            mode = ui.button("Set mode", on_click=self._set_mode).props("dense no-caps")
            self._radio = ui.button(RADIO_OFF, on_click=self._switch_radio).props("dense no-caps")
        self._buttons = (arm, take_off, self._go, rtl, mode, self._radio)

    def _offered(self, number: int | None, choose: Callable[[int], None]) -> None:
        if number is not None and number != self._chosen():
            choose(number)

    def refresh(self) -> None:
        """Offer what can be done now, to the node that is chosen in the table or on the map."""
        chosen = self._chosen()
        self._node.set_value(chosen if chosen in self._nodes else None)
        for button in self._buttons:
            button.set_enabled(not self._view.is_over)
        self._radio.set_text(RADIO_ON if self._node.value in self._view.radios_off else RADIO_OFF)

    async def _arm(self) -> None:
        await self._ask("arm", "Arm", CommandGoal())

    async def _take_off(self) -> None:
        height_m = float(self._height.value or TAKE_OFF_M)
        await self._ask("takeoff", f"Take off to {height_m:g} m", CommandGoal(altitude_rel_m=height_m))

    def _aim(self) -> None:
        if self._height_m() is None:
            ui.notify("choose a UA that knows its height first")
            return
        self._go.props("aria-pressed=true")
        self._scene.aim(on=True)
        ui.notify(AIM)

    def _unaim(self) -> None:
        self._go.props("aria-pressed=false")

    def _height_m(self) -> float | None:
        """Of the chosen UA above home, as its autopilot says; None if it does not."""
        node = self._view.nodes[self._node.value] if self._node.value is not None else None
        state = self._view.news[node.id].state if node is not None and node.kind == "ua" else None
        return state.altitude_rel_m if state is not None and math.isfinite(state.altitude_rel_m) else None

    async def _go_to(self, north_m: float, east_m: float) -> None:
        """To a place of the map, at the height that the UA has now."""
        height_m = self._height_m()
        if height_m is None:
            return
        place = self._frames.earth_from_fleet((north_m, east_m, 0.0))
        goal = CommandGoal(
            latitude_deg=place.lat_deg, longitude_deg=place.lon_deg, altitude_rel_m=round(height_m, 1)
        )
        where = f"{north_m:.1f} m north and {east_m:.1f} m east, {height_m:.1f} m above home"
        await self._ask("goto", f"Go to {where}", goal)

    async def _rtl(self) -> None:
        await self._ask("rtl", "Return to launch", CommandGoal())

    async def _set_mode(self) -> None:
        if not self._mode.value:
            ui.notify("choose a mode first")
            return
        await self._ask("mode", f"Mode {self._mode.value}", CommandGoal(mode=str(self._mode.value)))

    async def _switch_radio(self) -> None:
        on = self._node.value in self._view.radios_off
        await self._ask(RADIO, RADIO_ON if on else RADIO_OFF, radio_goal(on=on))

    async def _ask(self, verb: str, what: str, goal: CommandGoal) -> None:
        if self._node.value is None:
            ui.notify("choose a node first")
            return
        node = self._view.nodes[self._node.value]
        agent = self._view.news[node.id].agent
        control = f"Its agent: {agent.activity}." if agent is not None and agent.activity else ""
        effect = OF_RADIO if verb == RADIO else WARNING
        if await _is_confirmed(f"{what} for {node.title}?", f"{control} {effect}".strip()):
            self._operator.command(node.id, verb, goal)


async def _is_confirmed(question: str, words: str) -> bool:
    with ui.dialog().props('aria-label="Confirm"') as dialog, ui.card():
        ui.label(question)
        ui.label(words).classes("ll-words")
        with ui.row():
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("no-caps flat autofocus")
            ui.button("Do it", on_click=lambda: dialog.submit(True)).props("no-caps")
    confirmed = bool(await dialog)
    dialog.delete()
    return confirmed
