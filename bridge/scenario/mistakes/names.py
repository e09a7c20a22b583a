"""Sees that what a scenario names is there and right: radios, antennas, winds, airframes, places, own agents."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from pydantic import ValidationError

from bridge.scenario.agents import OwnAgent
from bridge.scenario.document.written import Path_, Written
from bridge.scenario.expectations import AgeExpectation, DeliveryExpectation
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.mistakes.explain import explained
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN, Aircraft, EmitterNode, NodeConfig
from bridge.scenario.own.own_class import clash_of, lineage_of, mistake_in, options_read, unread_options
from bridge.scenario.own_measures import FunctionExpectation
from bridge.scenario.resolve.flight import airframe_of, origin_of, wind_of
from bridge.scenario.resolve.radio import config_of, radio_from
from bridge.scenario.resolve.sensing import emitter_of
from channel.access.settings.base import Ideal, Surroundings
from channel.access.settings.medium import rate_mistake
from channel.access.world import PlainWorld
from channel.config import RadioConfig
from channel.draws import Draws
from channel.link.carrier import laws_off_carrier
from channel.link.emitters.disturbance import heard
from channel.link.emitters.emitter import Emitter
from channel.own.methods import OwnModelError
from channel.phy.interference import MAX_PULSED
from channel.presets import PresetError, seen_from
from channel.propagation.air_to_ground import RmaAv, UmaAv
from channel.routing.settings import router_of
from channel.validity import OUTSIDE_KEY
from channel.variant import name_of
from fdm.air.wind import WindConfig
from fdm.errors import AirframeError, WeatherError, WindError
from fdm.model.geodesy import geodetic_from_ned
from sitl_configs.near import near_miss

NONE_OWN: Final[Mapping[str, RadioConfig]] = MappingProxyType({})
"""Radios of single nodes: there are none."""


def with_known_names(root: Written, scenario: Scenario) -> Scenario:
    """The scenario with the tables of its radios read in.

    Args:
        root: where it was written; files are by absolute path.
        scenario: the same, validated.

    Raises:
        ScenarioError: with one line per name that is not known, or file that is wrong.
    """
    radios = _Radios(root, scenario)
    scenario = radios.scenario()
    mistakes = [
        *radios.mistakes,
        *_winds(root, scenario),
        *_airframes(root, scenario),
        *_places(root, scenario),
        *_classes(root, scenario),
        *_expected(root, scenario),
    ]
    if mistakes:
        raise ScenarioError("\n".join(dict.fromkeys(mistakes)))
    return scenario


def _told(root: Written, path: Path_, problem: object) -> str:
    """A mistake at the place of a key."""
    return f"{root.at(path).place}: {root.dotted(path)}: {problem}"


def _told_of_file(root: Written, path: Path_, file: object, problem: str) -> str:
    """A mistake in a file that a key names: its own place counts, and who named it comes after."""
    if not problem.startswith(f"{file}:"):
        return _told(root, path, problem)
    named = f" (named at {root.at(path).place}: {root.dotted(path)})"
    return "\n".join(line + named for line in problem.splitlines())


class _Radios:
    """The radio for all, those of single nodes and sensors, and emitters' antennas: built, to see that they can be."""

    def __init__(self, root: Written, scenario: Scenario) -> None:
        self._root, self._scenario = root, scenario
        self.mistakes: list[str] = []
        self._built: dict[str, tuple[Any, RadioConfig | None]] = {}

    def scenario(self) -> Scenario:
        """The scenario with the tables of its radios read in."""
        common, config = self._read(self._scenario.radio, ("radio",))
        self._see_roles(("radio",), config, [n.node for n in self._scenario.transceivers if n.radio is None])
        self._see_pulsed(("radio",), config)
        nodes: list[NodeConfig] = []
        own_radios: dict[str, RadioConfig] = {}
        for index, node in enumerate(self._scenario.nodes):
            if isinstance(node, EmitterNode):
                nodes.append(self._with_antenna(node, ("nodes", index)))
                continue
            if node.sensor is not None:
                radio, _ = self._read(node.sensor.radio, ("nodes", index, "sensor", "radio"))
                node = node.model_copy(update={"sensor": node.sensor.model_copy(update={"radio": radio})})
            if node.radio is not None:
                path = ("nodes", index, "radio")
                radio, own = self._read(node.radio, path)
                self._see_roles(path, own, [node.node])
                self._see_pulsed(path, own)
                own_radios |= {} if own is None else {node.node: own}
                node = node.model_copy(update={"radio": radio})
                if own is not None and config is not None and own.frequency_hz != config.frequency_hz:
                    run_hz = config.frequency_hz
                    text = f"its frequency is {own.frequency_hz:g} Hz, that of the run's radio {run_hz:g} Hz"
                    self.mistakes.append(_told(self._root, path, f"{text}: all have to be on one"))
                if own is not None and config is not None and own.medium != config.medium:
                    media = f"{name_of(own.medium)}, that of the run's radio {name_of(config.medium)}"
                    text = f"its medium is {media}, or has other settings: nodes that share a channel share its medium"
                    self.mistakes.append(_told(self._root, path, text))
                if own is not None and config is not None and own.routing != config.routing:
                    ways = f"{name_of(own.routing)}, that of the run's radio {name_of(config.routing)}"
                    text = f"its routing is {ways}, or has other settings: nodes of a network have one way of routing"
                    self.mistakes.append(_told(self._root, path, text))
            nodes.append(node)
        self._see_rates(config, own_radios)
        self._see_medium(("radio",), config, self._scenario.transceiver_ids, own_radios)
        self._see_modems(MAIN, config)
        changes = {"radio": common, "networks": self._networks(), "nodes": tuple(nodes)}
        return self._scenario.model_copy(update=changes)

    def _networks(self) -> dict[str, Any]:
        """The radios of the further networks with their tables read in."""
        networks = {}
        for name, setting in self._scenario.networks.items():
            networks[name], config = self._read(setting, ("networks", name))
            nodes = [node.node for node in self._scenario.nodes_on(name)]
            self._see_roles(("networks", name), config, nodes)
            self._see_pulsed(("networks", name), config)
            self._see_medium(("networks", name), config, nodes)
            self._see_modems(name, config)
        return networks

    def _see_modems(self, network: str, config: RadioConfig | None) -> None:
        """Refuse modems at radios on which packets take no time."""
        if config is None or not isinstance(config.medium, Ideal):
            return
        for index, node in enumerate(self._scenario.nodes):
            if not isinstance(node, EmitterNode) and network in node.modems:
                text = f"packets of {config.name} take no time (medium: ideal): a modem needs a radio like sik-433"
                self.mistakes.append(_told(self._root, ("nodes", index, "modems", network), text))

    def _see_rates(self, config: RadioConfig | None, own: Mapping[str, RadioConfig]) -> None:
        """Refuse nodes with other bit rates than the first, on a medium that has one for all."""
        if config is None:
            return
        first_bps = None
        for index, node in enumerate(self._scenario.nodes):
            if isinstance(node, EmitterNode):
                continue
            rate_bps = own.get(node.node, config).bit_rate_bps
            first_bps = rate_bps if first_bps is None else first_bps
            if text := rate_mistake(config.medium, first_bps, rate_bps):
                path: Path_ = ("nodes", index) if node.radio is None else ("nodes", index, "radio")
                self.mistakes.append(_told(self._root, path, text))

    def _see_medium(
        self,
        path: Path_,
        config: RadioConfig | None,
        ids: Sequence[str],
        own: Mapping[str, RadioConfig] = NONE_OWN,
    ) -> None:
        """Refuse a medium, or a way of routing, that cannot be that of these nodes."""
        if config is None or isinstance(config.medium, Ideal):
            return
        nodes = {node: index for index, node in enumerate(ids)}
        world = PlainWorld(tuple(nodes.values()))
        try:
            configs = {node: own.get(node, config) for node in nodes}
            config.medium.open(Surroundings.of(world, nodes, self._scenario.seed, configs, 0.0))
        except ValueError as error:
            self.mistakes.append(_told(self._root, (*path, "medium"), error))
        try:
            router_of(config.routing, nodes, Draws(self._scenario.seed))
        except ValueError as error:
            self.mistakes.append(_told(self._root, (*path, "routing"), error))

    def _see_roles(self, path: Path_, config: RadioConfig | None, senders: list[str]) -> None:
        """Refuse links of a radio that its propagation law knows nothing of."""
        if config is None or not isinstance(config.propagation, RmaAv | UmaAv):
            return
        law = config.propagation
        if law.outside != "refuse":
            return
        uas, grounds = self._scenario.ua, self._scenario.ground
        for what, ids in (("UA", [n.node for n in uas]), ("ground nodes", [n.node for n in grounds])):
            if len(ids) > 1 and not set(ids).isdisjoint(senders):
                text = f"{law.model} has a base on the ground and a UA, and no links between {what}: {', '.join(ids)}"
                self.mistakes.append(_told(self._root, path, f"{text}; {OUTSIDE_KEY}"))

    def _see_pulsed(self, path: Path_, config: RadioConfig | None) -> None:
        """Refuse more emitters in slots than a radio's deliveries can be averaged over."""
        if config is None:
            return
        pulsed = [each.id for each in heard(config, self._scenario.emitters) if 0.0 < each.duty < 1.0]
        own = sum(0.0 < each.duty < 1.0 for each in config.interference.interferers)
        if pulsed and len(pulsed) + own > MAX_PULSED:
            text = f"its receiver hears the emitters {', '.join(pulsed)}" + (
                f" and {own} interferers" if own else ""
            )
            allowed = f"at most {MAX_PULSED} emitters and interferers may have a duty between 0 and 1"
            self.mistakes.append(_told(self._root, path, f"{text}: {allowed}"))

    def _with_antenna(self, emitter: EmitterNode, path: Path_) -> EmitterNode:
        """An emitter with the tables of its antenna read in."""
        try:
            seen = emitter.model_copy(update=seen_from(Path(), {"antenna": emitter.antenna}))
            emitter_of(seen)
        except PresetError as error:
            self.mistakes += [_told(self._root, (*path, "antenna"), each.problem) for each in error.mistakes]
        except ValidationError as error:
            self.mistakes += explained(self._root, error, Emitter, path)
        else:
            return seen
        return emitter

    def _read(
        self, setting: str | dict[str, Any], path: Path_
    ) -> tuple[str | dict[str, Any], RadioConfig | None]:
        """A radio with its tables, as the scenario has it and built; None if it is wrong."""
        key = repr(setting)
        if key not in self._built:
            self._built[key] = self._build(setting, path)
        found: tuple[str | dict[str, Any], RadioConfig | None] = self._built[key]
        return found

    def _build(self, setting: str | dict[str, Any], path: Path_) -> tuple[Any, RadioConfig | None]:
        try:
            seen = setting if isinstance(setting, str) else seen_from(Path(), setting)
            if self._is_off_carrier(config_of(seen), path):
                return setting, None
            return seen, radio_from(seen, self._scenario.origin).config
        except PresetError as error:
            self.mistakes += [self._mistake(path, each) for each in error.mistakes]
        except OwnModelError as error:
            self.mistakes.append(_told(self._root, path, str(error)))
        return setting, None

    def _is_off_carrier(self, config: RadioConfig, path: Path_) -> bool:
        """Refuse laws that would refuse the radio's carrier: with the first packet the run would end."""
        refused = [law for law in laws_off_carrier(config) if law.outside == "refuse"]
        if path[-2:] == ("sensor", "radio"):  # what it measures has carriers of its own
            refused = [law for law in refused if law.key == "noise"]
        for law in refused:
            key = (*path, law.key) if self._root.at(path).is_mapping else path
            self.mistakes.append(_told(self._root, key, f"{law.told}: {law.remedy}"))
        return bool(refused)

    def _mistake(self, path: Path_, error: PresetError) -> str:
        if error.file is not None:
            return _told_of_file(self._root, path, error.file, error.line_told)
        key = tuple(step for step in error.key.split(".") if step)
        if self._root.at(path).is_mapping or key != ("preset",):
            path = (*path, *key)
        return _told(self._root, path, error.problem)


def _winds(root: Written, scenario: Scenario) -> Iterator[str]:
    wind = scenario.wind
    try:
        of_map = wind_of(scenario).map
        if of_map is not None and not of_map.file.is_file():
            text = f"there is no file {of_map.file}"
            if isinstance(wind, str):
                yield _told_of_file(root, ("wind",), wind, f"{wind}: map.file: {text}")
            else:
                yield _told(root, ("wind", "map", "file"), text)
    except WindError as error:
        file = wind if isinstance(wind, str) else wind.get("preset")
        path = ("wind",) if isinstance(wind, str) else ("wind", "preset")
        yield _told_of_file(root, path, file, str(error).removeprefix("preset: "))
    except ValidationError as error:
        yield from explained(root, error, WindConfig, ("wind",))


def _airframes(root: Written, scenario: Scenario) -> Iterator[str]:
    wrong: dict[str, str] = {}
    seen: set[str] = set()
    for index, node in enumerate(scenario.nodes):
        if not isinstance(node, Aircraft):
            continue
        if node.airframe not in seen:
            seen.add(node.airframe)
            try:
                airframe_of(node)
            except AirframeError as error:
                wrong[node.airframe] = str(error)
        if node.airframe in wrong:
            yield _told_of_file(root, ("nodes", index, "airframe"), node.airframe, wrong[node.airframe])


def _places(root: Written, scenario: Scenario) -> Iterator[str]:
    origin = origin_of(scenario.origin)
    try:
        scenario.weather.check(origin.alt_amsl_m)
    except WeatherError as error:
        yield _told(root, ("origin", "alt_amsl_m"), error)
    for index, node in enumerate(scenario.nodes):
        for path, north_m in _norths(node):
            try:
                geodetic_from_ned(origin, (north_m, 0.0, 0.0))
            except ValueError:
                text = f"{north_m:g} m north of the origin, at {origin.lat_deg:g} degrees, is beyond a pole"
                yield _told(root, ("nodes", index, *path, "north_m"), text)


def _norths(node: NodeConfig) -> Iterator[tuple[Path_, float]]:
    """How far north a node is placed, with the key of each place."""
    if isinstance(node, Aircraft):
        yield ("home",), node.home.north_m
        return
    if node.place is not None:
        yield ("place",), node.place.north_m
    for index, point in enumerate(node.track):
        yield ("track", index), point.north_m


def _classes(root: Written, scenario: Scenario) -> Iterator[str]:
    own = [
        (index, node.agent)
        for index, node in enumerate(scenario.nodes)
        if not isinstance(node, EmitterNode) and isinstance(node.agent, OwnAgent)
    ]
    for index, agent in own:
        if mistake := mistake_in(agent.place, agent.class_name):
            yield _told(root, ("nodes", index, "agent", "class"), mistake)
        else:
            yield from _unread_options(root, index, agent)
    if clash := clash_of([agent.place for _, agent in own]):
        yield _told(root, ("nodes",), clash)


def _unread_options(root: Written, index: int, agent: OwnAgent) -> Iterator[str]:
    unread = unread_options(agent.place, agent.options)
    if not unread:
        return
    files, is_plain = lineage_of(agent.place, agent.class_name)
    known = options_read(files)
    for option in unread:
        near = near_miss(option, known)
        if near or is_plain:
            problem = f"{Path(agent.place).name} does not read it{near}"
            yield _told(root, ("nodes", index, "agent", "options", option), problem)


def _expected(root: Written, scenario: Scenario) -> Iterator[str]:
    for index, expectation in enumerate(scenario.expectations):
        known = scenario.stations if expectation.may_name_emitters else scenario.transceiver_ids
        for key, ids in expectation.nodes.items():
            for node_id in ids:
                if node_id in known:
                    continue
                text = (
                    f"no node has the id {node_id}{near_miss(node_id, known)}; there are: {', '.join(known)}"
                )
                if node_id in scenario.stations:
                    text = f"{node_id} is an emitter: it exchanges no packets, and has no agent"
                yield _told(root, ("expectations", index, key), text)
        if isinstance(expectation, DeliveryExpectation | AgeExpectation) and expectation.radio is not None:
            yield from _unheard(root, scenario, index, expectation, expectation.radio)
        if isinstance(expectation, FunctionExpectation):
            mistake = mistake_in(expectation.place, expectation.function_name, "function")
            if mistake:
                yield _told(root, ("expectations", index, "function"), mistake)


def _unheard(
    root: Written,
    scenario: Scenario,
    index: int,
    expectation: DeliveryExpectation | AgeExpectation,
    radio: str,
) -> Iterator[str]:
    """A radio network that is not there, or on which a node is not that the expectation names."""
    known = scenario.network_names
    if radio not in known:
        text = (
            f"no radio network has the name {radio}{near_miss(radio, known)}; there are: {', '.join(known)}"
        )
        yield _told(root, ("expectations", index, "radio"), text)
        return
    on_it = [node.node for node in scenario.nodes_on(radio)]
    for key, ids in expectation.nodes.items():
        for node_id in ids:
            if node_id in scenario.transceiver_ids and node_id not in on_it:
                text = f"{node_id} has no radio on the network {radio}; there are: {', '.join(on_it)}"
                yield _told(root, ("expectations", index, key), text)
