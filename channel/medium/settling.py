"""The fates of one packet at all its receivers, by arrays over these: one receiver is an array of length 1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import Draws, Purpose, Table
from channel.fading.shadowing import standard_normal_from_uniform
from channel.geometry import LEVEL_WXYZ, Path
from channel.link.decision import signal_of
from channel.link.radio import Radio
from channel.link.steps import STEPS_PER_ONE, in_steps
from channel.medium.random_terms import RandomTerms
from channel.medium.reception import Fate, Packet, Reception
from channel.medium.tracks import ATTITUDE, COLUMNS, POSITION, Tracks

_FATES = (Fate.DELIVERED, Fate.CHANNEL_ERASURE)


class _Links:
    """What is known ahead of the links from one transmitter: names, places in the arrays, draws to come."""

    def __init__(self, radio: Radio, draws: Draws, nodes: Sequence[str], tx: int) -> None:
        config = radio.config
        self.tx = nodes[tx]
        self.receivers = tuple(node for i, node in enumerate(nodes) if i != tx)
        self.indices = [i for i in range(len(nodes)) if i != tx]
        self.columns: NDArray[np.intp] = np.array(self.indices, dtype=np.intp)
        fan = draws.fan(self.tx, self.receivers)
        self.erasure = fan.uniforms(Purpose.ERASURE)
        self.base_loss = fan.uniforms(Purpose.BASE_LOSS) if config.base_loss > 0.0 else None
        self.senders = np.full_like(self.columns, tx)
        self.bursts = fan.uniforms(Purpose.BURST) if config.bursts.mean_loss > 0.0 else None
        self.shadowing: Table | None = None
        if config.shadowing.is_random and config.shadowing.decorrelation_m is None:
            self.shadowing = fan.derived(Purpose.SHADOWING, standard_normal_from_uniform)
        self.fading: tuple[Table, Table] | None = None
        if config.fading.is_random and config.fading.coherence == "packet":
            self.fading = fan.uniforms(Purpose.FADING_I), fan.uniforms(Purpose.FADING_Q)


class Settling:
    """Draws fates for one radio channel.

    Args:
        radio: the same at every node.
        draws: the run's draws.
        nodes: names of all nodes.
        tracks: where they are.
    """

    def __init__(self, radio: Radio, draws: Draws, nodes: Sequence[str], tracks: Tracks) -> None:
        config = radio.config
        self._radio = radio
        self._config = config
        self._tracks = tracks
        self._terms = RandomTerms(radio, draws, nodes)
        self._links = [_Links(radio, draws, nodes, tx) for tx in range(len(nodes))]
        self._has_range = math.isfinite(radio.max_range_m)
        self._has_interferers = bool(config.interference.interferers)
        self._columns = COLUMNS if radio.needs_attitude else POSITION.stop

    def receptions(self, packet: Packet) -> list[Reception]:
        """Return the fates of one packet at all its receivers, in the order of the nodes."""
        links = self._links[packet.tx]
        if not links.receivers:
            return []
        nodes = self._tracks.columns_at(packet.sim_time_ns, self._columns)
        here, there = nodes[:, packet.tx], nodes.take(links.columns, axis=1)
        way = there[POSITION] - here[POSITION, np.newaxis]
        way *= way
        distance_m = np.sqrt(way[0] + way[1] + way[2])
        columns = self._columns_of(packet, links, here, there, distance_m)
        erased = links.erasure.row(packet.seq) <= columns[3]
        fates = [_FATES[lost] for lost in erased.tolist()]
        self._other_losses(fates, columns, packet, links)
        distances, powers, snrs, pers, chances = (column.tolist() for column in columns)
        when, sender = repeat(packet.sim_time_ns), repeat(links.tx)
        number, length = repeat(packet.seq), repeat(packet.length_bytes)
        rows = zip(  # noqa: B905 (repeat never ends)
            when, sender, links.receivers, number, length, distances, powers, snrs, pers, fates, chances
        )
        return list(map(tuple.__new__, repeat(Reception), rows))

    def _columns_of(
        self, packet: Packet, links: _Links, here: FloatArray, there: FloatArray, distance_m: FloatArray
    ) -> list[FloatArray]:
        """Return distance, received power, SNR, packet error rate and probability of delivery at each receiver."""
        radio, length = self._radio, packet.length_bytes
        path = self._path(here, there, distance_m)
        mean_dbm = radio.mean_power_dbm(path)
        chance = in_steps(radio.expected_delivery(mean_dbm, path, length), STEPS_PER_ONE)
        power_dbm = mean_dbm + self._gain_db(packet, links, path)
        on = self._terms.interferers_on(packet.sim_time_ns) if self._has_interferers else ()
        return [*signal_of(radio, distance_m, power_dbm, radio.noise_dbm(path, on), length), chance]

    def _path(self, here: FloatArray, there: FloatArray, distance_m: FloatArray) -> Path:
        start, end = here[POSITION], there[POSITION].T
        if not self._radio.needs_attitude:
            return self._radio.path_of(start, end, distance_m)
        attitudes = _unit(here[ATTITUDE]), _unit(there[ATTITUDE].T)
        return self._radio.path_of(start, end, distance_m, *attitudes)

    def _gain_db(self, packet: Packet, links: _Links, path: Path) -> FloatArray | float:
        """Return what shadowing and fading do to the power at each receiver, dB."""
        times_ns = np.full(links.columns.shape, packet.sim_time_ns)
        places = self._terms.places(links.senders, links.columns, times_ns, path)
        normal = None if links.shadowing is None else links.shadowing.row(packet.seq)
        gain_db = np.negative(self._terms.shadowing_db(places, path, normal))
        if links.fading is not None:
            first, second = (table.row(packet.seq) for table in links.fading)
            return np.asarray(gain_db + self._terms.fading_gain_db(first, second, path))
        speed_mps = self._speeds_mps(packet, links)
        return gain_db + self._terms.fading_db(places, path, times_ns, speed_mps)

    def _speeds_mps(self, packet: Packet, links: _Links) -> FloatArray:
        """Return how fast each receiver moves relative to the transmitter."""
        velocities = self._tracks.velocities_at(packet.sim_time_ns)
        x, y, z = velocities.take(links.columns, axis=1) - velocities[:, packet.tx, np.newaxis]
        return np.asarray(np.sqrt(x * x + y * y + z * z))

    def _other_losses(
        self, fates: list[Fate], columns: list[FloatArray], packet: Packet, links: _Links
    ) -> None:
        """Put in the losses that do not depend on the signal, the later ones over the earlier."""
        if links.base_loss is not None:
            lost = links.base_loss.row(packet.seq) <= self._config.base_loss
            _mark(fates, lost.tolist(), Fate.BASE_LOSS)
        if links.bursts is not None:
            times_ns = np.full(links.columns.shape, packet.sim_time_ns)
            draws = links.bursts.row(packet.seq)
            bursts = self._terms.burst_losses(links.senders, links.columns, times_ns, draws)
            _mark(fates, bursts.tolist(), Fate.BURST)
        if self._has_range:
            self._out_of_range(fates, columns)
        if not self._tracks.all_known:
            self._unknown(fates, columns, packet.tx, links.indices)

    def _out_of_range(self, fates: list[Fate], columns: list[FloatArray]) -> None:
        beyond = columns[0] > self._radio.max_range_m
        if beyond.any():
            columns[4] = np.where(beyond, 0.0, columns[4])
            _mark(fates, beyond.tolist(), Fate.OUT_OF_RANGE)

    def _unknown(self, fates: list[Fate], columns: list[FloatArray], tx: int, indices: list[int]) -> None:
        """Mark the links with an end that was never seen: nothing is known of them, and nothing arrives."""
        known = self._tracks.known
        unknown = [not (known[tx] and known[node]) for node in indices]
        values = (math.nan, math.nan, math.nan, math.nan, 0.0)
        columns[:] = [np.where(unknown, value, column) for value, column in zip(values, columns, strict=True)]
        _mark(fates, unknown, Fate.NO_POSITION)


def _mark(fates: list[Fate], where: list[bool], fate: Fate) -> None:
    for i, marked in enumerate(where):
        if marked:
            fates[i] = fate


def _unit(quaternion: FloatArray) -> FloatArray:
    """Return interpolated attitudes at length 1; a node never seen is level."""
    length = np.sqrt(np.sum(quaternion * quaternion, axis=-1, keepdims=True))
    return np.where(length > 0.0, quaternion / np.maximum(length, 1e-9), LEVEL_WXYZ)
