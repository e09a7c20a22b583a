"""When radios were switched: by the scenario's outages, and by operators, whose commands are among a run's inputs.

A node has one switch, for all its radios: an operator's word holds until the scenario's next one, and the other way
round.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from bridge.bus.radio_command import RADIO, RadioMistake, is_on
from bridge.record.inputs.file import RecordedInput, inputs_of
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN
from channel.medium.stations.switches import Switches


def switches_of(scenario: Scenario, run: Path | None = None, network: str = MAIN) -> Switches:
    """The switches of all nodes on a network, in the order of `Scenario.nodes_on`.

    Args:
        scenario: with its outages.
        run: directory of a recorded run of it, with what operators did; without it there is none of that.
        network: name of a radio network.

    Raises:
        InputError, OSError: the inputs cannot be read.
    """
    nodes = scenario.nodes_on(network)
    switches = Switches(len(nodes))
    for number, node in enumerate(nodes):
        for outage in node.radio_off:
            switches.switch(number, outage.from_ns, on=False)
            if outage.to_ns is not None:
                switches.switch(number, outage.to_ns, on=True)
        for sim_time_ns, on in _commanded(inputs_of(run, node.node)) if run is not None else ():
            switches.switch(number, sim_time_ns, on=on)
    return switches


def _commanded(inputs: Iterable[RecordedInput]) -> Iterator[tuple[int, bool]]:
    """Yield when operators switched the radio, and whether on."""
    for item in inputs:
        if item.verb != RADIO or item.goal is None:
            continue
        try:
            yield item.tick_ns, is_on(item.goal)
        except RadioMistake:  # the node refused it, and its radio stayed as it was
            continue
