"""YAML text to values with their lines."""

from __future__ import annotations

from pathlib import Path

import yaml

from bridge.scenario.document.written import Written, WrittenPlace
from bridge.scenario.mistakes.error import ScenarioError
from sitl_configs.yaml_text import YamlMistake, composed

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
        with composed(text) as (root, loader):
            if not isinstance(root, yaml.MappingNode):
                raise YamlMistake(f"a {kind} is a mapping of keys to values", 1)
            return _Reader(loader, source, folder).read(root, WrittenPlace(source, 1, folder))
    except YamlMistake as mistake:
        place = source if mistake.line is None else f"{source}:{mistake.line}"
        raise ScenarioError(f"{place}: {mistake}") from mistake


class _Reader:
    """Makes values of nodes."""

    def __init__(self, loader: yaml.SafeLoader, source: str, folder: Path) -> None:
        self._loader, self._source, self._folder = loader, source, folder

    def read(self, node: yaml.Node, place: WrittenPlace) -> Written:
        if isinstance(node, yaml.MappingNode) and node.tag == MAPPING:
            self._loader.flatten_mapping(node)
            parts = {_word(key): self.read(value, self._place(key)) for key, value in node.value}
            return Written(parts, place, self._place_before(node.end_mark))
        if isinstance(node, yaml.SequenceNode) and node.tag == SEQUENCE:
            return Written([self.read(item, self._place(item)) for item in node.value], place)
        return Written(self._loader.construct_object(node, deep=True), place)

    def _place(self, node: yaml.Node) -> WrittenPlace:
        return WrittenPlace(self._source, node.start_mark.line + 1, self._folder)

    def _place_before(self, mark: yaml.Mark) -> WrittenPlace:
        """A block ends where the next thing begins: its last line is before that."""
        return WrittenPlace(self._source, max(1, mark.line + (1 if mark.column else 0)), self._folder)


def _word(key: yaml.Node) -> str:
    if not isinstance(key, yaml.ScalarNode):
        raise YamlMistake("a key has to be a plain word", key.start_mark.line + 1)
    return str(key.value)
