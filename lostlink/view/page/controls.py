"""Commands to aircraft and radios, there with `--control` only, and each asked about before it is given."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from bridge.bus.messages import CommandGoal
from bridge.bus.radio_command import RADIO, radio_goal
from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.sources.operator import Operator

MODES = ("GUIDED", "LOITER", "RTL", "LAND", "AUTO", "ALT_HOLD", "STABILIZE", "CIRCLE", "FBWA", "MANUAL")
"""What is offered; any other name can be typed."""
RADIO_OFF, RADIO_ON = "Radio off", "Radio on"
TAKE_OFF_M = 20.0
WARNING = (
    "It takes effect at the next tick, is recorded as an input of the run, and interrupts what the node's agent does: "
    "those that ship yield, one of your own may end the run."
)


class ViewControls:
    """Buttons for the node that is chosen.

    Args:
        view: the picture.
        operator: who commands.
        chosen: says which node is chosen; -1: none.
        choose: chooses one.
    """

    def __init__(
        self,
        view: FleetView,
        operator: Operator,
        chosen: Callable[[], int],
        choose: Callable[[int], None],
    ) -> None:
        self._view, self._operator, self._chosen = view, operator, chosen
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
            rtl = ui.button("RTL", on_click=self._rtl).props('dense no-caps aria-label="Return to launch"')
            self._mode = ui.select(list(MODES), label="mode", with_input=True, new_value_mode="add").props(
                "dense options-dense"
            )
            self._mode.style("width:130px")
            mode = ui.button("Set mode", on_click=self._set_mode).props("dense no-caps")
            self._radio = ui.button(RADIO_OFF, on_click=self._switch_radio).props("dense no-caps")
        self._buttons = (arm, take_off, rtl, mode, self._radio)

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
        if await _is_confirmed(f"{what} for {node.title}?"):
            self._operator.command(node.id, verb, goal)


async def _is_confirmed(question: str) -> bool:
    with ui.dialog().props('aria-label="Confirm"') as dialog, ui.card():
        ui.label(question)
        ui.label(WARNING).classes("ll-words")
        with ui.row():
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("no-caps flat autofocus")
            ui.button("Do it", on_click=lambda: dialog.submit(True)).props("no-caps")
    confirmed = bool(await dialog)
    dialog.delete()
    return confirmed
