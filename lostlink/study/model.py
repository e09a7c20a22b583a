"""The file of a study: which runs, and what is measured of each."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from sys import float_info
from typing import Annotated, Any, Final, Literal

from pydantic import Field, ValidationError, field_validator

from bridge.scenario.document.written import Written, WrittenPlace, plain, written_at
from bridge.scenario.document.yaml_text import read_yaml
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.mistakes.explain import explained
from bridge.scenario.parts import Part, Slug
from bridge.scenario.resolve.definition import missing
from bridge.scenario.resolve.modules import CODE

RUNS_MAX = 100_000
RANGE: Final = frozenset(("from", "to", "count"))
LIKE_A_RANGE: Final = RANGE.union(
    ["first", "last", "start", "stop", "end", "begin", "step", "by", "num", "number"]
)
"""What no numbers are called by."""


class StudyError(ValueError):
    """A study that cannot be flown; the text names the file, the key and what is wrong."""


class Seeds(Part):
    """``count`` seeds in a row."""

    first: Annotated[int, Field(ge=0)] = 1
    count: Annotated[int, Field(ge=1, le=RUNS_MAX)]


class Function(Part):
    """A function in a Python file, or a module.

    Attributes:
        place: the file's absolute path, which ends in .py, or the module's name.
        name: the function's.
    """

    place: str
    name: str

    def __str__(self) -> str:
        return f"{self.place}:{self.name}"


class StudyFile(Part):
    """What a study's file says.

    Attributes:
        name: part of the directory's name.
        description: for people.
        scenario: of all runs: shipped names or files (as seen from the study's file), one or several.
        seeds: of each scenario with each setting.
        set: settings of all runs, by dotted key.
        cases: settings that go together, by label; each is flown. None: one, without a label.
        vary: per dotted key its values, as a list, or by label as a mapping, or numbers in a row as ``{from, to,
            count}``; each combination is flown.
        metrics: functions of a run (`lostlink.Run`) that give further columns, as FILE.py:NAME or module:NAME.
        figures: functions of the table (a pandas DataFrame) and a directory, which draw there at the end.
        keep: which runs' directories stay: of all, of those that failed, or of none.
    """

    schema_: Annotated[Literal[1], Field(alias="schema")]
    name: Slug
    description: str = ""
    scenario: tuple[str, ...]
    seeds: tuple[int, ...] = (1,)
    set: dict[str, Any] = Field(default_factory=dict)
    cases: dict[str, dict[str, Any]] = Field(default_factory=dict)
    vary: dict[str, dict[str, Any]] = Field(default_factory=dict)
    metrics: tuple[Function, ...] = ()
    figures: tuple[Function, ...] = ()
    keep: Literal["all", "failed", "none"] = "all"

    @field_validator("scenario", "metrics", "figures", mode="before")
    @classmethod
    def _one_or_several(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str | Mapping) else value

    @field_validator("scenario")
    @classmethod
    def _at_least_one(cls, scenario: tuple[str, ...]) -> tuple[str, ...]:
        if not scenario:
            raise ValueError("has to be at least one scenario")
        return scenario

    @field_validator("seeds", mode="before")
    @classmethod
    def _seeds(cls, value: Any) -> Any:
        if isinstance(value, Mapping):
            seeds = Seeds.model_validate(value)
            return tuple(range(seeds.first, seeds.first + seeds.count))
        return (value,) if isinstance(value, int) else value

    @field_validator("seeds")
    @classmethod
    def _each_once(cls, seeds: tuple[int, ...]) -> tuple[int, ...]:
        if not seeds or len(set(seeds)) < len(seeds):
            raise ValueError("has to be at least one seed, and each once")
        return seeds

    @field_validator("vary", mode="before")
    @classmethod
    def _labelled(cls, value: Any) -> Any:
        if value is None:
            return {}
        if not isinstance(value, Mapping):
            return value
        _refuse_seed(value)
        return {key: _by_label(key, _in_a_row(key, choices)) for key, choices in value.items()}

    @field_validator("set")
    @classmethod
    def _without_seed(cls, settings: dict[str, Any]) -> dict[str, Any]:
        _refuse_seed(settings)
        return settings

    @field_validator("cases")
    @classmethod
    def _each_without_seed(cls, cases: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        for settings in cases.values():
            _refuse_seed(settings)
        return cases

    @field_validator("vary")
    @classmethod
    def _with_values(cls, vary: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        for key, choices in vary.items():
            if not choices:
                raise ValueError(f"{key} has no values")
        return vary

    @field_validator("metrics", "figures")
    @classmethod
    def _there(cls, functions: tuple[Function, ...]) -> tuple[Function, ...]:
        for function in functions:
            if mistake := missing(function.place):
                raise ValueError(mistake)
        return functions


def read_study(path: Path) -> StudyFile:
    """The study of a YAML file; files that it names are seen from it.

    Raises:
        StudyError: it cannot be read, or something in it is not allowed; a line per mistake.
    """
    try:
        return _study_of(read_yaml(path.read_text(encoding="utf-8"), str(path), path.parent, "study"))
    except ScenarioError as error:
        raise StudyError(str(error)) from error
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: cannot be read: {error}") from error


def study_from(content: Mapping[str, Any]) -> StudyFile:
    """The study that a program has as the content of such a file.

    Files that it names are as seen from the working directory.

    Raises:
        StudyError: something in it is not allowed; a line per mistake.
    """
    return _study_of(written_at(dict(content), WrittenPlace("study", None, Path.cwd())))


def _study_of(root: Written) -> StudyFile:
    content = plain(root)
    for key in ("metrics", "figures"):
        if key in content:
            content[key] = _functions(root.place, key, content[key])
    try:
        return StudyFile.model_validate(content)
    except ValidationError as error:
        raise StudyError("\n".join(explained(root, error, StudyFile))) from error


def _refuse_seed(settings: Mapping[str, Any]) -> None:
    if "seed" in settings:
        raise ValueError("seed is given by seeds:, as seeds: [1, 2] or seeds: {first: 1, count: 30}")


def _in_a_row(key: str, choices: Any) -> Any:
    """The numbers of a range, evenly from one to another, whole if all are and both ends are; others as they are."""
    if not isinstance(choices, Mapping) or len(choices) < 2 or not choices.keys() <= LIKE_A_RANGE:
        return choices
    are_numbers = [type(each) in (int, float) and abs(each) <= float_info.max for each in choices.values()]
    if not any(are_numbers):
        return choices
    if choices.keys() != RANGE or not all(are_numbers) or choices["count"] not in range(2, RUNS_MAX + 1):
        raise ValueError(
            f"{key}: {', '.join(choices)} are not taken for labels; numbers in a row are a list, "
            "or {from: 0.5, to: 3.0, count: 6}, of a count of 2 or more"
        )
    ends, count = (choices["from"], choices["to"]), int(choices["count"])
    first, last = (Fraction(str(end)) for end in ends)  # as written: 0.3, not 0.1 + 0.2
    numbers = [first + (last - first) * k / (count - 1) for k in range(count)]
    are_whole = {type(end) for end in ends} == {int} and all(each.denominator == 1 for each in numbers)
    return [int(each) if are_whole else float(each) for each in numbers]


def _by_label(key: str, choices: Any) -> dict[str, Any]:
    """The values of a list by their texts; of a mapping as they are."""
    if isinstance(choices, Mapping):
        return dict(choices)
    if not isinstance(choices, list):
        raise ValueError(
            f"{key} has to be a list of values, {{from: 0.5, to: 3.0, count: 6}}, or values by label (got {choices!r})"
        )
    found: dict[str, Any] = {}
    for choice in choices:
        if str(choice) in found or any(_are_one_number(choice, each) for each in found.values()):
            raise ValueError(
                f"{key} has the value {choice} more than once; values that read alike need labels"
            )
        found[str(choice)] = choice
    return found


def _are_one_number(one: Any, other: Any) -> bool:
    return (
        all(isinstance(each, int | float) and not isinstance(each, bool) for each in (one, other))
        and one == other
    )


def _functions(study: WrittenPlace, key: str, value: Any) -> list[dict[str, Any]]:
    functions = []
    for text in [value] if isinstance(value, str) else value if isinstance(value, list) else [value]:
        place, _, name = text.rpartition(":") if isinstance(text, str) else ("", "", "")
        is_file = place.endswith(CODE)
        if not name.isidentifier() or not (is_file or all(map(str.isidentifier, place.split(".")))):
            raise StudyError(
                f"{study.source}: {key}: has to be FILE.py:FUNCTION or package.module:FUNCTION, one or a list of them "
                f"(got {text!r})"
            )
        functions.append({"place": str(study.folder.resolve() / place) if is_file else place, "name": name})
    return functions
