"""How strong the transmitters of one radio network are at the receivers of another."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from channel.access.packets import AirFrame
from channel.access.reception.carriers import Carriers
from channel.access.timing import NS_PER_S
from channel.access.world import Arrival
from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.draws import LinkDraws, Purpose, uniform_from_words
from channel.fading.bursts import NoBursts
from channel.link.radio import Radio
from channel.medium.links import Indices, LinksOfPass
from channel.medium.medium import Medium
from channel.medium.random_terms import RandomTerms
from channel.medium.reception import EVERYBODY, Packets
from channel.medium.stations.partitions import Partitions
from channel.network.drawn import HEARD_DB
from channel.numbers.units import SPEED_OF_LIGHT_MPS, ratio_from_db
from channel.phy.interference import Interference
from channel.phy.spectrum import captured_db, reaches


class NetworkSide(NamedTuple):
    """A network as others meet it.

    Attributes:
        name: of the network.
        medium: where its nodes are, and their radios.
        carriers: on which it is on the air.
    """

    name: str
    medium: Medium
    carriers: Carriers

    def carriers_hz(self, config: RadioConfig) -> Sequence[float]:
        """All on which one of its radios is."""
        return [config.frequency_hz + self.carriers.offset_hz(channel) for channel in self.carriers.channels]


class Crossing:
    """The ways from the nodes of one network to those of another.

    A foreign frame is received by the laws of the network that it disturbs: its propagation, shadowing, fading, range,
    antennas and filters. Random terms are drawn with the frame's number on ways of their own. Between the radios of
    one node there is an isolation in place of a way.

    Args:
        source: whose frames.
        target: at whose nodes.
    """

    def __init__(self, source: NetworkSide, target: NetworkSide) -> None:
        self._source, self._target = source, target
        here, there = source.medium, target.medium
        self._tx_kinds, self._tx_kind = _kinds(here.radios)
        self._rx_kinds, self._rx_kind = _kinds(there.radios)
        self._rows = [np.flatnonzero(self._rx_kind == kind) for kind in range(len(self._rx_kinds))]
        self._floor_dbm = np.array([radio.noise_floor_dbm for radio in there.radios])
        names = (*there.nodes, *(f"{source.name}/{node}" for node in here.nodes))
        self._draws = LinkDraws(there.draws, names)
        self._partitions = Partitions((*there.nodes, *here.nodes), there.partitions)
        self._law = cache(self._law_of)
        self._share = cache(self._share_of)

    @property
    def carries(self) -> bool:
        """Whether any emission of the source comes as near to a receiver as the last row of its filter."""
        return any(
            reaches(emitted_hz - tuned_hz, tx.bandwidth_hz, _filter_of(rx))
            for tx in self._tx_kinds
            for rx in self._rx_kinds
            for emitted_hz in self._source.carriers_hz(tx)
            for tuned_hz in self._target.carriers_hz(rx)
        )

    def share(self, tx: int, tx_channel: int, rx: int, rx_channel: int) -> float:
        """Of the power of a transmitter on a channel, what passes the filter of a receiver on another network's."""
        kinds = int(self._tx_kind[tx]), int(self._rx_kind[rx])
        return self._share(*kinds, tx_channel, rx_channel)

    def _share_of(self, tx_kind: int, rx_kind: int, tx_channel: int, rx_channel: int) -> float:
        tx, rx = self._tx_kinds[tx_kind], self._rx_kinds[rx_kind]
        emitted_hz = tx.frequency_hz + self._source.carriers.offset_hz(tx_channel)
        offset_hz = emitted_hz - rx.frequency_hz - self._target.carriers.offset_hz(rx_channel)
        rows = _filter_of(rx)
        if not reaches(offset_hz, tx.bandwidth_hz, rows):
            return 0.0
        return float(ratio_from_db(captured_db(offset_hz, tx.bandwidth_hz, rows)))

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """Where a frame of the source that starts now comes in, with its power before the receiver's filter."""
        here, at_ns = self._source.medium, frame.started_ns
        if here.radio_off(frame.node, at_ns) or not here.known[frame.node]:
            return ()
        power_dbm, distance_m = self._powers_dbm(frame)
        rows = np.flatnonzero(power_dbm >= self._floor_dbm + HEARD_DB)
        power_mw = np.asarray(ratio_from_db(power_dbm[rows])).tolist()
        delay_ns = np.rint(distance_m[rows] * (NS_PER_S / SPEED_OF_LIGHT_MPS)).astype(int).tolist()
        return [Arrival(*each) for each in zip(rows.tolist(), power_mw, delay_ns, strict=True)]

    def _powers_dbm(self, frame: AirFrame) -> tuple[FloatArray, FloatArray]:
        """Power at all nodes of the target, and how far they are."""
        links = self._links(frame)
        kind = int(self._tx_kind[frame.node])
        power_dbm = np.full(links.rx.size, -np.inf)
        for number, rows in enumerate(self._rows):
            power_dbm[rows] = self._law(kind, number).power_dbm(links.at(rows))
        power_dbm[~self._target.medium.known] = -np.inf
        power_dbm[self._partitions.between(links.tx, links.rx, frame.started_ns)] = -np.inf
        distance_m = links.distance_m
        there = self._target.medium
        own = there.index.get(self._source.medium.nodes[frame.node])
        if own is not None:
            isolation_db = there.radios[own].config.interference.isolation_db
            power_dbm[own] = self._tx_kinds[kind].transmit_power_dbm - isolation_db
            distance_m = distance_m.copy()
            distance_m[own] = 0.0
        return power_dbm, distance_m

    def _law_of(self, tx_kind: int, rx_kind: int) -> CrossingLaw:
        return CrossingLaw(self._tx_kinds[tx_kind], self._rx_kinds[rx_kind], self._draws, self._source.name)

    def _links(self, frame: AirFrame) -> LinksOfPass:
        """From the transmitter of a frame to all nodes of the target, where they are when it starts."""
        here, there = (each.medium.at(frame.started_ns) for each in (self._source, self._target))
        count = len(self._target.medium.nodes)
        tx = np.full(count, count + frame.node, dtype=np.intp)
        start, end = _column(here.position_ned_m, frame.node, count), there.position_ned_m.T
        distance_m = np.sqrt(np.sum(np.square(end - start), axis=-1))
        bases = self._source.medium.bases[frame.node], self._target.medium.bases
        path = self._target.medium.radios[0].paths.of(
            start,
            end,
            distance_m,
            *_both(here.attitude_wxyz, there.attitude_wxyz, frame.node),
            self._tx_kinds[int(self._tx_kind[frame.node])].frequency_hz,
        )
        path = path._replace(tx_is_base=np.full(count, bases[0]), rx_is_base=bases[1])
        speeds = _both(here.velocity_ned_mps, there.velocity_ned_mps, frame.node)
        packet = np.zeros(count, dtype=np.intp)
        return LinksOfPass(_as_packet(frame, tx[0]), packet, tx, np.arange(count), path, distance_m, *speeds)


class CrossingLaw:
    """The way from one kind of foreign transmitter to one kind of receiver.

    Args:
        sender: the transmitter's radio: its power, antenna and cable.
        receiver: the receiver's, with all else.
        draws: of the ways.
        source: name of the transmitter's network.
    """

    def __init__(self, sender: RadioConfig, receiver: RadioConfig, draws: LinkDraws, source: str) -> None:
        ends = {
            "name": f"{sender.name} at {receiver.name}",
            "transmit_power_dbm": sender.transmit_power_dbm,
            "antenna": sender.antenna,
            "cable_loss_db": sender.cable_loss_db,
            "receive_antenna": receiver.receiving_antenna,
            "receive_cable_loss_db": receiver.receiving_cable_loss_db,
        }
        nothing_else = {"interference": Interference(), "bursts": NoBursts(), "base_loss": 0.0}
        self._radio = Radio(receiver.model_copy(update=ends | nothing_else))
        self._terms, self._draws, self._stream = RandomTerms(self._radio, draws), draws, ("foreign", source)

    def power_dbm(self, links: LinksOfPass) -> FloatArray:
        """At receivers, before their filters; -inf beyond the range."""
        least_m = self._radio.config.min_distance_m
        path = links.path._replace(distance_m=np.maximum(links.distance_m, least_m))
        links = links._replace(path=path)
        power_dbm = self._radio.mean_power_dbm(path) + self._terms.gain_db(links, self._uniforms(links))
        return np.where(self._radio.in_range(links.distance_m), power_dbm, -np.inf)

    def _uniforms(self, links: LinksOfPass) -> dict[Purpose, FloatArray]:
        purposes = self._terms.purposes[1:]
        if not purposes:
            return {}
        words = self._draws.words(self._stream, links.tx, links.rx, links.seq)
        return {each: uniform_from_words(words[each.word]) for each in purposes}


def _filter_of(config: RadioConfig) -> Sequence[tuple[float, float]]:
    return config.interference.filter_rows(config.bandwidth_hz)


def _kinds(radios: Sequence[Radio]) -> tuple[list[RadioConfig], Indices]:
    """The radios that differ, and which of them each node has."""
    kinds: list[RadioConfig] = []
    for radio in radios:
        if radio.config not in kinds:
            kinds.append(radio.config)
    return kinds, np.array([kinds.index(radio.config) for radio in radios], dtype=np.intp)


def _column(columns: FloatArray, node: int, count: int) -> FloatArray:
    """What a snapshot says of one node, for each of many links."""
    return np.broadcast_to(columns[:, node], (count, len(columns)))


def _both(
    here: FloatArray | None, there: FloatArray | None, node: int
) -> tuple[FloatArray | None, FloatArray | None]:
    """What snapshots say of one node of one network, and of all of another."""
    if here is None or there is None:
        return None, None
    return _column(here, node, there.shape[1]), there.T


def _as_packet(frame: AirFrame, tx: int) -> Packets:
    columns = frame.started_ns, tx, frame.number, frame.length_bytes, EVERYBODY
    return Packets(*(np.array([each]) for each in columns))
