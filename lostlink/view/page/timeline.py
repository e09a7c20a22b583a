"""Time on the page: how far the run is and, for who may, pause, step, speed and any instant of a record."""

from __future__ import annotations

import math

from nicegui import ui

from lostlink.view.page.tables import place_words
from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.sources.time_control import TimeControl

SPEEDS = {0.2: "0.2 x", 0.5: "0.5 x", 1.0: "1 x", 2.0: "2 x", 5.0: "5 x", 10.0: "10 x", math.inf: "max"}
STEP_S = 0.05
"""Of the slider's keys."""


class Timeline:
    """The bar below the map.

    Args:
        view: the picture.
        time_control: of time; None: it is only shown.
    """

    def __init__(self, view: FleetView, time_control: TimeControl | None) -> None:
        self._view, self._time_control = view, time_control
        self._is_followed = False
        self._speed = view.clock.speed
        with ui.element("div").classes("ll-tools").props('role="group" aria-label="Time"'):
            if time_control is not None:
                self._build_controls(time_control)
            self._place = self._build_place(time_control)
            self._words = ui.label().classes("ll-time")

    def _build_place(self, time_control: TimeControl | None) -> ui.element:
        """The browser's own elements: keys and screen readers know them."""
        longest_s = max(STEP_S, self._view.duration_s)
        if time_control is None or not time_control.can_seek:
            bar = ui.element("progress").props(f'max={longest_s} value=0 aria-label="Sim time in seconds"')
            return bar.classes("ll-place")
        slider = ui.element("input").classes("ll-place")
        slider.props(f'type=range min=0 max={longest_s} step={STEP_S} aria-label="Sim time in seconds"')
        slider.on("pointerdown", js_handler="(event) => { event.target.isHeld = true; }")
        for end in ("pointerup", "pointercancel"):
            slider.on(end, js_handler="(event) => { event.target.isHeld = false; }")
        slider.on(
            "change",
            lambda event: time_control.seek(float(event.args)),
            js_handler="(event) => emit(Number(event.target.value))",
        )
        return slider

    def _build_controls(self, time_control: TimeControl) -> None:
        def toggle() -> None:
            if self._view.clock.paused:
                time_control.resume()
            else:
                time_control.pause()

        self._toggle = ui.button("Pause", on_click=toggle).props("dense no-caps flat")
        step = ui.button("Step", on_click=time_control.step).props(
            'dense no-caps flat aria-label="One tick further"'
        )

        def choose(speed: float | None) -> None:
            if speed is not None and not self._is_followed:
                time_control.speed(speed)

        self._speeds = ui.select(SPEEDS, value=_offered(self._speed), on_change=lambda e: choose(e.value))
        self._speeds.props('dense options-dense borderless aria-label="Speed"')
        self._controls = (self._toggle, step, self._speeds)

    def _move(self, seconds: float) -> None:
        """Show a place, unless somebody holds the slider: as a property it would be put back with all that is shown."""
        if self._time_control is not None and self._time_control.can_seek:
            slider = f"getHtmlElement({self._place.id})"
            self._place.client.run_javascript(f"if (!{slider}.isHeld) {slider}.value = {seconds}")
        else:
            self._place.props["value"] = seconds
            self._place.update()

    def refresh(self) -> None:
        """Show how far it is."""
        seconds = self._view.sim_time_ns / 1e9
        self._move(round(seconds, 2))
        self._words.set_text(place_words(self._view))
        if self._time_control is not None:
            self._toggle.set_text("Go on" if self._view.clock.paused else "Pause")
            self._follow(self._view.clock.speed)
            for control in self._controls:
                control.set_enabled(self._time_control.can_seek or not self._view.is_over)

    def _follow(self, speed: float) -> None:
        """Show the speed that it has when somebody has changed it, on this page or elsewhere."""
        if speed != self._speed:
            self._speed, self._is_followed = speed, True
            self._speeds.set_value(_offered(speed))
            self._is_followed = False


def _offered(speed: float) -> float | None:
    return speed if speed in SPEEDS else None
