"""What the page is made of: buttons, tables and charts with names for screen readers."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from lostlink.view.page.tables import Rows


def button(text: str, on_click: Callable[[], object], label: str) -> ui.button:
    """A flat button; ``label`` is its name for screen readers, and its hint."""
    return ui.button(text, on_click=on_click).props(
        f'dense flat no-caps aria-label="{label}" title="{label}"'
    )


def table(title: str, columns: Rows, key: str) -> ui.table:
    """An empty table; ``key`` is the field by which its rows are distinguished."""
    with ui.element("section").props(f'aria-label="{title}"'):
        made = ui.table(columns=columns, rows=[], row_key=key)
    return made.props('dense flat hide-bottom :rows-per-page-options="[0]"')


def chart(label: str) -> ui.echart:
    """An empty chart; ``label`` is its name for screen readers."""
    return ui.echart({}).classes("ll-chart").props(f'role="img" aria-label="{label}"')


def set_rows(table: ui.table, rows: Rows) -> None:
    """Show rows, if they are others."""
    if table.rows != rows:
        table.rows = rows
        table.update()


def set_options(chart: ui.echart, options: dict[str, object]) -> None:
    """Draw a chart anew."""
    chart.options.clear()
    chart.options.update(options)
    chart.update()
