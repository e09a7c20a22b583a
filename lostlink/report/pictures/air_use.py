"""The air over time: load and use, waits and delays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lostlink.report.pictures.theme import FAINT, SERIES, figure_of, legend_above, logarithmic, svg_of, themed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOG_FROM = 3.0
"""Of shares above this the axis is logarithmic."""


def draw_air_use(air: dict[str, Any], key: str) -> str:
    """Load and use of the air as shares of its time."""
    series = air["series"]
    what = "offered over what it carries" if air["takes_time"] else "offered over the radio’s bit rate"
    lines = [(what, series["offered_share"], SERIES[1])]
    if series["use_share"] is not None:
        lines.append(("in use", series["use_share"], SERIES[0]))
    with themed():
        figure, axes = figure_of()
        axes.axhline(1.0, color=FAINT, lw=1, ls="--", zorder=1)
        for name, shares, color in lines:
            _step(axes, air, shares, color, name)
        axes.set(xlabel="sim time, s", ylabel="share of the time", xlim=(0, air["end_s"]))
        if max((share for _, shares, _ in lines for share in shares), default=0.0) > LOG_FROM:
            logarithmic(axes)
        else:
            axes.set_ylim(bottom=0)
        legend_above(axes, 4)
        return svg_of(
            figure, f"air-use{key}", f"Shares of the time over sim time: {', '.join(n for n, _, _ in lines)}."
        )


def draw_air_delay(air: dict[str, Any], key: str) -> str:
    """Waits and delays: medians, and what 95 % do not exceed."""
    with themed():
        figure, axes = figure_of()
        for name, key, color in (("delay", "delay", SERIES[0]), ("wait", "wait", SERIES[1])):
            for told, of, style in (("median", "p50", "-"), ("95 %", "p95", ":")):
                values = [np.nan if v is None else v for v in air["series"][f"{key}_{of}_s"]]
                _step(axes, air, values, color, f"{name}, {told}", style)
        axes.set(xlabel="sim time, s", ylabel="time, s", xlim=(0, air["end_s"]))
        logarithmic(axes)
        legend_above(axes, 4)
        return svg_of(
            figure, f"air-delay{key}", "Waits and delays of packets over sim time: medians and 95 %."
        )


def _step(axes: Axes, air: dict[str, Any], values: Any, color: str, name: str, style: str = "-") -> None:
    """A line that stands for each period, to its end."""
    axes.step(
        [*air["sim_time_s"], air["end_s"]],
        [*values, values[-1]],
        where="post",
        color=color,
        ls=style,
        label=name,
    )
