"""The runs of a study: every scenario with every case, every combination of what varies and every seed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from bridge.scenario.document.settings import ALL_NODES, Setting
from bridge.scenario.file import read_scenario
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.model import MAX, Scenario
from lostlink.study.made_of import Looker, MadeOf
from lostlink.study.model import RUNS_MAX, StudyError, StudyFile

UNASKED = {"speed": MAX, "figure": False}
"""What runs of a study have unless the study says otherwise: as many as fit fly at a time, and nobody looks on."""
UNKEPT = {"mcap.write": False, "mavlink.tlog": False}
"""The same where directories of runs do not stay."""

Labels = dict[str, str | float]


@dataclass(frozen=True, slots=True)
class Case:
    """One run of a study.

    Attributes:
        labels: what it is in the table: ``scenario`` (its name), ``case``, the keys that vary, ``seed``.
        scenario: as resolved.
        made_of: what it is made of besides.
    """

    labels: Labels
    scenario: Scenario
    made_of: MadeOf

    @property
    def id(self) -> str:
        """Of its directory: the same whatever else the study has."""
        return self.made_of.id

    @property
    def title(self) -> str:
        """Its labels, for people."""
        return _told(self.labels)


def cases_of(study: StudyFile, folder: Path) -> list[Case]:
    """All runs of a study, in the order of its file; seeds vary fastest.

    Args:
        study: the study.
        folder: what files that it names are seen from: its file's.

    Raises:
        StudyError: a scenario cannot be used, two have the same name, two runs are the same, or there are too many.
    """
    cases: dict[str, Case] = {}
    files: dict[str | float, str] = {}
    for place, case in _cases(study, folder):
        name = case.labels["scenario"]
        if files.setdefault(name, place) != place:
            raise StudyError(
                f"scenario: {files[name]} and {place} are both called {name}: give one another name"
            )
        if case.id in cases:
            raise StudyError(f"{cases[case.id].title} and {case.title} are the same run: {case.id}")
        cases[case.id] = case
        if len(cases) > RUNS_MAX:
            raise StudyError(f"more than {RUNS_MAX} runs")
    return list(cases.values())


def _cases(study: StudyFile, folder: Path) -> Iterator[tuple[str, Case]]:
    looker = Looker()
    together: Mapping[str, Mapping[str, Any]] = study.cases or {"": {}}
    vary = {key: _labelled(choices) for key, choices in study.vary.items()}
    for place, (label, changes) in product(study.scenario, together.items()):
        for choice in product(*vary.values()):
            varied = dict(zip(vary, choice, strict=True))
            chosen = {key: value for key, (_, value) in varied.items()}
            values = laid_over(UNASKED, UNKEPT if study.keep != "all" else {}, study.set, changes, chosen)
            for seed in study.seeds:
                labels: Labels = {"case": label} if study.cases else {}
                labels |= {key: text for key, (text, _) in varied.items()} | {"seed": seed}
                at = _scenario_at(place, folder)
                yield place, _case(at, labels, {**values, "seed": seed}, folder, looker)


def laid_over(*layers: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by dotted key, each layer over those before it, in an order in which a whole erases none of its parts.

    ``radio: wifi-2.4`` leaves ``radio.base_loss: 0.4`` of an earlier layer, as it says nothing of that; with
    ``radio: {preset: wifi-2.4, base_loss: 0.1}`` the later one holds.
    """
    laid: dict[str, Any] = {}
    for layer in layers:
        laid = {key: value for key, value in laid.items() if not _is_said_in(key, layer)} | dict(layer)
    return dict(sorted(laid.items(), key=lambda item: item[0].count(".")))


def _is_said_in(key: str, layer: Mapping[str, Any]) -> bool:
    """Whether a layer has the key, of one node or of all, or has it in the mapping that it gives one above it."""
    return any(_says(above.split("."), value, key.split(".")) for above, value in layer.items())


def _says(above: Sequence[str], value: object, steps: Sequence[str]) -> bool:
    return (
        len(above) <= len(steps)
        and all(ours in (step, ALL_NODES) for ours, step in zip(above, steps, strict=False))
        and _has(value, steps[len(above) :])
    )


def _has(value: object, steps: Sequence[str]) -> bool:
    for step in steps:
        if not isinstance(value, Mapping) or step not in value:
            return False
        value = value[step]
    return True


def _labelled(choices: Mapping[str, Any]) -> list[tuple[str | float, Any]]:
    """The label of each value: of numbers that nobody gave labels, or truth values, these themselves."""
    for kinds in ({bool}, {int, float}):
        if all(type(value) in kinds and str(value) == text for text, value in choices.items()):
            return [(value, value) for value in choices.values()]
    return list(choices.items())


def _case(place: str, labels: Labels, values: dict[str, Any], folder: Path, looker: Looker) -> Case:
    told = _told({"scenario": Path(place).stem, **labels})
    settings = [Setting(key, value, told, folder) for key, value in values.items()]
    try:
        scenario = read_scenario(place, settings)
    except ScenarioError as error:
        raise StudyError(str(error)) from error
    return Case({"scenario": scenario.name, **labels}, scenario, looker.made_of(scenario))


def _scenario_at(place: str, folder: Path) -> str:
    beside = folder / place
    return str(beside) if beside.is_file() else place


def _told(labels: Mapping[str, str | float]) -> str:
    return ", ".join(f"{key} {value}" for key, value in labels.items())
