"""YAML text to values with their lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from bridge.scenario.document.written import Written, WrittenPlace
from bridge.scenario.mistakes.error import ScenarioError
from sitl_configs.yaml_text import NO_VALUE, VALUES_MAX

MAPPING, SEQUENCE = "tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"


def read_yaml(text: str, source: str, folder: Path, kind: str = "scenario") -> Written:
    """The mapping that a text is.

    Args:
        text: YAML.
        source: what mistakes are reported under.
        folder: what files that it names are seen from.
        kind: what it is, for mistakes.

    Raises:
        ScenarioError: it is not YAML, not a mapping, or has a key twice.
    """
    try:
        loader = yaml.SafeLoader(text)
        try:
            root = loader.get_single_node()
            if not isinstance(root, yaml.MappingNode):
                raise ScenarioError(f"{source}:1: a {kind} is a mapping of keys to values")
            _refuse_duplicate_keys(source, root, set())
            return _Reader(loader, source, folder).read(root, WrittenPlace(source, 1, folder))
        finally:
            loader.dispose()
    except yaml.YAMLError as error:
        raise ScenarioError(_yaml_mistake(source, error)) from error
    except NO_VALUE as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError(f"{source}: not valid YAML: {error}") from error
    except RecursionError as error:
        raise ScenarioError(f"{source}: nested too deeply") from error


class _Reader:
    """Makes values of nodes."""

    def __init__(self, loader: yaml.SafeLoader, source: str, folder: Path) -> None:
        self._loader, self._source, self._folder = loader, source, folder
        self._count = 0

    def read(self, node: yaml.Node, place: WrittenPlace) -> Written:
        self._count += 1
        if self._count > VALUES_MAX:
            raise ScenarioError(f"{self._source}: has more than {VALUES_MAX} values")
        if isinstance(node, yaml.MappingNode) and node.tag == MAPPING:
            self._loader.flatten_mapping(node)
            parts = {key.value: self.read(value, self._place(key)) for key, value in node.value}
            return Written(parts, place, self._place_before(node.end_mark))
        if isinstance(node, yaml.SequenceNode) and node.tag == SEQUENCE:
            return Written([self.read(item, self._place(item)) for item in node.value], place)
        return Written(self._loader.construct_object(node, deep=True), place)

    def _place(self, node: yaml.Node) -> WrittenPlace:
        return WrittenPlace(self._source, node.start_mark.line + 1, self._folder)

    def _place_before(self, mark: Any) -> WrittenPlace:
        """A block ends where the next thing begins: its last line is before that."""
        return WrittenPlace(self._source, max(1, mark.line + (1 if mark.column else 0)), self._folder)


def _refuse_duplicate_keys(source: str, node: yaml.Node, done: set[int]) -> None:
    if id(node) in done:
        return  # an alias
    done.add(id(node))
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_duplicate_keys(source, item, done)
    if not isinstance(node, yaml.MappingNode):
        return
    seen: dict[str, int] = {}
    for key, value in node.value:
        line = key.start_mark.line + 1
        if not isinstance(key, yaml.ScalarNode):
            raise ScenarioError(f"{source}:{line}: a key has to be a plain word")
        if key.value in seen:
            raise ScenarioError(
                f"{source}:{line}: {key.value}: given twice, before on line {seen[key.value]}: keep one of them"
            )
        seen[key.value] = line
        _refuse_duplicate_keys(source, value, done)


def _yaml_mistake(source: str, error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    place = f"{source}:{mark.line + 1}" if mark else source
    problem = getattr(error, "problem", None) or error
    hint = "; indent with spaces" if "'\\t'" in str(problem) else ""
    return f"{place}: not valid YAML: {problem}{hint}"
