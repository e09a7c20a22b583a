"""The tab *Logged*: what a node's agent logged last, and a number of it over sim time beside that of other nodes."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from lostlink.view.page.charts import Look
from lostlink.view.page.logged_chart import drawn_words, logged_chart
from lostlink.view.page.parts import chart, set_options, set_rows, table
from lostlink.view.page.tables import LOGGED_COLUMNS, logged_rows
from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.picture.logged import Series


class LoggedPanel:
    """Made within the tab.

    Args:
        view: the picture.
        changed: called when a viewer chose something else to be shown.
    """

    def __init__(self, view: FleetView, changed: Callable[[], object]) -> None:
        self._view, self._changed = view, changed
        self._wanted: str | None = None
        """What a viewer has chosen to be charted, also while it is not there: a record may be moved back."""
        names = {number: node.title for number, node in enumerate(view.nodes)}
        with ui.element("div").classes("ll-tools"):
            self._node = ui.select(names, value=0, label="node", on_change=lambda _: changed())
            self._node.props("dense options-dense").style("min-width:90px")
            self._label = ui.select([], label="chart of", on_change=lambda e: self._choose_label(e.value))
            self._label.props("dense options-dense").style("min-width:200px")
        self._table = table("Logged values", LOGGED_COLUMNS, "name").props("wrap-cells")
        self._words = ui.label().classes("ll-words")
        self._chart = chart("Logged number over sim time")
        self._drawn = ui.label().classes("ll-words")

    def choose(self, number: int) -> None:
        """Show what a node logged."""
        self._node.set_value(number)

    def _choose_label(self, label: str | None) -> None:
        self._wanted = label
        self._changed()

    def _follow_labels(self, labels: list[str]) -> None:
        wanted = self._wanted
        self._label.set_options(labels, value=wanted if wanted in labels else next(iter(labels), None))
        self._wanted = wanted

    def refresh(self, look: Look | None) -> None:
        """Show what is known now; the chart if there is a ``look`` for it."""
        node = self._view.nodes[self._node.value].id
        set_rows(self._table, logged_rows(self._view, node))
        more = self._view.logged.passed_over[node]
        self._words.set_text(f"{more} values under further names are not shown" if more else "")
        labels = list(self._view.logged.series[node])
        if labels != self._label.options:
            self._follow_labels(labels)
        lines = self._lines()
        self._drawn.set_text(drawn_words(len(lines)))
        if look is not None:
            set_options(self._chart, logged_chart(self._label.value or "", lines, look))

    def _lines(self) -> list[tuple[int, str, Series]]:
        """What all nodes logged under the label; the chosen node comes first."""
        found = [
            (place, node.title, series)
            for place, node in enumerate(self._view.nodes)
            if (series := self._view.logged.series[node.id].get(self._label.value)) is not None
        ]
        return sorted(found, key=lambda line: line[0] != self._node.value)
