"""What every study measures of a run; functions of the user's own add to it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import MAIN
from bridge.record.tables.schema import Columns
from lostlink.flight.exits import RunOutcome
from lostlink.reading.ages import link_ages, times_of
from lostlink.reading.links.counts import counts_of
from lostlink.reading.positions import places_of, separation_m
from lostlink.reading.rows import RecordedDeliveries
from lostlink.reading.run import Run
from lostlink.study.model import Function, StudyError
from sitl_configs.own_code import OwnCodeError, load_module

Metrics = dict[str, Any]
"""By column: a number, a text, a truth value, or a list of numbers."""


OF_THE_STUDY = ("scenario", "case", "seed", "id", "failure")
"""Columns that say which run a row is of, and why it failed."""


def of_summary(run: Run) -> Metrics:
    """What the summary says and the machine does not change; there of a run that failed, too.

    ``ending``, ``outcome``, ``verdict``, ``error``, ``passed`` (it came to its end, and neither model nor expectations
    disagree), ``digest``, ``sim_duration_s``; ``<expectation>: found`` and ``<expectation>: passed`` of each;
    of one name the second is ``<expectation> (2)``.
    """
    summary = run.summary
    return {
        "ending": summary["ending"],
        "error": summary["error"] or "",
        "outcome": summary["outcome"],
        "verdict": summary["verdict"],
        "passed": summary["outcome"] in (RunOutcome.PASS, RunOutcome.NONE),
        "digest": summary["digest"],
        "sim_duration_s": summary["sim_duration_s"],
        **{
            f"{name}: {part}": each[part]
            for name, each in _by_name(summary["expectations"])
            for part in ("found", "passed")
        },
    }


def _by_name(expectations: Iterable[Mapping[str, Any]]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    seen = Counter[str]()
    for each in expectations:
        name = each["name"]
        seen[name] += 1
        yield name if seen[name] == 1 else f"{name} ({seen[name]})", each


def of_tables(run: Run) -> Metrics:
    """What the tables say; the machine does not change it.

    ``sent``, ``delivered`` and ``delivery`` (their quotient) of all links, and ``delivery_<tx>_<rx>`` of each
    (`link_column`); ``age_mean_s``, the mean over the links of the time average of the age of information, and
    ``age_peak_s``, the greatest of any link (`Run.ages`); of several radio networks also ``<radio>: delivery`` and
    ``<radio>: age_mean_s`` of each; ``separation_min_m``, the least distance of two UA at any
    tick.

    Raises:
        TableError, OSError: a table is not there, or damaged.
    """
    deliveries = RecordedDeliveries(run.path, run.scenario.transceiver_ids, run.scenario.network_names)
    links, ages = counts_of(deliveries), link_ages(times_of(deliveries), run.end_ns)
    _, places = places_of(run.path, run.nodes)
    everywhere = np.full(len(links["sent"]), True)
    networks = deliveries.networks if len(deliveries.networks) > 1 else ()
    return {
        "sent": int(np.sum(links["sent"])),
        "delivered": int(np.sum(links["delivered"])),
        "delivery": _delivery(links, everywhere),
        **{
            link_column(tx, rx, radio): float(d / s) if s else float("nan")
            for radio, tx, rx, s, d in zip(
                *(links[name] for name in ("radio", "tx", "rx", "sent", "delivered")), strict=True
            )
        },
        **{f"{name}: delivery": _delivery(links, links["radio"] == name) for name in networks},
        "age_mean_s": _mean(ages["mean_s"]),
        **{f"{name}: age_mean_s": _mean(ages["mean_s"][links["radio"] == name]) for name in networks},
        "age_peak_s": float(np.nanmax(ages["peak_s"], initial=0.0)) if len(ages["peak_s"]) else float("nan"),
        "separation_min_m": separation_m(places[ua.node] for ua in run.scenario.ua)[0],
    }


def link_column(tx: str, rx: str, radio: str = MAIN) -> str:
    """The column of a link's delivery; of names with a ``_`` no other link has the same."""
    network = "" if radio == MAIN else radio
    if "_" in network + tx + rx:
        return f"delivery_{network}:{tx}->{rx}" if network else f"delivery_{tx}->{rx}"
    return "_".join(["delivery", *filter(None, [network]), tx, rx])


def _delivery(links: Columns, wanted: NDArray[np.bool_]) -> float:
    sent, delivered = (int(np.sum(links[name][wanted])) for name in ("sent", "delivered"))
    return delivered / sent if sent else float("nan")


def _mean(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def own(run: Run, functions: tuple[Function, ...], taken: Container[str] = OF_THE_STUDY) -> Metrics:
    """What functions of the user's own say of a run.

    Args:
        run: the run.
        functions: each gives columns by name.
        taken: names of columns that there are already, beside those of the study.

    Raises:
        StudyError: one gives what no table can hold, or a column that there is, or raises.
    """
    found: Metrics = {}
    for function in functions:
        try:
            result = load(function)(run)
        except StudyError:
            raise
        except (
            Exception,
            SystemExit,
        ) as error:  # somebody's own code: whatever it raises is told with its place
            raise StudyError(f"{function}: {type(error).__name__}: {error}") from error
        if not isinstance(result, Mapping):
            raise StudyError(f"{function}: has to give a mapping of columns (got {type(result).__name__})")
        for name in result:
            if name in OF_THE_STUDY or name in taken:
                raise StudyError(f"{function}: {name}: is a column of the study's own: give it another name")
            if name in found:
                raise StudyError(f"{function}: {name}: is a column of another function: give it another name")
        found |= {str(name): _plain(value, f"{function}: {name}") for name, value in result.items()}
    return found


def load(function: Function) -> Callable[..., Any]:
    """The function itself; its file may import what that of an agent may.

    Raises:
        StudyError: it is not there, or the file raises as it is loaded.
    """
    try:
        module = load_module(function.place)
    except OwnCodeError as error:
        raise StudyError(str(error)) from error
    found = getattr(module, function.name, None)
    if not callable(found):
        raise StudyError(f"{function}: there is no such function")
    return found  # type: ignore[no-any-return]


def _plain(value: Any, told: str) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple) and all(isinstance(part, int | float) for part in value):
        return [float(part) for part in value]
    raise StudyError(
        f"{told}: has to be a number, text, truth value or list of numbers (got {type(value).__name__})"
    )
