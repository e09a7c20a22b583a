"""The runs of a study: every scenario with every case, every combination of what varies and every seed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import product
from operator import getitem
from pathlib import Path
from typing import Any

from bridge.scenario.document.settings import Setting
from bridge.scenario.file import read_scenario
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.model import MAX, Scenario
from lostlink.study.model import RUNS_MAX, StudyError, StudyFile
from lostlink.study.sources import sources_of

NOT_OF_THE_RESULT = ("ports", "processes", "zenoh", "hosts", "speed", "figure", "mcap", "mavlink.tlog")
"""Keys of a scenario that change no result."""
UNASKED = {"speed": MAX, "figure": False}
"""What runs of a study have unless the study says otherwise: as many as fit fly at a time, and nobody looks on."""
UNKEPT = {"mcap.write": False, "mavlink.tlog": False}
"""The same where directories of runs do not stay."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run of a study.

    Attributes:
        id: of its directory: the same for the same scenario, seed and code of agents, whatever else the study has.
        labels: what it is in the table: ``scenario``, ``case``, the keys that vary, ``seed``.
        scenario: as resolved.
    """

    id: str
    labels: dict[str, str | int]
    scenario: Scenario


def cases_of(study: StudyFile, folder: Path) -> list[Case]:
    """All runs of a study, in the order of its file; seeds vary fastest.

    Args:
        study: the study.
        folder: what files that it names are seen from: its file's.

    Raises:
        StudyError: a scenario cannot be used, there are two runs that are the same, or too many.
    """
    cases: dict[str, Case] = {}
    for case in _cases(study, folder):
        if case.id in cases:
            raise StudyError(
                f"{_told(cases[case.id].labels)} and {_told(case.labels)} are the same run: {case.id}"
            )
        cases[case.id] = case
        if len(cases) > RUNS_MAX:
            raise StudyError(f"more than {RUNS_MAX} runs")
    return list(cases.values())


def _cases(study: StudyFile, folder: Path) -> Iterator[Case]:
    together: Mapping[str, Mapping[str, Any]] = study.cases or {"": {}}
    for place, (label, changes) in product(study.scenario, together.items()):
        for choice in product(*(choices.items() for choices in study.vary.values())):
            varied = dict(zip(study.vary, choice, strict=True))
            values = {
                **UNASKED,
                **(UNKEPT if study.keep != "all" else {}),
                **study.set,
                **changes,
                **{key: value for key, (_, value) in varied.items()},
            }
            for seed in study.seeds:
                labels: dict[str, str | int] = {"scenario": Path(place).stem}
                labels |= {"case": label} if study.cases else {}
                labels |= {key: text for key, (text, _) in varied.items()} | {"seed": seed}
                yield _case(_scenario_at(place, folder), labels, {**values, "seed": seed}, folder)


def _case(place: str, labels: dict[str, str | int], values: dict[str, Any], folder: Path) -> Case:
    settings = [Setting(key, value, _told(labels), folder) for key, value in values.items()]
    try:
        scenario = read_scenario(place, settings)
    except ScenarioError as error:
        raise StudyError(str(error)) from error
    return Case(_id(scenario), labels, scenario)


def _scenario_at(place: str, folder: Path) -> str:
    beside = folder / place
    return str(beside) if beside.is_file() else place


def _id(scenario: Scenario) -> str:
    content = scenario.model_dump(mode="json", by_alias=True)
    for key in NOT_OF_THE_RESULT:
        *parents, name = key.split(".")
        del reduce(getitem, parents, content)[name]
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode())
    named = {Path(text) for text in _texts(content) if text.endswith((".py", ".yaml", ".yml", ".csv"))}
    files = {each for file in named if file.is_file() for each in _with_imports(file)}
    for file in sorted(files):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _with_imports(file: Path) -> list[Path]:
    return sources_of(file) if file.suffix == ".py" else [file]


def _texts(value: Any) -> Iterator[str]:
    """All texts of a scenario; of a class in a file, the file."""
    if isinstance(value, str):
        yield value.rpartition(":")[0] if ".py:" in value else value
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _texts(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _texts(part)


def _told(labels: Mapping[str, str | int]) -> str:
    return ", ".join(f"{key} {value}" for key, value in labels.items())
