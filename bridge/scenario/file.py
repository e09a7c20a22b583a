"""Reads scenario files. Every mistake is reported with file, line and key, all of them at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bridge.scenario.document.extends import SCENARIOS, read_file, read_text, scenario_names, with_extended
from bridge.scenario.document.files import Find, with_absolute_files
from bridge.scenario.document.settings import Overrides, settings_of, with_settings
from bridge.scenario.document.written import Written, WrittenPlace, plain, written_at
from bridge.scenario.expand.groups import ids_of_groups, is_of_a_group, refuse_same_ids, with_groups_expanded
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.mistakes.explain import explained
from bridge.scenario.mistakes.names import with_known_names
from bridge.scenario.mistakes.texts import refuse_no_texts
from bridge.scenario.model import Scenario

__all__ = [
    "DEFAULT_SCENARIO",
    "SCENARIOS",
    "ScenarioError",
    "parse_scenario",
    "read_scenario",
    "scenario_from",
    "scenario_names",
    "with_changes",
]
DEFAULT_SCENARIO = "separation"


def read_scenario(name_or_path: str | Path, overrides: Overrides = (), find: Find = str) -> Scenario:
    """Read a shipped scenario by name, or any by path.

    Args:
        name_or_path: of the scenario.
        overrides: values by dotted key in place of the scenario's (``{"radio.noise.floor_dbm": -330}``), in this order.
        find: gives where a file that it names lies now.

    Raises:
        ScenarioError: if it cannot be found, is not YAML or does not validate.
    """
    with _files_readable(str(name_or_path)):
        return _scenario_of(read_file(str(name_or_path)), overrides, find)


def parse_scenario(text: str, source_name: str, folder: Path = Path(), overrides: Overrides = ()) -> Scenario:
    """Check the text of a scenario; ``source_name`` is what mistakes are reported under.

    Files that it names are as seen from ``folder``; the scenario has their absolute paths.

    Raises:
        ScenarioError: with one line per mistake.
    """
    with _files_readable(source_name):
        return _scenario_of(read_text(text, source_name, folder.absolute()), overrides)


def scenario_from(content: Mapping[str, Any] | Scenario, overrides: Overrides = ()) -> Scenario:
    """Check what a program has of a scenario: the content of a file, or one that was read already, or made.

    Files that it names are as seen from the working directory; the scenario has their absolute paths.

    Raises:
        ScenarioError: with one line per mistake.
    """
    root = (
        _written(content) if isinstance(content, Scenario) else written_at(dict(content), _here("scenario"))
    )
    with _files_readable(root.place.source):
        return _scenario_of(with_extended(root), overrides)


def with_changes(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """A scenario that is read already, with values by dotted key in place of its own. Names are not looked for.

    Raises:
        ScenarioError: if a value is not allowed.
    """
    root = with_settings(_written(scenario), settings_of(changes))
    refuse_no_texts(root)
    return _validated(root)


def _written(scenario: Scenario) -> Written:
    return written_at(scenario.model_dump(mode="json", by_alias=True), _here(scenario.name))


def _here(source: str) -> WrittenPlace:
    return WrittenPlace(source, None, Path.cwd())


@contextmanager
def _files_readable(source: str) -> Iterator[None]:
    """A file in a folder that is another user's, or whose name is longer than names can be, is a mistake, too."""
    try:
        yield
    except OSError as error:
        raise ScenarioError(f"{source}: cannot be read: {error}") from error


def _scenario_of(root: Written, overrides: Overrides, find: Find = str) -> Scenario:
    settings = settings_of(overrides)
    anew = max((number for number, each in enumerate(settings) if each.key == "nodes"), default=0)
    settings = [each for number, each in enumerate(settings) if number >= anew or not each.is_of_nodes]
    of_nodes = [each for each in settings if each.is_of_nodes and not is_of_a_group(each)]
    root = with_settings(root, [each for each in settings if each not in of_nodes])
    of_groups = ids_of_groups(root)
    root = with_settings(with_groups_expanded(root), of_nodes)
    refuse_no_texts(root)
    refuse_same_ids(root, of_groups)
    root = with_absolute_files(root, find)
    return with_known_names(root, _validated(root))


def _validated(root: Written) -> Scenario:
    try:
        return Scenario.model_validate(plain(root))
    except ValidationError as error:
        raise ScenarioError("\n".join(explained(root, error, Scenario))) from None
