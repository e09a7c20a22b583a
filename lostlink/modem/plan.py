"""From what a user asks for to the link: a radio and distances, or two nodes of a recorded run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bridge.modem.radio_link import LinkPlan
from bridge.modem.tracks import DISTANCE_MAX_M, Sample, Track, apart_over_time, read_distances
from bridge.record.tables.truth import ATTITUDE, POSITION, TrueStates
from bridge.scenario.model import Scenario
from bridge.scenario.modems import GroundModem, UaModem
from bridge.scenario.nodes import MAIN
from bridge.scenario.resolve.radio import radios_of
from channel.link.radio import Radio
from channel.presets import load_radio, overrides_from_settings
from lostlink.reading.run import load_run

DEFAULT_RADIO, DEFAULT_DISTANCE_M = "sik-433", 100.0
PREFIX = "radio."
HEIGHT_MAX_M = 1e6
SEEDS = 1 << 63
"""As many as scenarios have."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A link between two ends that are a distance apart.

    Attributes:
        radio: a preset's name, or a file.
        settings: texts KEY=VALUE, as of ``--set``: ``radio.base_loss=0.1``.
        distance_m: over the ground.
        distances: in its place a CSV file with the columns ``time_s`` and ``distance_m``, or such rows.
        heights_m: of the ground station and of the UA; the radio's default unless given.
        seed: of all that is drawn.
        baud: of both serial lines; the modem's default unless given.
    """

    radio: str = DEFAULT_RADIO
    settings: tuple[str, ...] = ()
    distance_m: float = DEFAULT_DISTANCE_M
    distances: Path | Sequence[tuple[float, float]] | None = None
    heights_m: tuple[float, float] | None = None
    seed: int = 1
    baud: int | None = None


def plan_of(asked: Asked) -> LinkPlan:
    """The link.

    Raises:
        ValueError: a radio, key, value, height or distance that cannot be; the text says which.
        OSError: a file cannot be read.
    """
    config = load_radio(asked.radio, overrides_from_settings(_of_radio(text) for text in asked.settings))
    heights_m = asked.heights_m or (config.default_height_m, config.default_height_m)
    if not all(0.0 <= height_m <= HEIGHT_MAX_M for height_m in heights_m):
        raise ValueError(
            f"heights {heights_m[0]:g} and {heights_m[1]:g} m: from 0 to {HEIGHT_MAX_M:g} m above the ground"
        )
    if not 0.0 <= asked.distance_m <= DISTANCE_MAX_M:
        raise ValueError(f"a distance of {asked.distance_m:g} m: from 0 to {DISTANCE_MAX_M:g} m")
    if not 0 <= asked.seed < SEEDS:
        raise ValueError(f"seed {asked.seed}: from 0 to {SEEDS - 1}")
    rows: Sequence[tuple[float, float]] = [(0.0, asked.distance_m)]
    if asked.distances is not None:
        rows = read_distances(asked.distances) if isinstance(asked.distances, Path) else asked.distances
    radio = Radio(config)
    return LinkPlan((radio, radio), apart_over_time(rows, heights_m), asked.seed, (asked.baud, asked.baud))


def _of_radio(text: str) -> str:
    if not text.startswith(PREFIX):
        raise ValueError(f"--set {text}: only the radio can be changed here, as in {PREFIX}base_loss=0.1")
    return text.removeprefix(PREFIX)


def plan_of_run(
    run: Path, nodes: Sequence[str] | None = None, baud: int | None = None, network: str | None = None
) -> LinkPlan:
    """The link between two nodes of a recorded run: their radios, their places over time, its seed.

    Args:
        run: its directory, or its name in `runs/`.
        nodes: ids, that of the ground station first; see `ends_of`.
        baud: of both serial lines; that of the node's modem in the run unless given, else the modem's default.
        network: the radio network that they are on; see `ends_of`.

    Raises:
        ValueError: it is no run, or has no such nodes or network.
        OSError: its record cannot be read.
    """
    recorded = load_run(run)
    scenario = recorded.scenario
    network, (ground, air) = ends_of(scenario, nodes, network)
    radios = radios_of(scenario, network=network)
    truth = TrueStates.read(recorded.path, recorded.nodes, (*POSITION, *ATTITUDE))
    tracks = tuple(_track(truth, recorded.nodes.index(node)) for node in (ground, air))
    bases = [node.node for node in scenario.ground if node.node in (ground, air)]
    return LinkPlan(
        (radios[ground], radios[air]),
        (tracks[0], tracks[1]),
        scenario.seed,
        (_baud_of(scenario, network, ground, baud), _baud_of(scenario, network, air, baud)),
        (ground, air),
        bases,
    )


def ends_of(
    scenario: Scenario, nodes: Sequence[str] | None = None, network: str | None = None
) -> tuple[str, tuple[str, str]]:
    """A radio network and two nodes on it.

    What is not given is where modems are: the one network where these nodes (any two) have some, else `main`, and
    there the first ground station and UA with modems, else the first two nodes.

    Raises:
        ValueError: there are no such, or several; the text says which.
    """
    if network is None:
        network = _network_with_modems(scenario, nodes)
    elif network not in scenario.network_names:
        raise ValueError(
            f"the run has no radio network {network}; there are {', '.join(scenario.network_names)}"
        )
    known = [node.node for node in scenario.nodes_on(network)]
    if nodes is None:
        nodes = _first_two(scenario.modems_on(network), known)
    return network, _two(nodes, known, network)


def _network_with_modems(scenario: Scenario, nodes: Sequence[str] | None) -> str:
    """The one where the nodes (any two unless given) have modems; `main` if there is none."""
    found = [
        name
        for name in scenario.network_names
        if len(modems := scenario.modems_on(name)) > 1 and set(nodes or ()) <= set(modems)
    ]
    if len(found) > 1:
        raise ValueError(f"there are modems on {' and '.join(found)}: choose a network with --radio")
    return found[0] if found else MAIN


def _first_two(modems: Mapping[str, UaModem | GroundModem], known: Sequence[str]) -> Sequence[str]:
    """The first ground station and UA with modems, or the first two nodes."""
    ground = [node for node, modem in modems.items() if isinstance(modem, GroundModem)][:1]
    with_modems = [*ground, *(node for node, modem in modems.items() if isinstance(modem, UaModem))]
    return (with_modems if len(with_modems) > 1 else known)[:2]


def _baud_of(scenario: Scenario, network: str, node: str, baud: int | None) -> int | None:
    modem = scenario.modems_on(network).get(node)
    return modem.baud if baud is None and modem is not None else baud


def _two(nodes: Sequence[str], known: Sequence[str], network: str) -> tuple[str, str]:
    for node in nodes:
        if node not in known:
            raise ValueError(
                f"the run has no radio at node {node} on {network}; there are {', '.join(known)}"
            )
    if len(set(nodes)) != 2:
        raise ValueError(f"nodes {','.join(nodes)}: two that differ, as in 0,1")
    return nodes[0], nodes[1]


def _track(truth: TrueStates, node: int) -> Track:
    mine = truth.at(truth.node == node)
    if not mine.sim_time_ns.size:
        raise ValueError(f"the run has no places of node {truth.nodes[node]}")
    rows = np.hstack((mine.position_ned_m, mine.attitude_wxyz)).tolist()
    samples = [
        Sample(at_ns, tuple(row[:3]), tuple(row[3:]))
        for at_ns, row in zip(mine.sim_time_ns.tolist(), rows, strict=True)
    ]
    return Track(samples)
