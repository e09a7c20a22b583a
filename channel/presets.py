"""Radios by name: YAML data, extended and overridden key by key, every mistake named with file, line and key."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from channel.config import RadioConfig
from channel.own.models import CLASS_KEY, class_path
from channel.preset_errors import PresetError, Tree, at_once, has_key, line_of, problems_in, tree_in
from channel.propagation.terrain import Terrain
from channel.schedule_file import KEY as SCHEDULE_KEY
from channel.schedule_file import read_schedule
from sitl_configs.config_file import unknown
from sitl_configs.yaml_text import YamlMistake, read_yaml, yaml_of

__all__ = [
    "PresetError",
    "at_origin",
    "dotted_keys",
    "load_radio",
    "merged",
    "preset_names",
    "presets_directory",
    "radio_from_mapping",
    "radio_to_yaml",
    "radio_tree",
    "seen_from",
]


def presets_directory() -> Path:
    """Return the directory of the presets that ship."""
    return Path(str(resources.files("sitl_configs").joinpath("radios")))


def preset_names() -> tuple[str, ...]:
    """Return the names of the presets that ship, sorted."""
    return tuple(sorted(path.stem for path in presets_directory().glob("*.yaml")))


def load_radio(name_or_path: str | Path, overrides: Mapping[str, Any] | None = None) -> RadioConfig:
    """Return the radio of a preset's name or a YAML file's path, with overrides merged key by key.

    Raises:
        PresetError: no such preset or file, not YAML, an unknown key or a bad value.
    """
    file = _preset_file(str(name_or_path))
    tree = merged(_read(file, ()), _with_tables(overrides or {}, Path()))
    return _validated(tree, file, () if overrides is None else tuple(dotted_keys(overrides)))


def radio_tree(name_or_path: str | Path) -> Tree:
    """Return what a preset's or file's YAML says, with what it extends and its tables read in: whole in one file.

    Maps and classes are by absolute path.

    Raises:
        PresetError: no such preset or file, not YAML, or a table cannot be read.
    """
    return _read(_preset_file(str(name_or_path)), ())


def radio_from_mapping(mapping: Mapping[str, Any]) -> RadioConfig:
    """Return the radio of a mapping; with a `preset` key, that preset overridden by the other keys.

    Raises:
        PresetError: an unknown preset, an unknown key or a bad value.
    """
    tree = _with_tables(mapping, Path())
    preset = tree.get("preset")
    resolved = _resolved(tree, Path(), ())
    file = None if preset is None else _preset_file(str(preset))
    return _validated(resolved, file, tuple(dotted_keys(tree)))


def seen_from(folder: Path, mapping: Mapping[str, Any]) -> Tree:
    """Return the mapping with tables, as seen from `folder`, read in, and a preset's file by its absolute path.

    Raises:
        PresetError: a table cannot be read.
    """
    tree = _with_tables(mapping, folder)
    preset = tree.get("preset")
    if isinstance(preset, str) and preset not in preset_names():
        tree["preset"] = str(_preset_file(preset, folder).absolute())
    return tree


def at_origin(config: RadioConfig, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> RadioConfig:
    """Return the radio with a run's origin put into what lies on the Earth: terrain from a file.

    Raises:
        PresetError: the file does not cover the place.
    """
    if not isinstance(config.propagation, Terrain):
        return config
    try:
        law = config.propagation.at_origin(lat_deg, lon_deg, alt_amsl_m)
    except ValidationError as error:
        [(_, problem), *_] = problems_in(error, Terrain)
        raise PresetError(problem, key="propagation") from None
    return config.model_copy(update={"propagation": law})


def radio_to_yaml(config: RadioConfig) -> str:
    """Return the YAML text that `load_radio` reads back as the same radio."""
    tree = config.model_dump(mode="json", by_alias=True)
    return yaml_of(tree)


def merged(base: Mapping[str, Any], overrides: Mapping[str, Any]) -> Tree:
    """Return `base` with `overrides` laid over it, group by group.

    A group whose `model` changes is replaced and keeps nothing of the old model's parameters.
    """
    out: Tree = dict(base)
    for key, value in overrides.items():
        old = out.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            named = _named(value)
            out[key] = merged(old, value) if named in (None, _named(old)) else dict(value)
        else:
            out[key] = value
    return out


def _named(group: Mapping[str, Any]) -> object:
    """Return which model a group names, None if none."""
    return group.get(CLASS_KEY, group.get("model"))


def overrides_from_settings(settings: Iterable[str]) -> Tree:
    """Return the mapping that `group.key=value` texts describe; values are read as YAML.

    Raises:
        PresetError: a text without `=` or without a key, or a value that is not YAML.
    """
    out: Tree = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not all(key.split(".")):
            raise PresetError(f"{setting!r} is not KEY=VALUE, as in propagation.exponent=2.5")
        try:
            value = read_yaml(text)
        except YamlMistake as error:
            raise PresetError(str(error), key=key) from error
        _put(out, key.split("."), value)
    return out


def dotted_keys(tree: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Return the dotted names of all leaves of nested mappings, empty groups among them."""
    out: list[str] = []
    for key, value in tree.items():
        name = f"{prefix}{key}"
        out += dotted_keys(value, f"{name}.") if isinstance(value, Mapping) and value else [name]
    return out


def _put(tree: Tree, keys: list[str], value: object) -> None:
    for key in keys[:-1]:
        inner = tree.setdefault(key, {})
        if not isinstance(inner, dict):
            raise PresetError("is given both as a value and as a group", key=key)
        tree = inner
    tree[keys[-1]] = value


def _preset_file(name: str, beside: Path = Path()) -> Path:
    """Return the file of a preset's name, or of a path as seen from a directory."""
    if name in preset_names():
        return presets_directory() / f"{name}.yaml"
    path = beside / name
    if path.suffix in {".yaml", ".yml"} and path.is_file():
        return path
    raise PresetError(unknown("no radio preset or YAML file", name, preset_names()), key="preset")


def _read(file: Path, extending: tuple[Path, ...]) -> Tree:
    """Return the tree of a file; `extending` are the files that lead to it."""
    if file.resolve() in extending:
        raise PresetError("extends itself", key="preset", file=str(file))
    tree = tree_in(file)
    try:
        tables = _with_tables({"name": file.stem, **tree}, file.parent)
        return _resolved(tables, file.parent, (*extending, file.resolve()))
    except PresetError as error:
        if error.file is not None:
            raise
        raise PresetError(
            error.problem, key=error.key, file=str(file), line=line_of(file, error.key)
        ) from None


def _with_tables(tree: Mapping[str, Any], beside: Path, prefix: str = "") -> Tree:
    """Return the tree with files as seen from a directory: a CSV or schedule as `x` for `x_file`, classes by path."""
    out: Tree = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            out[str(key)] = _with_tables(value, beside, f"{prefix}{key}.")
        elif key == SCHEDULE_KEY:
            out[key.removesuffix("_file")] = read_schedule(beside / str(value), f"{prefix}{key}")
        elif str(key).endswith("_file"):
            out[key.removesuffix("_file")] = _csv_rows(beside / str(value), f"{prefix}{key}")
        elif key == CLASS_KEY:
            out[key] = class_path(str(value), beside)
        elif key == "file" and value is not None:
            out[key] = str((beside / str(value)).absolute())
        else:
            out[str(key)] = value
    return out


def _csv_rows(file: Path, key: str) -> list[list[float]]:
    """Return the numbers of a CSV file, whose first row may be a heading: then none of its fields is a number."""
    try:
        with file.open(encoding="utf-8-sig", newline="") as lines:
            reader = csv.reader(lines)
            rows = [(reader.line_num, row) for row in reader if row]
    except OSError as error:
        raise PresetError(f"cannot read {file}: {error.strerror}", key=key) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise PresetError(f"{file} is not a CSV of text", key=key) from error
    numbers: list[list[float]] = []
    for at, (line, row) in enumerate(rows):
        try:
            numbers.append([float(cell) for cell in row])
        except ValueError as error:
            if at > 0 or any(map(_is_number, row)):
                raise PresetError("not a row of numbers", key=key, file=str(file), line=line) from error
    return numbers


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _resolved(tree: Tree, beside: Path, extending: tuple[Path, ...]) -> Tree:
    """Return the tree with the preset it names, if any, laid under it."""
    preset = tree.pop("preset", None)
    if preset is None:
        return tree
    return merged(_read(_preset_file(str(preset), beside), extending), tree)


def _validated(tree: Tree, file: Path | None, overridden: tuple[str, ...]) -> RadioConfig:
    """Return the radio of a tree that a file, if any, has but for the keys that were given over it."""
    try:
        return RadioConfig.model_validate(tree)
    except ValidationError as error:
        files = [] if file is None else _extended_by(file)
        found = problems_in(error, RadioConfig)
    there = dotted_keys(tree)
    placed = [
        _placed(key, problem, files, overridden, is_there=any(_covers(each, key) for each in there))
        for key, problem in found
    ]
    raise at_once(placed)


def _placed(
    key: str, problem: str, files: list[Path], overridden: tuple[str, ...], *, is_there: bool
) -> PresetError:
    """Return a mistake with the file, of those that extend each other, in which it was written."""
    if not files or any(_covers(each, key) for each in overridden):
        return PresetError(problem, key=key)
    file = next((each for each in files if is_there and has_key(each, key)), None)
    if file is None:
        group = key.rpartition(".")[0]
        if overridden and (not key or (group and any(_covers(each, group) for each in overridden))):
            return PresetError(problem, key=key)
        file = files[0]
    return PresetError(problem, key=key, file=str(file), line=line_of(file, key))


def _covers(given: str, key: str) -> bool:
    """Return whether a key that was given is a key, or has it as a part, or is a part of it."""
    return given == key or given.startswith(f"{key}.") or key.startswith(f"{given}.")


def _extended_by(file: Path) -> list[Path]:
    """Return a preset's file and those that it extends, which have been read."""
    files = [file]
    while preset := read_yaml(files[-1].read_text(encoding="utf-8")).get("preset"):
        files.append(_preset_file(str(preset), files[-1].parent))
    return files
