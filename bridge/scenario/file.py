"""Reads scenario files. Every mistake is reported with file, line and key, all of them at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, get_args

import yaml
from pydantic import BaseModel, ValidationError

from bridge.scenario.agents import AgentConfig, GroundAgentConfig, OwnAgent
from bridge.scenario.model import FlightDynamics, Mavlink, Origin, Ports, Scenario, Transmit
from bridge.scenario.nodes import Aircraft, GroundNode, GroundPlace, HomePlace, TrackPoint
from bridge.scenario.own_class import clash_of, mistake_in
from bridge.scenario.resolve import airframe_of, wind_of
from bridge.scenario.resolve_radio import radio_from
from channel.presets import PresetError, seen_from
from fdm.air.weather import WeatherConfig
from fdm.errors import AirframeError, WindError
from fdm.model.sensor_noise import SensorNoise

SCENARIOS = resources.files("sitl_configs") / "scenarios"
DEFAULT_SCENARIO = "separation"


class ScenarioError(ValueError):
    """The scenario cannot be used; ``str(error)`` has one line per mistake, each with its place."""


@dataclass(frozen=True, slots=True)
class _Source:
    name: str
    root: yaml.Node

    def line_of(self, path: tuple[str | int, ...]) -> int:
        """Line of the key that ``path`` leads to, or of the deepest part of it that is in the file."""
        node, line = self.root, self.root.start_mark.line
        for step in path:
            found = _child(node, step)
            if found is None:
                continue
            node, line = found
        return int(line) + 1


def _child(node: yaml.Node, step: str | int) -> tuple[yaml.Node, int] | None:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            if key.value == str(step):
                return value, key.start_mark.line
    elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
        return node.value[step], node.value[step].start_mark.line
    return None


def scenario_names() -> list[str]:
    """Names of the scenarios that ship."""
    return sorted(f.name.removesuffix(".yaml") for f in SCENARIOS.iterdir() if f.name.endswith(".yaml"))


def read_scenario(name_or_path: str) -> Scenario:
    """Read a shipped scenario by name, or any by path.

    Raises:
        ScenarioError: if it cannot be found, is not YAML or does not validate.
    """
    path = Path(name_or_path)
    if path.is_file():
        return parse_scenario(_text(path), str(path), path.parent)
    if name_or_path in scenario_names():
        return parse_scenario((SCENARIOS / f"{name_or_path}.yaml").read_text(), f"{name_or_path}.yaml")
    known = ", ".join(scenario_names())
    raise ScenarioError(f"{name_or_path}: no such file, and no scenario of that name (there are: {known})")


def with_changes(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """The scenario with keys (dotted) given other values, as the command line does.

    Raises:
        ScenarioError: if a value is not allowed.
    """
    content = scenario.model_dump(mode="json", by_alias=True)
    for dotted, value in changes.items():
        *groups, key = dotted.split(".")
        target = content
        for group in groups:
            target = target[group]
        target[key] = value
    try:
        return Scenario.model_validate(content)
    except ValidationError as error:
        lines = [f"{'.'.join(map(str, e['loc']))}: {_explain(e, tuple(e['loc']))}" for e in error.errors()]
        raise ScenarioError("\n".join(lines)) from error


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from error


def parse_scenario(text: str, source_name: str, folder: Path = Path()) -> Scenario:
    """Check the text of a scenario; ``source_name`` is what mistakes are reported under.

    Files that it names are as seen from ``folder``; the scenario has their absolute paths.

    Raises:
        ScenarioError: with one line per mistake.
    """
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        source = _Source(source_name, root if root is not None else yaml.MappingNode("", []))
        if not isinstance(root, yaml.MappingNode):
            raise ScenarioError(f"{source_name}:1: a scenario is a mapping of keys to values")
        _refuse_duplicate_keys(source, root)
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ScenarioError(_yaml_mistake(source_name, error)) from error
    except RecursionError as error:
        raise ScenarioError(f"{source_name}: nested too deeply") from error
    try:
        scenario = Scenario.model_validate(content)
    except ValidationError as error:
        raise ScenarioError("\n".join(_mistakes(source, error))) from error
    scenario = _with_files_from(folder.absolute(), scenario)
    return _with_known_names(source, folder.absolute(), scenario)


def _with_files_from(folder: Path, scenario: Scenario) -> Scenario:
    """The scenario with the absolute paths of its files, as seen from ``folder``; its radio, if spelt out, as it is."""

    def place(name: str, *suffixes: str) -> str:
        return str(folder / Path(name).expanduser()) if Path(name).suffix in suffixes else name

    def placed(node: Aircraft | GroundNode) -> Aircraft | GroundNode:
        changes: dict[str, Any] = {}
        if isinstance(node.agent, OwnAgent):
            class_ = f"{place(node.agent.place, '.py')}:{node.agent.class_name}"
            changes["agent"] = node.agent.model_copy(update={"class_": class_})
        if isinstance(node.radio, str):
            changes["radio"] = place(node.radio, ".yaml", ".yml")
        if isinstance(node, Aircraft):
            changes["airframe"] = place(node.airframe, ".yaml", ".yml")
        return node.model_copy(update=changes)

    radio = scenario.radio
    files = {
        "radio": place(radio, ".yaml", ".yml") if isinstance(radio, str) else radio,
        "wind": place(scenario.wind, ".yaml", ".yml"),
        "nodes": tuple(placed(node) for node in scenario.nodes),
    }
    return scenario.model_copy(update=files)


def _with_known_names(source: _Source, folder: Path, scenario: Scenario) -> Scenario:
    """See that what the scenario names is there and right; the radios' tables are read in."""
    mistakes: list[str] = []
    scenario = _with_known_radios(source, folder, scenario, mistakes)
    try:
        wind_of(scenario)
    except WindError as error:
        mistakes.append(f"{source.name}:{source.line_of(('wind',))}: wind: {error}")
    for index, node in enumerate(scenario.nodes):
        if isinstance(node, Aircraft):
            try:
                airframe_of(node)
            except AirframeError as error:
                line = source.line_of(("nodes", index, "airframe"))
                mistakes.append(f"{source.name}:{line}: nodes.{index}.airframe: {error}")
        if isinstance(node.agent, OwnAgent) and (
            mistake := mistake_in(node.agent.place, node.agent.class_name)
        ):
            line = source.line_of(("nodes", index, "agent", "class"))
            mistakes.append(f"{source.name}:{line}: nodes.{index}.agent.class: {mistake}")
    clash = clash_of([node.agent.place for node in scenario.nodes if isinstance(node.agent, OwnAgent)])
    if clash:
        mistakes.append(f"{source.name}:{source.line_of(('nodes',))}: nodes: {clash}")
    if mistakes:
        raise ScenarioError("\n".join(mistakes))
    return scenario


def _with_known_radios(source: _Source, folder: Path, scenario: Scenario, mistakes: list[str]) -> Scenario:
    """The scenario with the tables of its radios read in: the one for all, and those of single nodes."""

    def read(setting: str | dict[str, Any], place: tuple[str | int, ...]) -> str | dict[str, Any]:
        try:
            seen = setting if isinstance(setting, str) else seen_from(folder, setting)
            radio_from(seen, scenario.origin)
        except PresetError as error:
            line = source.line_of((*place, *error.key.split(".")))
            mistakes.append(f"{source.name}:{line}: {'.'.join(map(str, place))}: {error}")
            return setting
        return seen

    nodes = tuple(
        node.model_copy(update={"radio": read(node.radio, ("nodes", index, "radio"))})
        if node.radio is not None
        else node
        for index, node in enumerate(scenario.nodes)
    )
    scenario = scenario.model_copy(update={"radio": read(scenario.radio, ("radio",)), "nodes": nodes})
    if not mistakes:
        mistakes += _other_frequencies(source, scenario)
    return scenario


def _other_frequencies(source: _Source, scenario: Scenario) -> Iterator[str]:
    """All radios of a run are on one frequency."""
    common = radio_from(scenario.radio, scenario.origin).config.frequency_hz
    for index, node in enumerate(scenario.nodes):
        own = common if node.radio is None else radio_from(node.radio, scenario.origin).config.frequency_hz
        if own != common:
            line = source.line_of(("nodes", index, "radio"))
            text = (
                f"its frequency is {own:g} Hz, that of the run's radio {common:g} Hz: all have to be on one"
            )
            yield f"{source.name}:{line}: nodes.{index}.radio: {text}"


def _refuse_duplicate_keys(source: _Source, node: yaml.Node) -> None:
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_duplicate_keys(source, item)
    if not isinstance(node, yaml.MappingNode):
        return
    seen: set[str] = set()
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise ScenarioError(f"{source.name}:{key.start_mark.line + 1}: a key has to be a plain word")
        if key.value in seen:
            raise ScenarioError(f"{source.name}:{key.start_mark.line + 1}: {key.value}: given twice")
        seen.add(key.value)
        _refuse_duplicate_keys(source, value)


def _yaml_mistake(source_name: str, error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    place = f"{source_name}:{mark.line + 1}" if mark else source_name
    return f"{place}: not valid YAML: {getattr(error, 'problem', None) or error}"


def _mistakes(source: _Source, error: ValidationError) -> Iterator[str]:
    for item in error.errors():
        path = tuple(step for step in item["loc"] if not _is_union_tag(step))
        key = ".".join(str(step) for step in path) or "scenario"
        yield f"{source.name}:{source.line_of(path)}: {key}: {_explain(item, path)}"


def _is_union_tag(step: str | int) -> bool:
    """Pydantic puts the chosen branch of a union into the path; it is not a key of the file."""
    return isinstance(step, str) and (step in _AGENTS or "[" in step or step in {"str", "float", *KINDS})


def _explain(item: Any, path: tuple[str | int, ...]) -> str:
    if item["type"] == "extra_forbidden":
        allowed = ", ".join(_allowed_keys(path[:-1], item["loc"]))
        return f"unknown key; allowed here: {allowed}"
    if item["type"] == "missing":
        return "is required"
    if item["type"] in {"union_tag_not_found", "union_tag_invalid"}:
        if path and path[-1] != "agent":
            return f"kind has to be one of: {', '.join(KINDS)}"
        kinds = _GROUND_AGENTS if "ground" in item["loc"] else _AGENTS
        return f"type has to be one of: {', '.join(kinds)}"
    if path in {("nodes",), ("fdm",)}:
        return str(item["msg"]).removeprefix("Value error, ")
    return f"{item['msg'].removeprefix('Value error, ')} (got {item['input']!r})"


def _by_type(config: Any) -> dict[str, type[BaseModel]]:
    return {
        get_args(model.model_fields["type"].annotation)[0]: model for model in get_args(get_args(config)[0])
    }


_AGENTS = _by_type(AgentConfig)
_GROUND_AGENTS = _by_type(GroundAgentConfig)
KINDS = ("ua", "ground")
_MODELS: dict[str, type[BaseModel]] = {
    "origin": Origin,
    "home": HomePlace,
    "transmit": Transmit,
    "ports": Ports,
    "fdm": FlightDynamics,
    "mavlink": Mavlink,
    "sensor_noise": SensorNoise,
    "weather": WeatherConfig,
    "place": GroundPlace,
    "track": TrackPoint,
}


def _allowed_keys(parent: tuple[str | int, ...], loc: tuple[str | int, ...]) -> list[str]:
    names = [step for step in parent if isinstance(step, str)]
    model: type[BaseModel] = Scenario
    if names and names[-1] == "agent":
        model = next(_AGENTS[str(step)] for step in loc if step in _AGENTS)
    elif names and names[-1] == "nodes":
        model = GroundNode if "ground" in loc else Aircraft
    elif names:
        model = _MODELS[names[-1]]
    return [field.alias or name for name, field in model.model_fields.items()]
