"""YAML that anybody writes gives a value or a mistake, whatever it is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from sitl_configs.yaml_text import YamlMistake, read_yaml, ships, yaml_of

BOMB = "\n".join(
    ["a0: &a0 [1, 2]", *(f"a{n + 1}: &a{n + 1} [{', '.join([f'*a{n}'] * 10)}]" for n in range(8))]
)


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        ("a: 1\nb: 2\na: 3\n", 3, "a: given twice, before on line 1: keep one of them"),
        ("a:\n  - {b: 1, b: 2}\n", 2, "b: given twice, before on line 2: keep one of them"),
        ("a: [1\nb: 2", 2, "is not YAML: "),
        ("a: 2024-13-45", 1, "is not YAML: month must be in 1..12"),
        ("a: &x [1, *x]", 1, "an alias of what it is in"),
        ("[" * 100_000, None, "is nested too deeply"),  # libyaml crashes of it
        pytest.param("[" * 100_000 + "]" * 100_000, None, "is nested too deeply", marks=pytest.mark.slow),
        (BOMB, None, "has more than 1000000 values"),
        ("a: \x00", None, "is not YAML: "),
        ("b: 1\na: !!bool maybe", 2, "is not YAML: "),
        ("a: !!int ''", 1, "is not YAML: "),
        ("a: !!timestamp soon", 1, "is not YAML: "),
    ],
)
def test_what_is_wrong_is_told_with_its_line(text: str, line: int | None, told: str) -> None:
    with pytest.raises(YamlMistake) as caught:
        read_yaml(text)
    assert str(caught.value).startswith(told)
    assert caught.value.line == line


class LoaderOfNumbers(yaml.SafeLoader):
    """As PyYAML has it, but that 1e3 is a number, as in YAML 1.2, and -inf, as in Python."""


NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$|[-+](inf|nan)$")
LoaderOfNumbers.add_implicit_resolver("tag:yaml.org,2002:float", NUMBER, list("-+.0123456789"))


@given(st.text())
@example("0E0")
@example("1E\N{ARABIC-INDIC DIGIT THREE}")
def test_any_text_is_a_value_or_a_mistake(text: str) -> None:
    try:
        found = read_yaml(text)
    except YamlMistake:
        return
    assert repr(found) == repr(yaml.load(text, LoaderOfNumbers))


def test_what_ships_is_read_as_what_does_not(tmp_path: Path) -> None:
    shipped = sorted((Path(__file__).parents[2] / "sitl_configs").rglob("*.yaml"))
    assert len(shipped) > 10
    for file in shipped:
        assert ships(file)
        text = file.read_text(encoding="utf-8")
        assert read_yaml(text, is_ours=True) == read_yaml(text)
    assert not ships(tmp_path / "mine.yaml")


def test_aliases_and_merges_stay(tmp_path: Path) -> None:
    text = "base: &base {a: 1, b: 2}\nmine: {<<: *base, b: 3}\nagain: *base\n"
    assert read_yaml(text) == {"base": {"a": 1, "b": 2}, "mine": {"a": 1, "b": 3}, "again": {"a": 1, "b": 2}}


@pytest.mark.parametrize("text", ["1e3", "2.4e9", "-1E-3", "-inf"])
def test_what_looks_like_a_number_is_one(text: str) -> None:
    assert read_yaml(f"{{a: {text}, b: '{text}'}}") == {"a": float(text), "b": text}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("010", "010 is 8 in YAML, where it is octal: write a decimal number, or '010' in quotes for a text"),
        ("-017", "-017 is -15 in YAML, where it is octal"),
        ("12:30", "12:30 is 750 in YAML, where it counts in sixties"),
        ("1:30.5", "1:30.5 is 90.5 in YAML, where it counts in sixties"),
    ],
)
def test_numbers_that_are_others_than_they_look_are_refused(text: str, says: str) -> None:
    with pytest.raises(YamlMistake, match=re.escape(says)) as raised:
        read_yaml(f"a: 1\nb: {text}\n")
    assert raised.value.line == 2
    assert read_yaml(f"[0, 0.5, 0x10, '{text}']") == [0, 0.5, 16, text]


@pytest.mark.parametrize("is_ours", [False, True])
def test_values_come_back_as_they_were_written(is_ours: bool) -> None:
    tree = {
        "a": ["1e3", "2.4E9", "010", "12:30", "-inf", "on", "ü"],
        "b": [1e3, 1e22, 1e-7, float("inf"), 8, True],
    }
    assert read_yaml(yaml_of(tree), is_ours=is_ours) == tree
