"""The map as an element of NiceGUI: `scene.js` and `marks/` draw it, from frames that the page fetches itself."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, Literal

from nicegui import events
from nicegui.element import Element

FRAMES_PATH = "/frames"
"""Where the frames come from (`lostlink.view.broadcast`)."""
LABEL = (
    "Map of the fleet. Arrow keys pan, plus and minus zoom, f shows everything, m is the map and t the 3-D view, "
    "page up and down tilt, home and end turn, n and p choose the next and previous node. "
    "The tables Fleet, Plan and Logged say the same in words."
)


class Scene(Element, component="scene.js", esm={"lostlink-marks": "marks", "lostlink-plan": "plan"}):
    """Map and 3-D view.

    Args:
        on_pick: called with the chosen node's place among the nodes; -1: none.

    Attributes:
        on_aimed: called with north and east, m in the fleet's frame, of a place that was chosen to go to.
        on_unaimed: called when no place is to be chosen any more.
    """

    def __init__(self, on_pick: Callable[[int], object]) -> None:
        super().__init__()
        self._props["label"] = LABEL
        self._props["url"] = FRAMES_PATH
        self.frames_per_s = 0
        """What the browser drew in the last second."""
        self.on_aimed: Callable[[float, float], Awaitable[object]] = _nowhere
        self.on_unaimed: Callable[[], object] = lambda: None

        def picked(event: events.GenericEventArguments) -> None:
            if isinstance(event.args, int):
                on_pick(event.args)

        def beat(event: events.GenericEventArguments) -> None:
            if isinstance(event.args, dict) and isinstance(event.args.get("drawn"), int):
                self.frames_per_s = event.args["drawn"]

        async def aimed(event: events.GenericEventArguments) -> None:
            match event.args:
                case {"north": int() | float() as north_m, "east": int() | float() as east_m}:
                    await self.on_aimed(float(north_m), float(east_m))

        self.on("pick", picked)
        self.on("aimed", aimed)
        self.on("unaimed", lambda: self.on_unaimed())
        self.on("beat", beat)

    def look(self, kind: Literal["map", "3d"]) -> None:
        """Look from above, or aslant."""
        self.run_method("look", kind)

    def zoom(self, factor: float) -> None:
        """Come closer by a factor."""
        self.run_method("zoom", factor)

    def fit(self) -> None:
        """Show everything."""
        self.run_method("fit", True)

    def show(
        self,
        what: Literal["trails", "links", "losses", "wind", "labels", "shapes", "plan"],
        value: bool | str,
    ) -> None:
        """Show something or not; of links: ``all``, ``selected`` or ``none``."""
        self.run_method("show", what, value)

    def select(self, number: int) -> None:
        """Mark a node; -1: none."""
        self.run_method("select", number)

    def plan(self, content: dict[str, Any]) -> None:
        """Draw what a UA has on board, in place of what was drawn (`lostlink.view.picture.plan`)."""
        self.run_method("plan", content)

    def aim(self, *, on: bool) -> None:
        """Have the next click choose a place to go to."""
        self.run_method("aim", on)


async def _nowhere(north_m: float, east_m: float) -> None:
    """Nobody goes."""
