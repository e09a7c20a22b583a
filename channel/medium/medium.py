"""The medium: who receives which packet. Takes truth and packets with their sim time, gives fates; no I/O, no clock.

A packet waits until the truth at or after its instant is there for every node, so that its fate depends on the
seed, the positions and its sequence number alone: not on the order of arrival, nor on who else flies. Packets go in
and receptions come out as columns: all that can be settled is settled in one pass.
"""

from __future__ import annotations

import operator
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel.checks import ChannelInputError, FloatArray
from channel.draws import MAX_SEQ, Draws, LinkDraws, check_seed
from channel.link.radio import Radio
from channel.medium.addressees import NO_GROUPS, Addressees
from channel.medium.judge.judge import Judge
from channel.medium.judge.taken import Witness
from channel.medium.reception import EVERYBODY, FATES, NO_PACKETS, Fate, Packets, Receptions
from channel.medium.settling import Settling
from channel.medium.stations.emitter_tracks import EmitterTracks
from channel.medium.stations.partitions import Partition, Partitions
from channel.medium.stations.switches import Switches
from channel.medium.stations.tracks import FOREVER, Snapshot, Tracks, truth_rows

__all__ = ["EVERYBODY", "FATES", "Fate", "Medium", "Packets", "Receptions"]

MAX_TRUTH_AGE_NS = 1_000_000_000
MAX_LENGTH_BYTES = 1 << 24
WHOLE = np.dtype(np.int64)

Which = str | Sequence[str] | NDArray[np.intp]
"""A node's name, or names or indices of several nodes."""


class Medium:
    """One radio channel shared by a fixed set of nodes.

    Args:
        radio: the same at every node, or that of each node by its name; all on one frequency.
        seed: the run's seed.
        nodes: names of all nodes; every other node is an intended receiver of each packet to everybody.
        max_truth_age_ns: how far a node's truth may lag behind the newest before it is used as it is.
        judge: takes in what is drawn, for a verdict in the end.
        emitters: names of the run's emitters, which radios may hear (`Radio.emitters`).
        switches: of the nodes' radios; each is on until it is switched off.
        bases: names of the nodes that stand on the ground; the others are aircraft. For laws that distinguish them.
        ahead_ns: for so long nodes and emitters go on as they last moved beyond their newest truth, for `drawing` (0:
            they stand).
        groups: names of the members of each group of nodes that packets may be for.
        network: name of a further radio network of the run, whose draws are others; "": the run's own.
        partitions: by names of nodes, also of other networks.

    Attributes:
        nodes: their names; columns of packets and receptions name a node by its place here.
        index: of each name.
        radios: of each node.
        addressees: who packets are for.
        emitters: where the emitters are: `emitters.observe` takes in their truth.
        bases: which nodes stand on the ground, shape (nodes,).
        partitions: as given.

    Raises:
        ChannelInputError: names that are not distinct, a node without a radio, radios on several frequencies, a radio
            that hears an emitter of another name, a group that cannot be.
    """

    def __init__(
        self,
        radio: Radio | Mapping[str, Radio],
        *,
        seed: int,
        nodes: Iterable[str],
        max_truth_age_ns: int = MAX_TRUTH_AGE_NS,
        judge: Judge | None = None,
        emitters: Iterable[str] = (),
        switches: Switches | None = None,
        bases: Iterable[str] = (),
        ahead_ns: int = 0,
        groups: Mapping[str, Collection[str]] = NO_GROUPS,
        network: str = "",
        partitions: Sequence[Partition] = (),
    ) -> None:
        self.nodes = tuple(nodes)
        self.index = {node: i for i, node in enumerate(self.nodes)}
        if len(self.index) != len(self.nodes):
            raise ChannelInputError("nodes", self.nodes, "names that differ")
        self.addressees = Addressees(self.nodes, groups)
        self.draws = Draws(check_seed(seed), network)
        self._tracks = Tracks(len(self.nodes), max_truth_age_ns, ahead_ns)
        self.radios = tuple(self._radio_of(node, radio) for node in self.nodes)
        self.emitters = EmitterTracks(emitters, max_truth_age_ns, ahead_ns)
        heard = {each.name for each_radio in self.radios for each in each_radio.emitters}
        if not heard <= set(self.emitters.names):
            raise ChannelInputError("emitters", self.emitters.names, f"with {', '.join(sorted(heard))}")
        self._switches = switches or Switches(len(self.nodes))
        self.partitions, self._partitions = partitions, Partitions(self.nodes, partitions)
        self.bases = self._on_the_ground(bases)
        self._settling = self.drawing(judge=judge, cull=True)
        self._waiting: list[Packets] = []

    def drawing(
        self,
        *,
        judge: Witness | None = None,
        cull: bool = False,
        switched: bool = True,
        bit_rate_bps: float | None = None,
        expects: bool = True,
    ) -> Settling:
        """Return what draws fates at once, where the nodes are by now, for whoever decides when a packet is on the air.

        Args:
            judge: takes in what is drawn.
            cull: whether to leave out draws that cannot change a fate: then weak signals have no power.
            switched: whether radios may be off, and nodes apart; else all are on, and none are.
            bit_rate_bps: at which radios transmit; each at its own unless given.
            expects: whether to say how likely each delivery was; else that is NaN, and takes no time.
        """
        kinds = {radio: radio.at_bit_rate(bit_rate_bps) for radio in self.radios}
        return Settling(
            [kinds[radio] for radio in self.radios],
            LinkDraws(self.draws, self.nodes),
            self._tracks,
            cull=cull,
            judge=judge,
            emitters=self.emitters,
            switches=self._switches if switched else None,
            partitions=self._partitions if switched else None,
            bases=self.bases,
            addressees=self.addressees,
            expects=expects,
        )

    def _on_the_ground(self, bases: Iterable[str]) -> NDArray[np.bool_]:
        out = np.zeros(len(self.nodes), dtype=bool)
        out[[self._index("bases", node) for node in bases]] = True
        return out

    @staticmethod
    def _radio_of(node: str, radio: Radio | Mapping[str, Radio]) -> Radio:
        if isinstance(radio, Radio):
            return radio
        if node not in radio:
            raise ChannelInputError("radio", ", ".join(radio), f"a radio for each node, {node} too")
        return radio[node]

    @property
    def in_flight(self) -> int:
        """Number of fates that are still open, which is packets that wait for truth times their receivers."""
        return sum(int(self.addressees.count(part).sum()) for part in self._waiting)

    def packets(
        self,
        *,
        tx: str | Sequence[str],
        seq: ArrayLike,
        sim_time_ns: ArrayLike = 0,
        length_bytes: ArrayLike = 0,
        to: str | None = None,
    ) -> Packets:
        """Return packets by the names of their nodes, in canonical order; the columns broadcast.

        Args:
            tx: transmitting node, one for all or one each.
            seq: sequence numbers.
            sim_time_ns: when they were sent.
            length_bytes: of their payloads.
            to: the node or the group that all are for; everybody if not given.

        Raises:
            ChannelInputError: an unknown node or group, or a number that is not whole.
        """
        sender = np.asarray(self._indices("tx", tx))
        receiver = EVERYBODY if to is None else self._code(to)
        numbers = {"sim_time_ns": sim_time_ns, "seq": seq, "length_bytes": length_bytes}
        when, number, length = (_whole(name, value) for name, value in numbers.items())
        columns = np.broadcast_arrays(when, sender, number, length, np.intp(receiver))
        return Packets(*(np.atleast_1d(column) for column in columns)).in_order()

    def observe(
        self,
        node: Which,
        sim_time_ns: ArrayLike,
        position_ned_m: ArrayLike,
        attitude_wxyz: ArrayLike | None = None,
    ) -> None:
        """Take in where a node was, or several, in the frame common to all.

        How fast it was follows from this and the position before it.

        Args:
            node: a name, or several nodes, each once: names or indices.
            sim_time_ns: when; of several nodes one for all, or one each.
            position_ned_m: shape (3,), or (nodes, 3).
            attitude_wxyz: body to north-east-down, shape (4,) or (nodes, 4); level with the nose north if not given.

        Raises:
            ChannelInputError: an unknown node, a value that is not finite or a time that is not whole.
        """
        indices = np.atleast_1d(self._indices("node", node))
        rows = np.atleast_2d(truth_rows(position_ned_m, attitude_wxyz))
        if len(rows) != len(indices):
            raise ChannelInputError(
                "position_ned_m", f"{len(rows)} rows", f"{len(indices)}, one for each node"
            )
        self._tracks.observe(indices, _whole("sim_time_ns", sim_time_ns), rows)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which nodes were ever seen, in the order of `nodes`."""
        return self._tracks.known

    def at(self, sim_time_ns: int) -> Snapshot:
        """Return where all nodes were at an instant, in the order of `nodes`, with attitudes and velocities."""
        instants = np.array([sim_time_ns], dtype=np.int64)
        return self._tracks.at(instants, attitude=True, velocity=True)

    def positions_ned_m(self, instants_ns: NDArray[np.int64]) -> FloatArray:
        """Return where all nodes were at rising instants, shape (3, instants, nodes)."""
        return self._tracks.at(instants_ns).position_ned_m.reshape(3, instants_ns.size, len(self.nodes))

    def place(self, node: str, position_ned_m: ArrayLike, attitude_wxyz: ArrayLike | None = None) -> None:
        """Put a node where it stays for the whole run (a ground station): no packet waits for its truth."""
        rows = truth_rows(position_ned_m, attitude_wxyz)
        if rows.ndim != 1:
            raise ChannelInputError("position_ned_m", f"array of shape {rows.shape[:-1]} x 3", "shape (3,)")
        self._tracks.place(self._index("node", node), rows)

    def switch_radio(self, node: str, sim_time_ns: int, *, on: bool) -> None:
        """Switch a node's radio from an instant on, until it is switched again; at first all are on.

        A packet with an end whose radio is off when it is sent is lost with `Fate.RADIO_OFF`. Nothing is drawn for it;
        as every draw has its own counter, and packets do not interfere with each other, nothing else changes. RF
        sensors and emitters have no such switch.

        Raises:
            ChannelInputError: an unknown node, or a time that is not whole.
        """
        when_ns = int(_whole("sim_time_ns", sim_time_ns))
        self._switches.switch(self._index("node", node), when_ns, on=on)

    def radios_off(self, sim_time_ns: int) -> NDArray[np.bool_]:
        """Return which radios are off at an instant, in the order of `nodes`."""
        return self._switches.off_at(sim_time_ns)

    def radio_off(self, node: int, sim_time_ns: int) -> bool:
        """Return whether the radio of a node, by its place in `nodes`, is off at an instant."""
        return self._switches.is_off(node, sim_time_ns)

    def are_apart(self, node: int, other: int, sim_time_ns: int) -> bool:
        """Return whether a partition is between two nodes, by their places in `nodes`, at an instant."""
        return self._partitions.are_apart(node, other, sim_time_ns)

    def send(self, packets: Packets) -> None:
        """Keep packets until they can be settled.

        The same sequence number on the same link always draws the same fate.

        Raises:
            ChannelInputError: a node that is not there, a negative sequence number or length, a packet to its own
                transmitter.
        """
        if not packets.size:
            return
        _check(packets, len(self.nodes), len(self.addressees.groups))
        to_itself = packets.to == packets.tx
        if np.count_nonzero(to_itself):
            node = int(packets.tx[to_itself][0])
            raise ChannelInputError("to", self.nodes[node], "a node other than the transmitter")
        self._waiting.append(packets)

    def settle(self) -> Receptions:
        """Return all fates that are certain by now: of packets up to which the truth of every node is known."""
        if not self._waiting:
            return self._settling.receptions(NO_PACKETS)
        waiting = Packets.joined(self._waiting)
        ready = waiting.sim_time_ns <= self._tracks.frontier_ns()
        if np.count_nonzero(ready) == ready.size:
            self._waiting = []
            return self._settling.receptions(waiting.in_order())
        self._waiting = [waiting.at(~ready)]
        return self._settling.receptions(waiting.at(ready).in_order())

    def flush(self) -> Receptions:
        """Settle everything that still waits, with the newest positions there are."""
        waiting, self._waiting = self._waiting, []
        packets = Packets.joined(waiting).in_order() if waiting else NO_PACKETS
        return self._settling.receptions(packets)

    def counted_bytes(self, packets: Packets) -> NDArray[np.int64]:
        """Return the lengths of packets as the error model counts them, shape (P,)."""
        return self._settling.counted_bytes(packets)

    def _index(self, name: str, node: str) -> int:
        try:
            return self.index[node]
        except KeyError:
            raise ChannelInputError(name, node, f"one of {', '.join(self.nodes)}") from None

    def _code(self, to: str) -> int:
        if to not in self.addressees.codes:
            raise ChannelInputError("to", to, f"one of {', '.join(self.addressees.codes)}")
        return self.addressees.codes[to]

    def _indices(self, name: str, node: Which) -> NDArray[np.intp]:
        if isinstance(node, str):
            return np.array(self._index(name, node), dtype=np.intp)
        if not isinstance(node, np.ndarray):
            return np.array([self._index(name, each) for each in node], dtype=np.intp)
        _within(name, node, 0, len(self.nodes) - 1)
        return node


def _whole(name: str, value: ArrayLike) -> NDArray[np.int64]:
    """Return whole numbers, numpy's or Python's; a float would not name an instant or a packet."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu":
        try:
            array = np.asarray(operator.index(value))  # type: ignore[arg-type]
        except TypeError as error:
            raise ChannelInputError(name, value, "an integer") from error
    if array.dtype.kind == "O" or (array.dtype.kind == "u" and (array > MAX_SEQ).any()):
        raise ChannelInputError(name, value, "an integer of 64 bits")
    return array.astype(np.int64, copy=False)


def _check(packets: Packets, nodes: int, groups: int) -> None:
    """Refuse packets whose columns are not whole numbers in their ranges."""
    columns = np.array(packets)
    if columns.dtype != WHOLE:
        bad = next(name for name in packets._fields if getattr(packets, name).dtype != WHOLE)
        raise ChannelInputError(bad, f"array of {getattr(packets, bad).dtype}", "integers of 64 bits")
    low, high = _ranges(nodes, groups)
    # what is below its range wraps round to large numbers
    above = np.maximum.reduce((columns - low[:, np.newaxis]).view(np.uint64), axis=1)
    outside = above > (high - low).view(np.uint64)
    if outside.any():
        row = int(np.argmax(outside))
        _within(packets._fields[row], packets[row], int(low[row]), int(high[row]))


@lru_cache(maxsize=8)
def _ranges(nodes: int, groups: int) -> NDArray[np.int64]:
    """Return the lowest and the highest value of each column of packets, shape (2, columns)."""
    ranges = {
        "sim_time_ns": (-FOREVER, FOREVER),
        "tx": (0, nodes - 1),
        "seq": (0, MAX_SEQ),
        "length_bytes": (0, MAX_LENGTH_BYTES),
        "to": (EVERYBODY - groups, nodes - 1),
    }
    return np.array([ranges[name] for name in Packets._fields]).T


def _within(name: str, values: NDArray[np.intp], low: int, high: int) -> None:
    """Refuse numbers out of their range."""
    bad = values[(values < low) | (values > high)]
    if bad.size:
        raise ChannelInputError(name, int(bad[0]), f"an integer from {low} to {high}")
