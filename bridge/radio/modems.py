"""The modems of a run: serial bytes of nodes in, packets of these nodes on the air, serial bytes of others out.

Modems live beside the media, step by step: a modem's buffer and its RADIO_STATUS depend on what waits in its radio at
exact instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import partial
from math import inf
from typing import Final

from bridge.bus.keys import ALL
from bridge.modem.heard import HeardWorld, RadioMeter
from bridge.modem.modem import Modem
from bridge.modem.network import ModemNetwork, OnAir
from bridge.modem.settings import counts_foreign, handling_of, has_transmitter, measures, modem_of, peers_of
from bridge.radio.senders import TxPacket
from bridge.radio.serial_output import SerialOutput
from bridge.scenario.model import Scenario
from bridge.scenario.modems import addressee_of
from bridge.scenario.resolve.channel import RadioChannel
from channel.access.packets import AirPacket
from channel.access.world import World
from channel.medium.medium import Medium
from channel.medium.reception import EVERYBODY
from channel.network.entry import FIRST_EXACT
from channel.network.fates import cause_of
from channel.network.link_world import LinkWorld
from channel.network.network import Network

CHANNEL: Final = "mavlink"
"""Of packets that modems send: last part of their address."""


class Meters:
    """What the radios of a network's nodes measure, for the modems there: a watch of a channel."""

    def __init__(self) -> None:
        self._world: HeardWorld | None = None

    def __call__(self, medium: Medium, links: LinkWorld) -> World:
        """Look on at a world, if modems there tell what they measure."""
        settings = medium.radios[0].config.medium
        if not measures(settings):
            return links
        floors_dbm = {node: radio.noise_floor_dbm for node, radio in enumerate(medium.radios)}
        peers = peers_of(settings, medium.nodes)
        self._world = HeardWorld(links, floors_dbm, peers, counts_foreign=counts_foreign(settings))
        return self._world

    def of(self, node: int) -> RadioMeter:
        """What a node's radio measures; of a network at which nobody looks on, nothing."""
        return RadioMeter() if self._world is None else self._world.heard[node]


class NetworkModems:
    """The modems of one network.

    Args:
        scenario: of the run.
        channel: the network.
        place: of the network among those of the run.
        meters: that look on at it.
    """

    def __init__(self, scenario: Scenario, channel: RadioChannel, place: int, meters: Meters) -> None:
        assert channel.network is not None, "modems are on media that take time"
        self.network: Network = channel.network
        self.network.access.foresees_nothing()  # it is run in many small steps
        self._name, self._place = channel.name, place
        nodes = channel.medium.nodes
        self.index = {node: scenario.transceiver_ids.index(node) for node in nodes}
        self._places = [self.index[node] for node in nodes]
        self._settings = settings = channel.medium.radios[0].config.medium
        modems, configs = {}, scenario.modems_on(channel.name)
        self._addressees = {channel.medium.index[node]: addressee_of(configs, node) for node in configs}
        for node, config in configs.items():
            number = channel.medium.index[node]
            is_transmitter = has_transmitter(settings, nodes, node)
            modem = modem_of(settings, config.baud, is_transmitter=is_transmitter)
            waiting_bytes = partial(self.network.access.waiting_bytes, number)
            modems[number] = Modem(modem, meters.of(number), waiting_bytes)
        self.modems = ModemNetwork(modems, self._offer, partial(cause_of, world=self.network.world))
        self._number_of = {node: channel.medium.index[node] for node in nodes}
        self._next_seq = dict.fromkeys(modems, FIRST_EXACT * (place + 1))
        self._sent: list[TxPacket] = []

    def receive(self, node: str, data: bytes, at_ns: int) -> None:
        """The host of a node's modem sends bytes from an instant on, and by the node's phase later.

        Autopilots that boot at one instant would else speak at the same instants for ever.
        """
        number = self._number_of[node]
        self.modems.modems[number].receive(data, at_ns + self.network.phases_ns[number])

    def has(self, node: str) -> bool:
        """Whether a node has a modem on it."""
        return self._number_of.get(node) in self.modems.modems

    @property
    def next_ns(self) -> float:
        """When something may happen next."""
        return self.modems.next_ns(self.network.access.agenda.next_ns)

    def step(self, now_ns: int) -> None:
        """Let happen what happens at an instant."""
        self.modems.step(now_ns, self.network.advance(now_ns))

    def counts(self) -> dict[str, dict[str, int]]:
        """What each modem counted, by id of its node."""
        found: dict[str, dict[str, int]] = {}
        for node, number in self._number_of.items():
            if number in self.modems.modems:
                counts = self.modems.modems[number].counts
                plain = {each.name: getattr(counts, each.name) for each in fields(counts)}
                lost = plain.pop("units_lost")
                found[node] = plain | {f"units_lost.{cause.value}": count for cause, count in lost.items()}
        return found

    def sent(self) -> list[TxPacket]:
        """What modems have given to their radios since the last call, in canonical order."""
        sent, self._sent = self._sent, []
        return sorted(sent, key=lambda packet: (packet.sim_time_ns, packet.tx, packet.seq))

    def outputs(self, until_ns: int) -> list[SerialOutput]:
        """What has come out at hosts by an instant."""
        return [
            SerialOutput(self._places[end], at_ns, data, self._place)
            for end, (at_ns, data) in self.modems.outputs(until_ns)
        ]

    def _offer(self, node: int, data: bytes, now_ns: int) -> OnAir:
        seq = self._next_seq[node]
        self._next_seq[node] += 1
        addressee, handling = self._addressees[node], handling_of(self._settings, data)
        route = f"{self._name}/{addressee or ALL}/{CHANNEL}"
        tx, to = self._places[node], EVERYBODY if addressee is None else self.index[addressee]
        self._sent.append(TxPacket(seq, now_ns, route, data, "", handling, tx=tx, to=to, network=self._place))
        receiver = None if addressee is None else self._number_of[addressee]
        return OnAir(seq, self.network.enter(AirPacket(node, seq, receiver, len(data), now_ns, *handling)))


class ModemsOfRun:
    """All modems of a run.

    Args:
        networks: those with modems, by name.
        latency_ns: between the instant at which bytes were taken from a host, and their way over the serial line.
    """

    def __init__(self, networks: dict[str, NetworkModems], latency_ns: int) -> None:
        self.networks = networks
        self._latency_ns = latency_ns

    @classmethod
    def of(
        cls, scenario: Scenario, channels: Sequence[RadioChannel], meters: dict[str, Meters]
    ) -> ModemsOfRun | None:
        """Those of a scenario; None if it has none.

        What hosts say at exchanges between two ticks comes to the radio with the later tick. So that bytes keep their
        distances they are all as late as the first of these are.
        """
        networks = {
            channel.name: NetworkModems(scenario, channel, place, meters[channel.name])
            for place, channel in enumerate(channels)
            if scenario.modems_on(channel.name)
        }
        latency_ns = scenario.tick_period_ns - scenario.exchange_period_ns
        return cls(networks, latency_ns) if networks else None

    def receive(self, node: str, radio: str, data: bytes, sim_time_ns: int) -> None:
        """Bytes that the host of a node's modem had sent when the fleet was held.

        Raises:
            KeyError: the node has no such modem.
        """
        self.networks[radio].receive(node, data, sim_time_ns + self._latency_ns)

    def live(self, until_ns: int) -> list[SerialOutput]:
        """Let all networks with modems live until just before an instant; what has come out at hosts."""
        networks = tuple(self.networks.values())
        while True:
            at_ns = min((each.next_ns for each in networks), default=inf)
            if at_ns >= until_ns:
                break
            for each in networks:
                each.modems.listen(int(at_ns) - 1)
            for each in networks:
                each.step(int(at_ns))
        for each in networks:
            each.modems.listen(until_ns - 1)
        outputs = [output for each in networks for output in each.outputs(until_ns - 1)]
        return sorted(outputs, key=lambda output: (output.at_ns, output.node, output.network))

    def counters(self) -> dict[str, int]:
        """What each modem counted, by name of the network and id of the node; zeros are left out."""
        found: dict[str, int] = {}
        for name, network in self.networks.items():
            for node, counts in network.counts().items():
                found |= {f"modem.{name}.{node}.{what}": count for what, count in counts.items() if count}
        return found

    def sent(self) -> dict[str, list[TxPacket]]:
        """What modems have given to their radios since the last call, by network."""
        return {name: each.sent() for name, each in self.networks.items()}


def watches_of(scenario: Scenario, names: Sequence[str]) -> dict[str, Meters]:
    """Whoever looks on at networks that modems are on."""
    return {name: Meters() for name in names if scenario.modems_on(name)}
