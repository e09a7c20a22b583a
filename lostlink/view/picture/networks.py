"""Reports on all radio networks, taken apart: what is shown is of one of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import TypeVar

import numpy as np

from bridge.bus.messages import Fates, Links

Report = TypeVar("Report", Fates, Links)
OF_THE_WHOLE = frozenset({"header", "node", "cause", "network", "radio_off", "fate"})
"""Fields that are no column, and `fate`, which is a column of bytes."""


def by_network(report: Report) -> Iterator[tuple[str, Report]]:
    """The rows of each network, with its name; the report itself if there is only one."""
    if len(report.network) == 1:
        yield report.network[0], report
        return
    radio = np.asarray(report.radio)
    told = {f.name: np.asarray(getattr(report, f.name)) for f in fields(report) if f.name not in OF_THE_WHOLE}
    columns = {name: values for name, values in told.items() if values.size == radio.size}
    for place, name in enumerate(report.network):
        on = radio == place
        changes = {column: values[on] for column, values in columns.items()}
        if isinstance(report, Fates):
            changes["fate"] = np.frombuffer(report.fate, dtype=np.uint8)[on].tobytes()
        yield name, replace(report, **changes)
