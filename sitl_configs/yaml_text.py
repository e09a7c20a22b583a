"""Text in YAML to what it says, for files that anybody writes: whatever is in them, there is a value or a mistake."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

SHIPPED = Path(__file__).resolve().parent
VALUES_MAX = 1_000_000
"""A file has hundreds; aliases of aliases may stand for more than there is memory."""
NO_VALUE = (ValueError, LookupError, AttributeError, TypeError)
"""What PyYAML raises of a word that is none of its tag: a date that is none, or `!!bool maybe`."""
FLOAT = "tag:yaml.org,2002:float"
EXPONENT = re.compile(r"^(?:[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+|[-+](?:inf|nan))$")
"""Numbers as well: YAML 1.1 wants dots and signs in them."""
OCTAL = re.compile(r"^[-+]?0[0-7_]+$")
OURS: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""Loader of what ships, or what we wrote: ten times as fast where libyaml is, which a text that is nested too deeply
crashes, with the whole process."""


class YamlMistake(ValueError):
    """A text that is not YAML, or says something twice.

    Attributes:
        line: where, from 1; None if it is nowhere in particular.
    """

    def __init__(self, text: str, line: int | None = None) -> None:
        super().__init__(text)
        self.line = line


class _TextLoader(yaml.SafeLoader):
    """Takes 1e3 and 2.4e9 for numbers, and none that YAML 1.1 reads as another than is written."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """The value of a node; a word that is none of its tag is told with its line."""
        try:
            return super().construct_object(node, deep)
        except NO_VALUE as error:
            if isinstance(error, YamlMistake) or not isinstance(node, yaml.ScalarNode):
                raise
            raise YamlMistake(f"is not YAML: {error}", _line_of(node)) from None

    def construct_number(self, node: yaml.ScalarNode) -> int | float:
        """The number of a word; 010 would be 8, and 12:30 be 750."""
        is_float = node.tag == FLOAT
        value: int | float = self.construct_yaml_float(node) if is_float else self.construct_yaml_int(node)
        if OCTAL.match(node.value):
            raise YamlMistake(_misread(node, value, "is octal"), _line_of(node))
        if ":" in node.value:
            raise YamlMistake(_misread(node, value, "counts in sixties"), _line_of(node))
        return value


class _TextDumper(yaml.SafeDumper):
    """Writes what `_TextLoader` reads back as it was: the text 1e3 in quotes."""


for _side in (_TextLoader, _TextDumper):
    _side.add_implicit_resolver(FLOAT, EXPONENT, list("-+.0123456789"))
for _tag in (FLOAT, "tag:yaml.org,2002:int"):
    _TextLoader.add_constructor(_tag, _TextLoader.construct_number)


def yaml_of(tree: Any) -> str:
    """Return the text of values; `read_yaml` gives them back."""
    return yaml.dump(tree, Dumper=_TextDumper, sort_keys=False, allow_unicode=True)


def ships(file: Path) -> bool:
    """Whether a file is one of ours."""
    return file.resolve().is_relative_to(SHIPPED)


def read_yaml(text: str, *, is_ours: bool = False) -> Any:
    """Return what a text says.

    Args:
        text: the text.
        is_ours: it ships, or we wrote it: it is YAML.

    Raises:
        YamlMistake: it is not YAML, is nested too deeply, has too many values, or has a key twice.
    """
    if is_ours:
        return yaml.load(text, Loader=OURS)
    with composed(text) as (root, loader):
        return None if root is None else loader.construct_document(root)


@contextmanager
def composed(text: str) -> Iterator[tuple[yaml.Node | None, yaml.SafeLoader]]:
    """Give the root of a text's nodes, None if there is nothing, and what makes values of nodes.

    Raises:
        YamlMistake: as `read_yaml`; also of what the block that is entered makes of the nodes.
    """
    try:
        loader = _TextLoader(text)
        try:
            root = loader.get_single_node()
            if root is not None:
                _count(root, {})
            yield root, loader
        finally:
            loader.dispose()
    except YamlMistake:
        raise
    except yaml.YAMLError as error:
        problem = str(getattr(error, "problem", None) or error)
        hint = "; indent with spaces" if "'\\t'" in problem else ""
        raise YamlMistake(f"is not YAML: {problem}{hint}", _line(error)) from None
    except RecursionError:
        raise YamlMistake("is nested too deeply") from None
    except NO_VALUE as error:
        raise YamlMistake(f"is not YAML: {error}") from None


def _misread(node: yaml.ScalarNode, value: float, why: str) -> str:
    text = node.value
    return (
        f"{text} is {value} in YAML, where it {why}: write a decimal number, or '{text}' in quotes for a text"
    )


def _line_of(node: yaml.Node) -> int:
    return int(node.start_mark.line) + 1


def _line(error: yaml.YAMLError) -> int | None:
    mark = getattr(error, "problem_mark", None)
    return None if mark is None else mark.line + 1


def _count(node: yaml.Node, counted: dict[int, int]) -> int:
    """Return how many values a node stands for, with aliases in full."""
    if id(node) in counted:
        if not counted[id(node)]:
            raise YamlMistake("an alias of what it is in", _line_of(node))
        return counted[id(node)]
    counted[id(node)] = 0
    count = 1
    if isinstance(node, yaml.SequenceNode):
        count += sum(_count(item, counted) for item in node.value)
    elif isinstance(node, yaml.MappingNode):
        _refuse_twice(node)
        count += sum(_count(part, counted) for pair in node.value for part in pair)
    if count > VALUES_MAX:
        raise YamlMistake(f"has more than {VALUES_MAX} values")
    counted[id(node)] = count
    return count


def _refuse_twice(node: yaml.MappingNode) -> None:
    lines: dict[str, int] = {}
    for key, _ in node.value:
        line = _line_of(key)
        if isinstance(key, yaml.ScalarNode):
            if key.value in lines:
                raise YamlMistake(
                    f"{key.value}: given twice, before on line {lines[key.value]}: keep one of them", line
                )
            lines[key.value] = line
