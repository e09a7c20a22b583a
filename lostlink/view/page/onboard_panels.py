"""The tabs *Messages* and *Plan*: what the autopilot of the chosen UA says and has on board; the map has the plan."""

from __future__ import annotations

import json
from typing import Final

from nicegui import ui

from bridge.bus.messages import CommandGoal
from lostlink.view.page.onboard_tables import (
    PLAN_COLUMNS,
    TEXT_COLUMNS,
    onboard_words,
    plan_rows,
    plan_words,
    text_rows,
)
from lostlink.view.page.parts import button, set_rows, table
from lostlink.view.page.scene import Scene
from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.picture.onboard import Onboard
from lostlink.view.picture.plan import PlanDrawing
from lostlink.view.sources.onboard import Onboards
from lostlink.view.sources.operator import Operator

KINDS: Final = ("mission", "fence", "rally")
_CHOOSE: Final = "choose a UA in the table Fleet or on the map"
_NONE: Final = "this node has no autopilot"
_SEVERITY: Final = """
<q-td :props="props" :class="'ll-' + props.value">{{ props.value }}</q-td>
"""


class OnboardPanels:
    """Both tabs, each made within its own, and the plan on the map.

    Args:
        view: the picture.
        onboards: knows what autopilots have on board.
        drawing: makes of it what the map draws.
        operator: who may ask autopilots for what they have; None: nobody.
    """

    def __init__(
        self, view: FleetView, onboards: Onboards, drawing: PlanDrawing, operator: Operator | None
    ) -> None:
        self._view, self._onboards, self._drawing, self._operator = view, onboards, drawing, operator
        self._node = -1
        self._drawn: object = None

    def build_messages(self) -> None:
        """What is in the tab *Messages*."""
        self._state = ui.label().classes("ll-words")
        self._texts = table("Messages of the autopilot", TEXT_COLUMNS, "id").props("wrap-cells")
        self._texts.add_slot("body-cell-severity", _SEVERITY)

    def build_plan(self) -> None:
        """What is in the tab *Plan*."""
        self._counts = ui.label().classes("ll-words")
        if self._operator is not None:
            hint = "Read mission, fence and rally points from the autopilot: recorded as inputs of the run"
            self._read = button("Read from the UA", self._ask, hint)
        self._plan = table("Mission, fence and rally points", PLAN_COLUMNS, "number").props("wrap-cells")

    def choose(self, number: int) -> None:
        """Show what a node has; -1: none."""
        self._node = number

    def refresh(self, scene: Scene) -> None:
        """Show what is known now."""
        node = self._view.nodes[self._node] if self._node >= 0 else None
        onboard = self._onboards.of(node.id) if node is not None and node.kind == "ua" else None
        state = self._view.news[node.id].state if node is not None else None
        is_guided = state is not None and state.mode == "GUIDED"
        drawn = (self._node, onboard, onboard and onboard.changes, is_guided)
        if self._operator is not None:
            self._read.set_enabled(onboard is not None and not self._view.is_over)
        if drawn == self._drawn:
            return
        scene.plan(self._drawing.content(onboard, is_guided=is_guided))
        self._drawn = drawn
        if onboard is None:
            why = (
                _CHOOSE if node is None else _NONE if node.kind == "ground" else f"{node.title}: not read yet"
            )
            self._say(why, why)
            set_rows(self._texts, [])
            set_rows(self._plan, [])
        else:
            self._show(self._view.nodes[self._node].title, onboard)

    def _show(self, title: str, onboard: Onboard) -> None:
        self._say(f"{title}: {onboard_words(onboard)}", f"{title}: {plan_words(onboard)}")
        set_rows(self._texts, text_rows(onboard))
        set_rows(self._plan, plan_rows(onboard))

    def _say(self, state: str, counts: str) -> None:
        self._state.set_text(state)
        self._counts.set_text(counts)

    def _ask(self) -> None:
        """One after the other: an autopilot transfers one list at a time."""
        assert self._operator is not None, "the button is for operators"
        operator, node = self._operator, self._view.nodes[self._node].id

        def ask(kinds: tuple[str, ...]) -> None:
            if kinds:
                goal = CommandGoal(arguments=json.dumps({"kind": kinds[0]}))
                operator.command(node, "mission_download", goal, lambda: ask(kinds[1:]))

        ask(KINDS)
