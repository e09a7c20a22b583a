"""Settings: single values of a scenario changed by dotted key, from the command line or by a program."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bridge.scenario.document.merge import as_preset, kind_of, names_a_preset, removes, same_id
from bridge.scenario.document.written import Path_, Written, WrittenPlace, written_at
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.nodes import KEYS
from sitl_configs.yaml_text import YamlMistake, read_yaml

ALL_NODES = "*"


@dataclass(frozen=True, slots=True)
class Setting:
    """One value in place of what a scenario says.

    Attributes:
        key: dotted: ``radio.noise.floor_dbm``; nodes by id (``nodes.1.home.north_m``) or all of them
            whose kind has the key (``nodes.*.radio``), other lists by index.
        value: plain, as YAML has it.
        told_as: what a mistake is reported under, the option say.
        folder: what files that it names are seen from.
    """

    key: str
    value: Any
    told_as: str
    folder: Path = Path()

    @property
    def steps(self) -> tuple[str, ...]:
        """The parts of the key."""
        return tuple(self.key.split("."))

    @property
    def is_of_nodes(self) -> bool:
        """Whether it is about nodes, which are there only when groups of them are expanded."""
        return self.steps[0] == "nodes" and len(self.steps) > 1


Overrides = Mapping[str, Any] | Sequence[Setting]
"""Settings, or values by dotted key."""


def settings_of(overrides: Overrides) -> list[Setting]:
    """Overrides as settings; mistakes in those given by key are reported as such, files seen from where we are.

    Raises:
        ScenarioError: a key is no text.
    """
    if not isinstance(overrides, Mapping):
        return list(overrides)
    for key in overrides:
        if not isinstance(key, str):
            raise ScenarioError(
                f"override {key!r}: a key has to be a text, as radio.noise.noise_figure_db is"
            )
    folder = Path.cwd()
    return [Setting(key, value, f"override {key}={value!r}", folder) for key, value in overrides.items()]


def parse_setting(text: str, folder: Path = Path()) -> Setting:
    """The setting that KEY=VALUE on a command line is; the value is YAML.

    Raises:
        ScenarioError: it has no ``=`` or no key, or its value is not YAML.
    """
    key, equals, value = text.partition("=")
    told_as = f"--set {text}"
    if not equals or not all(key.split(".")):
        raise ScenarioError(f"{told_as}: has to be KEY=VALUE, as in radio.noise.noise_figure_db=6")
    try:
        plain = read_yaml(value)
    except YamlMistake as error:
        raise ScenarioError(f"{told_as}: {key}: {error}") from error
    return Setting(key, plain, told_as, folder)


def with_settings(root: Written, settings: Iterable[Setting]) -> Written:
    """The scenario with the settings in it, one after the other.

    Raises:
        ScenarioError: a key leads through something that has no keys, or to a node or item that is not there.
    """
    for setting in settings:
        value = written_at(setting.value, WrittenPlace(setting.told_as, None, setting.folder))
        root = _Setter(root, setting, value).put(root, (), setting.steps)
    return root


@dataclass(frozen=True, slots=True)
class _Setter:
    root: Written
    setting: Setting
    value: Written

    def put(self, here: Written, path: Path_, steps: Sequence[str]) -> Written:
        """``here``, which is at ``path``, with the value where ``steps`` lead to."""
        if not steps:
            return self.value
        if names_a_preset(path) and isinstance(here.content, str):
            here = as_preset(here)
        if here.is_list and path == ("nodes",):
            return self._put_in_nodes(here, steps)
        if here.is_list:
            index = self._index(here, path, steps[0])
            return here.having(index, self.put(here.content[index], (*path, index), steps[1:]))
        if here.content is None:
            here = replace(here, content={})
        if not here.is_mapping:
            self._refuse(f"{self.root.dotted(path)} is {here.content!r}, which has no keys")
        step, rest = self._key(here, steps)
        if not rest and removes(here, step, self.value):
            return here.without(step)
        below = here.get(step) or Written({} if rest else None, self.value.place)
        return here.having(step, self.put(below, (*path, step), rest))

    @staticmethod
    def _key(here: Written, steps: Sequence[str]) -> tuple[str, Sequence[str]]:
        """The key meant, and the steps that are left; one that is there, a network's name say, may have dots in it."""
        for length in range(len(steps), 1, -1):
            if here.get(key := ".".join(steps[:length])) is not None:
                return key, steps[length:]
        return steps[0], steps[1:]

    def _put_in_nodes(self, nodes: Written, steps: Sequence[str]) -> Written:
        chosen, rest = self._chosen(nodes, steps)
        for index in chosen:
            node = self.put(nodes.content[index], ("nodes", index), rest)
            nodes = nodes.having(index, node)
        return nodes

    def _chosen(self, nodes: Written, steps: Sequence[str]) -> tuple[list[int], Sequence[str]]:
        """Indices of the nodes meant, and the steps that are left; an id may have dots in it."""
        items = nodes.items()
        if steps[0] == ALL_NODES:
            return self._able(items, steps[1:]), steps[1:]
        for length in range(1, len(steps) + 1):
            node_id = ".".join(steps[:length])
            found = [index for index, node in enumerate(items) if same_id(node, node_id)]
            if found:
                return found[:1], steps[length:]
        ids = ", ".join(str(own.content) for node in items if (own := node.get("id")) is not None)
        self._refuse(f"no node has the id {steps[0]}; there are: {ids or 'none'}, and * for all")
        raise AssertionError

    def _able(self, nodes: Sequence[Written], steps: Sequence[str]) -> list[int]:
        """Indices of the nodes whose kind has the key; of all if no kind has it, which is told of each as unknown."""
        kinds = [kind for kind, keys in KEYS.items() if steps and steps[0] in keys]
        if not kinds:
            return list(range(len(nodes)))
        found = [index for index, node in enumerate(nodes) if kind_of(node) in kinds]
        if nodes and not found:
            self._refuse(f"no node here can have {steps[0]}: it is a key of {' and '.join(kinds)} nodes")
        return found

    def _index(self, here: Written, path: Path_, step: str) -> int:
        if step.isdecimal() and int(step) < len(here.content):
            return int(step)
        there = f"0 to {len(here.content) - 1}" if here.content else "no item at all"
        self._refuse(f"{self.root.dotted(path)} is a list with {there}; {step!r} is not one of its items")
        raise AssertionError

    def _refuse(self, text: str) -> None:
        raise ScenarioError(f"{self.setting.told_as}: {self.setting.key}: {text}")
