"""A scenario file with what it extends: read one after the other and laid over each other."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from pathlib import Path

from bridge.scenario.document.files import file_seen_from
from bridge.scenario.document.merge import is_left_out, is_of_one, merged, same_id
from bridge.scenario.document.written import OfOne, Written, plain
from bridge.scenario.document.yaml_text import read_yaml
from bridge.scenario.mistakes.error import ScenarioError
from sitl_configs.near import near_miss

SCENARIOS = resources.files("sitl_configs") / "scenarios"
EXTENDS, WITHOUT = "extends", "without"
SUFFIXES = (".yaml", ".yml")


def scenario_names() -> list[str]:
    """Names of the scenarios that ship."""
    return sorted(f.name.removesuffix(".yaml") for f in SCENARIOS.iterdir() if f.name.endswith(".yaml"))


def read_file(name_or_path: str) -> Written:
    """The scenario of a shipped one's name or of a file, with what it extends below it.

    Raises:
        ScenarioError: it cannot be found or read, is not YAML, or extends itself.
    """
    path = Path(name_or_path)
    if path.is_file():
        return read_text(_text(path), str(path), path.parent.absolute(), (path.resolve(),))
    if name_or_path in scenario_names():
        shipped = Path(str(SCENARIOS / f"{name_or_path}.yaml"))
        return read_text(_text(shipped), shipped.name, shipped.parent, (shipped.resolve(),))
    known = scenario_names()
    raise ScenarioError(
        f"{name_or_path}: no such file, and no scenario of that name{near_miss(name_or_path, known)} "
        f"(there are: {', '.join(known)})"
    )


def read_text(text: str, source: str, folder: Path, reading: tuple[Path, ...] = ()) -> Written:
    """The scenario of a text, with what it extends below it.

    Args:
        text: YAML.
        source: what mistakes are reported under.
        folder: what files that it names are seen from.
        reading: the files that are being read: this one, and those that extend it.

    Raises:
        ScenarioError: it is not YAML, or what it extends cannot be read.
    """
    return with_extended(read_yaml(text, source, folder), reading)


def with_extended(root: Written, reading: tuple[Path, ...] = ()) -> Written:
    """A scenario with what it extends below it; arguments and errors as of `read_text`."""
    extends = root.get(EXTENDS)
    if extends is None:
        _refuse_without(root)
        return root
    base = _base(extends, reading)
    return merged(_left_of(base, root.get(WITHOUT)), root.without(EXTENDS, WITHOUT))


def _base(extends: Written, reading: tuple[Path, ...]) -> Written:
    name, place = extends.content, extends.place
    if not isinstance(name, str):
        raise ScenarioError(
            f"{place}: {EXTENDS}: has to be the name of a scenario that ships, or a file (got {plain(extends)!r})"
        )
    path, source = file_seen_from(place.folder, name), str(Path(place.source).parent / name)
    if not (path.suffix in SUFFIXES and path.is_file()):
        if name not in scenario_names():
            raise ScenarioError(f"{place}: {EXTENDS}: {_unknown(name, path)}")
        path, source = Path(str(SCENARIOS / f"{name}.yaml")), f"{name}.yaml"
    if path.resolve() in reading:
        chain = " -> ".join(file.name for file in (*reading, path))
        raise ScenarioError(f"{place}: {EXTENDS}: {chain}: a scenario cannot extend itself")
    return read_text(_text(path), source, path.parent.absolute(), (*reading, path.resolve()))


def _unknown(name: str, path: Path) -> str:
    if path.suffix in SUFFIXES:
        return f"there is no file {path}"
    known = scenario_names()
    return (
        f"no scenario {name!r}{near_miss(name, known)} "
        f"(has to be a file that ends in .yaml or .yml, or one of: {', '.join(known)})"
    )


def _left_of(base: Written, without: Written | None) -> Written:
    """What is extended, without the nodes that are left out."""
    nodes = base.get("nodes")
    if without is None or nodes is None:
        return base
    if not without.is_list:
        raise ScenarioError(f"{without.place}: {WITHOUT}: has to be a list of ids of nodes, as [1, gcs]")
    kept = nodes.items()
    for item in without.items():
        groups = [
            place for place, node in enumerate(kept) if is_of_one(node, item) and not is_left_out(node, item)
        ]
        if groups:
            group = kept[groups[0]]
            kept[groups[0]] = replace(group, of_one=(*group.of_one, OfOne(item, None)))
            continue
        left = [node for node in kept if is_of_one(node, item) or not same_id(node, item.content)]
        if len(left) == len(kept):
            raise ScenarioError(
                f"{item.place}: {WITHOUT}: no node of what is extended has id {plain(item)!r}"
            )
        kept = left
    return base.having("nodes", Written(kept, nodes.place))


def _refuse_without(root: Written) -> None:
    without = root.get(WITHOUT)
    if without is not None:
        raise ScenarioError(
            f"{without.place}: {WITHOUT}: leaves out nodes of the scenario that is extended, but there is no {EXTENDS}"
        )


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from error
