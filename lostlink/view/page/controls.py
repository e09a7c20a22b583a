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
        nodes = {n: node.title for n, node in enumerate(view.nodes) if node.takes_commands}
        with ui.element("div").classes("ll-tools").props('role="group" aria-label="Commands"'):
            self._node = ui.select(nodes, label="command", on_change=lambda e: choose(e.value)).props(
                "dense options-dense"
            )
            self._node.style("min-width:90px")
            ui.button("RTL", on_click=self._rtl).props('dense no-caps aria-label="Return to launch"')
            self._mode = ui.select(list(MODES), label="mode", with_input=True, new_value_mode="add").props(
                "dense options-dense"
            )
            self._mode.style("width:130px")
            ui.button("Set mode", on_click=self._set_mode).props("dense no-caps")
            self._radio = ui.button(RADIO_OFF, on_click=self._switch_radio).props("dense no-caps")

    def refresh(self) -> None:
        """Offer what can be done now."""
        self._radio.set_text(RADIO_ON if self._node.value in self._view.radios_off else RADIO_OFF)

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
        ui.label("It takes effect at the next tick and is recorded as an input of the run.").classes(
            "ll-words"
        )
        with ui.row():
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("no-caps flat autofocus")
            ui.button("Do it", on_click=lambda: dialog.submit(True)).props("no-caps")
    confirmed = bool(await dialog)
    dialog.delete()
    return confirmed
