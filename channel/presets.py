"""Radios by name: YAML data, extended and overridden key by key, every mistake named with file, line and key."""

from __future__ import annotations

import csv
import difflib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from channel.config import RadioConfig
from channel.own import CLASS_KEY, class_path
from channel.propagation.terrain import Terrain

Tree = dict[str, Any]


class PresetError(ValueError):
    """A radio that cannot be: `key` is the dotted place, `file` and `line` where it was written if known."""

    def __init__(
        self, problem: str, *, key: str = "", file: str | None = None, line: int | None = None
    ) -> None:
        place = ":".join(str(part) for part in (file, line) if part is not None)
        super().__init__(": ".join(part for part in (place, key, problem) if part))
        self.problem = problem
        self.key = key
        self.file = file
        self.line = line


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


def radio_from_mapping(mapping: Mapping[str, Any]) -> RadioConfig:
    """Return the radio of a mapping; with a `preset` key, that preset overridden by the other keys.

    Raises:
        PresetError: an unknown preset, an unknown key or a bad value.
    """
    return _validated(_resolved(_with_tables(mapping, Path()), Path(), ()), None, ())


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
        first = error.errors(include_url=False)[0]
        raise PresetError(_problem(first, "propagation", {}), key="propagation") from error
    return config.model_copy(update={"propagation": law})


def radio_to_yaml(config: RadioConfig) -> str:
    """Return the YAML text that `load_radio` reads back as the same radio."""
    tree = config.model_dump(mode="json", by_alias=True)
    return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)


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
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise PresetError(f"{text!r} is not a YAML value", key=key) from error
        _put(out, key.split("."), _number_if_exponent(value))
    return out


def dotted_keys(tree: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Return the dotted names of all leaves of nested mappings."""
    out: list[str] = []
    for key, value in tree.items():
        name = f"{prefix}{key}"
        out += dotted_keys(value, f"{name}.") if isinstance(value, Mapping) else [name]
    return out


def _number_if_exponent(value: object) -> object:
    """Read 2.4e9 as a number: YAML 1.1 wants a sign in the exponent and gives a text otherwise."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


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
    close = difflib.get_close_matches(name, preset_names(), n=1)
    hint = f"; did you mean {close[0]}? Presets:" if close else "; presets:"
    known = ", ".join(preset_names())
    raise PresetError(f"no radio preset or YAML file {name!r}{hint} {known}", key="preset")


def _read(file: Path, extending: tuple[Path, ...]) -> Tree:
    """Return the tree of a file; `extending` are the files that lead to it."""
    if file.resolve() in extending:
        raise PresetError("extends itself", key="preset", file=str(file))
    try:
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise PresetError("is not a file of text", file=str(file)) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = None if mark is None else mark.line + 1
        raise PresetError("is not YAML", file=str(file), line=line) from error
    if not isinstance(tree, dict):
        raise PresetError("is not a mapping of keys to values", file=str(file))
    tables = _with_tables({"name": file.stem, **tree}, file.parent)
    return _resolved(tables, file.parent, (*extending, file.resolve()))


def _with_tables(tree: Mapping[str, Any], beside: Path, prefix: str = "") -> Tree:
    """Return the tree with files as seen from a directory: a CSV's rows under `x` for `x_file`, classes by path."""
    out: Tree = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            out[str(key)] = _with_tables(value, beside, f"{prefix}{key}.")
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
    """Return the numbers of a CSV file, whose first line may be a heading."""
    try:
        with file.open(encoding="utf-8", newline="") as lines:
            rows = [row for row in csv.reader(lines) if row]
    except OSError as error:
        raise PresetError(f"cannot read {file}: {error.strerror}", key=key) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise PresetError(f"{file} is not a CSV of text", key=key) from error
    numbers: list[list[float]] = []
    for number, row in enumerate(rows, start=1):
        try:
            numbers.append([float(cell) for cell in row])
        except ValueError as error:
            if number > 1:
                raise PresetError("not a row of numbers", key=key, file=str(file), line=number) from error
    return numbers


def _resolved(tree: Tree, beside: Path, extending: tuple[Path, ...]) -> Tree:
    """Return the tree with the preset it names, if any, laid under it."""
    preset = tree.pop("preset", None)
    if preset is None:
        return tree
    return merged(_read(_preset_file(str(preset), beside), extending), tree)


def _validated(tree: Tree, file: Path | None, overridden: tuple[str, ...]) -> RadioConfig:
    try:
        return RadioConfig.model_validate(tree)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = _key_of(first["loc"], tree)
        problem = _problem(first, key, tree)
        if file is None or any(each == key or each.startswith(f"{key}.") for each in overridden):
            raise PresetError(problem, key=key) from error
        raise PresetError(problem, key=key, file=str(file), line=_line_of(file, key)) from error


def _key_of(location: tuple[int | str, ...], tree: object) -> str:
    """Return the dotted key of a validation error, without the model names that pydantic puts between."""
    parts: list[str] = []
    for part in location:
        inside = isinstance(tree, Mapping) and part in tree
        if isinstance(tree, Mapping) and not inside and part == tree.get("model"):
            continue
        parts.append(str(part))
        if isinstance(tree, Mapping):
            tree = tree.get(part)
        elif isinstance(tree, list) and isinstance(part, int) and part < len(tree):
            tree = tree[part]
    return ".".join(parts)


def _problem(error: Mapping[str, Any], key: str, tree: Tree) -> str:
    if error["type"] == "extra_forbidden":
        return _unknown_key(key, tree)
    if error["type"] == "missing":
        return "is missing"
    if error["type"] == "union_tag_invalid":
        tag, known = error["ctx"]["tag"], error["ctx"]["expected_tags"]
        close = difflib.get_close_matches(
            tag, [each.strip(" '") for each in known.split(",")], n=1, cutoff=0.5
        )
        hint = f"; did you mean {close[0]}? Allowed:" if close else "; allowed:"
        return f"no model {tag!r}{hint} {known}"
    if error["type"] == "value_error":
        return str(error["msg"]).removeprefix("Value error, ")
    wanted = {"float_parsing": "has to be a number", "float_type": "has to be a number"}.get(error["type"])
    return f"{wanted or error['msg'].replace('Input should be', 'has to be', 1)}, not {error['input']!r}"


def _unknown_key(key: str, tree: Tree) -> str:
    *groups, word = key.split(".")
    models: list[type[BaseModel]] = [RadioConfig]
    here: Any = tree
    for group in (part for part in groups if not part.isdigit()):
        inner = [
            m
            for model in models
            if group in model.model_fields
            for m in _models_in(model.model_fields[group].annotation)
        ]
        here = here.get(group) if isinstance(here, Mapping) else None
        chosen = here.get("model") if isinstance(here, Mapping) else None
        models = [m for m in inner if chosen in (None, getattr(m.model_fields.get("model"), "default", None))]
    names = sorted({field.alias or name for model in models for name, field in model.model_fields.items()})
    close = difflib.get_close_matches(word, names, n=1)
    hint = f"; did you mean {close[0]}?" if close else ""
    return (
        f"unknown key{hint} Allowed: {', '.join(names)}"
        if hint
        else f"unknown key; allowed: {', '.join(names)}"
    )


def _models_in(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in getattr(annotation, "__args__", ()) for model in _models_in(part)]


def _line_of(file: Path, key: str) -> int | None:
    """Return the line on which the deepest part of a dotted key stands in a YAML file."""
    node = yaml.compose(file.read_text(encoding="utf-8"))
    line: int | None = None
    for part in key.split("."):
        if isinstance(node, yaml.SequenceNode) and part.isdigit() and int(part) < len(node.value):
            node = node.value[int(part)]
            line = node.start_mark.line + 1
            continue
        pairs = node.value if isinstance(node, yaml.MappingNode) else []
        found = next((pair for pair in pairs if pair[0].value == part), None)
        if found is None:
            return line
        line, node = found[0].start_mark.line + 1, found[1]
    return line
