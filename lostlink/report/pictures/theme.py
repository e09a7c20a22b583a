"""Figures as SVG for a page: drawn in marks that become the page's own colours, so that light and dark both fit."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK: Final = "#010203"
FAINT: Final = "#040506"
SERIES: Final = tuple(f"#0a0b{i:02d}" for i in range(8))
GOOD: Final = "#0c0d01"
LOSSES: Final = tuple(f"#0c0d{i:02d}" for i in range(10, 18))
NAME_MAX: Final = 24
"""Characters of a name in a picture; the tables have all."""
WIDTH_IN: Final = 8.0
"""Of a picture."""
ENTRY_IN: Final = 0.6
CHARACTER_IN: Final = 0.08
"""Of a legend: what an entry takes beside its name, and a character on average."""
_VARIABLES: Final = {
    INK: "--ink",
    FAINT: "--faint",
    GOOD: "--good",
    **{mark: f"--series-{i}" for i, mark in enumerate(SERIES)},
    **{mark: f"--loss-{i}" for i, mark in enumerate(LOSSES)},
}
"""What stands for what; the style sheet of the page has the colours."""
_STYLE: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "lostlink",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 10.0,
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.alpha": 0.35,
    "grid.linewidth": 0.6,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.4,
    "path.simplify": True,
}


@contextmanager
def themed() -> Iterator[None]:
    """Draw in our marks; matplotlib's own settings are back afterwards."""
    import matplotlib as mpl
    from cycler import cycler

    with mpl.rc_context({**_STYLE, "axes.prop_cycle": cycler(color=list(SERIES))}):
        yield


def figure_of(width_in: float = WIDTH_IN, height_in: float = 3.6) -> tuple[Figure, Axes]:
    """An empty figure with axes, without pyplot, whose backend belongs to whoever calls us."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    return figure, figure.subplots()


def logarithmic(axes: Axes) -> None:
    """Make values logarithmic, with ticks at 1, 2 and 5, as plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def short(text: str, most: int = NAME_MAX) -> str:
    """A name, or several with spaces between them, each of at most so many characters, as text for a picture."""
    words = (
        each if len(each) <= most else f"{each[: most // 2]}\u2026{each[-(most // 2) + 1 :]}"
        for each in text.split(" ")
    )
    return " ".join(words).replace("$", r"\$")  # no formula


def legend_above(axes: Axes, columns_max: int = 5, name_max: int = NAME_MAX) -> None:
    """A legend above the axes, of as many columns as its longest name, made `short`, leaves room for."""
    handles, labels = axes.get_legend_handles_labels()
    names = [short(label, name_max) for label in labels]
    entry_in = ENTRY_IN + CHARACTER_IN * max(map(len, names), default=0)
    columns = max(1, min(columns_max, int(WIDTH_IN / entry_in)))
    axes.legend(handles, names, ncols=columns, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def svg_of(figure: Figure, name: str, told: str) -> str:
    """The figure as an ``<svg>`` to stand in a page; the same figure gives the same text.

    Args:
        figure: drawn within `themed`.
        name: of the picture, which its inner names begin with.
        told: what it shows, for those who do not see it.
    """
    buffer = io.StringIO()
    figure.savefig(
        buffer, format="svg", transparent=True, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
    )
    text = buffer.getvalue()
    text = text[text.index("<svg") :].strip()
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    view = re.search(r'viewBox="[^"]*"', text)
    assert view is not None, "matplotlib writes one"
    head = f'<svg class="picture" role="img" aria-label="{_attribute(told)}" {view.group()}>'
    text = head + text[text.index(">") + 1 :]
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = text.replace('href="#', f'href="#{name}-').replace("url(#", f"url(#{name}-")
    text = re.sub(r"font: ([\d. a-z]+px) [^;\"]*", r"font: \1 var(--sans)", text)
    for mark, variable in _VARIABLES.items():
        text = text.replace(mark, f"var({variable})")
    return text


def _attribute(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
