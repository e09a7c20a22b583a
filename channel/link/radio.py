"""A radio at work: geometry in, link budget, error rates and probability of delivery out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel import checks
from channel.access.settings.base import Locking
from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.geometry import Path, path_at, separation_m
from channel.link.budget import BudgetedLink, LinkBudget, total
from channel.link.emitters.disturbance import POINTS, Disturbance, Gains, States
from channel.link.emitters.emitter import Emitter
from channel.link.expectation import PANELS, Expectation
from channel.link.paths import Geometry, LinkPaths
from channel.link.sight import Sight
from channel.link.tables.lengths import Lengths
from channel.link.tables.per_table import PerTable
from channel.link.tables.steps import STEPS_PER_DB, STEPS_PER_M, in_steps
from channel.phy.error_model import Band

OF_RECEIVER = ("offset_db", "noise", "bandwidth_hz", "interference", "bursts", "base_loss")
"""What is the receiver's on a link between two radios, beside its antenna and cable."""
FINE_POINTS = 4 * POINTS
SHORT_BYTES, HARDLY_ANY = 20, 1e-3
"""A level from which receivers lock on counts if more of such packets would come through a signal just below it."""
MAX_LENGTH_BYTES = 1 << 24


@dataclass(frozen=True, slots=True)
class Delivery:
    """A probability of delivery averaged over the random terms, and a bound of its quadrature error."""

    probability: FloatArray
    error_bound: FloatArray


class Radio:
    """The physics of one radio configuration; the same at both ends, unless made by `towards`.

    Args:
        config: the radio, see `presets.load_radio`.
        emitters: of the run; where they are comes with each path (`Path.emitters_ned_m`).

    Attributes:
        paths: geometry of links.
        budget: their link budget.
        emitters: those that it hears: their spectrum comes as near as the last row of its filter.
        sources: its interferers, then these.
        terms_are_of_places: whether a term that lasts is the same for all pairs whose ends stand at the same places.
        interference_varies: whether random terms change what arrives from them.
        locks_from_dbm: weakest signal that a receiver locks on to (`preamble_dbm` of its medium); -inf if there is no
            such level, or if packets are lost to noise before they are as weak: they are erased then.

    Raises:
        ChannelInputError: more emitters and interferers with a duty between 0 and 1 than can be averaged over.
    """

    def __init__(self, config: RadioConfig, emitters: Sequence[Emitter] = ()) -> None:
        self.config = config
        self._emitters_of_run = tuple(emitters)
        self.paths, self.budget = LinkPaths(config), LinkBudget(config)
        self._band = Band(config.bandwidth_hz, config.bit_rate_bps)
        self.sight = Sight(config, self._band) if config.propagation.draws_sight else None
        self.terms_are_of_places = (
            self.sight is not None or getattr(config.shadowing, "surroundings", "own") == "shared"
        )
        self._disturbance = Disturbance(config, emitters, self.paths, self.budget, self.sight)
        self.emitters, self.sources = self._disturbance.emitters, self._disturbance.sources
        self.interference_varies = self._disturbance.varies
        self.noise_floor_dbm = config.noise_floor_dbm
        self.max_range_m = np.inf if config.max_range_m is None else config.max_range_m
        self.needs_attitude = self.budget.needs_attitude
        self.kept_share = (1.0 - config.base_loss) * (1.0 - config.bursts.mean_loss)
        self._expectation = Expectation(config, self._band)
        self.needs_roles = config.propagation.needs_roles
        self._per_table = PerTable(self.per_unchecked)
        self.locks_from_dbm = self._level(self.noise_floor_dbm)
        self._is_random = self.sight is not None or config.shadowing.is_random or config.fading.is_random
        self.needs_places = self.needs_attitude or bool(self.sources) or config.propagation.needs_places

    def towards(self, receiver: Radio) -> Radio:
        """Return the physics of links on which this radio transmits to another one.

        Power, antenna and cable of the transmitter, its modulation, bit rate and framing, and the way (path loss,
        atmosphere, shadowing, fading, polarisation) are as this radio has them. Antenna, cable, offset, noise, noise
        bandwidth, interference, bursts and base loss are the receiver's. The shorter of two ranges holds.

        Raises:
            ChannelInputError: the receiver is on another frequency.
        """
        here, there = self.config, receiver.config
        if here == there:
            return self
        if here.frequency_hz != there.frequency_hz:
            allowed = f"{here.frequency_hz:g}, the frequency of {here.name}: radios of one run share it"
            raise ChannelInputError(f"frequency_hz of {there.name}", there.frequency_hz, allowed)
        ranges_m = [each.max_range_m for each in (here, there) if each.max_range_m is not None]
        of_receiver = {name: getattr(there, name) for name in OF_RECEIVER}
        ends = {
            "name": f"{here.name} to {there.name}",
            "receive_antenna": there.receiving_antenna,
            "receive_cable_loss_db": there.receiving_cable_loss_db,
            "max_range_m": min(ranges_m, default=None),
        }
        return Radio(here.model_copy(update=of_receiver | ends), self._emitters_of_run)

    def beside(self, quietest_dbm: float) -> Radio:
        """Return the same radio in a network of which the quietest receiver has that noise floor, dBm."""
        medium = self.config.medium
        if getattr(medium, "preamble_dbm", 0.0) is not None or quietest_dbm == self.noise_floor_dbm:
            return self
        medium = medium.model_copy(update={"preamble_dbm": quietest_dbm})
        return Radio(self.config.model_copy(update={"medium": medium}), self._emitters_of_run)

    def _level(self, noise_floor_dbm: float) -> float:
        medium = self.config.medium
        if not isinstance(medium, Locking):
            return -np.inf
        level_dbm = medium.locks_from_dbm(noise_floor_dbm)
        snr_db = np.array([level_dbm - noise_floor_dbm])
        per = self.per_unchecked(snr_db, float(self.length_bytes(SHORT_BYTES)))
        return level_dbm if float(per[0]) < 1.0 - HARDLY_ANY else -np.inf

    @property
    def needs_preamble(self) -> bool:
        """Whether a packet may be too weak to be locked on to, while its error rate would let it through."""
        return self.locks_from_dbm > -np.inf

    def locks_on(self, power_dbm: FloatArray) -> NDArray[np.bool_]:
        """Return whether a receiver locks on to signals, to the 0.001 dB in which powers are written."""
        return np.greater_equal(in_steps(power_dbm, STEPS_PER_DB), self.locks_from_dbm)

    @property
    def is_by_distance(self) -> bool:
        """Whether a distance says what is delivered: neither law nor sources of interference ask for places."""
        return not self.sources and not self.config.propagation.needs_places

    def at_bit_rate(self, bit_rate_bps: float | None) -> Radio:
        """Return the same radio at another bit rate: errors are those of its modulation there; None: this one."""
        if bit_rate_bps in (None, self.config.bit_rate_bps):
            return self
        return Radio(self.config.model_copy(update={"bit_rate_bps": bit_rate_bps}), self._emitters_of_run)

    def length_bytes(self, payload_bytes: int) -> int:
        """Return the length that the error model counts for a payload of `payload_bytes`.

        Raises:
            ChannelInputError: a negative length.
        """
        if payload_bytes < 0:
            raise ChannelInputError("payload_bytes", payload_bytes, ">= 0")
        return self.config.length.length_bytes(payload_bytes)

    def path(self, slant_distance_m: ArrayLike | None = None, **geometry: Unpack[Geometry]) -> Path:
        """Return the checked geometry of links, from distances or from positions: see `LinkPaths.given`.

        Raises:
            ChannelInputError: a value out of range, a wrong shape, or not one of distances and positions.
        """
        return self.paths.given(slant_distance_m, **geometry)

    def mean_power_dbm(self, path: Path) -> FloatArray:
        """Return the received power without its random part, dBm."""
        return self.budget.power_dbm(path)

    def noise_dbm(
        self, path: Path, transmitting: States | None = None, gains_db: Gains | None = None
    ) -> FloatArray | float:
        """Return noise floor and interference at the receivers, dBm.

        Args:
            path: the links.
            transmitting: which of `sources` are on, for all links or by link; all if not given.
            gains_db: what random terms add to each; if not given none, and the mean in watt over the line of sight.
        """
        return self._disturbance.noise_dbm(path, transmitting, gains_db)

    def way_of_source(self, number: int, path: Path) -> Path:
        """Return the geometry from one of `sources` to the receivers of links."""
        return self._disturbance.way(number, path)

    def per(self, snr_db: ArrayLike, length_bytes: ArrayLike) -> FloatArray:
        """Return the packet error rate at an SNR, range, bursts and `base_loss` aside.

        Raises:
            ChannelInputError: a value is not finite, or a length negative.
        """
        length = checks.finite("length_bytes", length_bytes, 0.0, MAX_LENGTH_BYTES)
        return self.per_unchecked(checks.finite("snr_db", snr_db), length)

    def per_unchecked(self, snr_db: FloatArray, length_bytes: FloatArray | float) -> FloatArray:
        """Return what `per` returns, for what is known to be right."""
        return self.config.error.per(snr_db, length_bytes, self._band)

    def per_in_steps(self, snr_db: FloatArray, lengths: Lengths) -> FloatArray:
        """Return the packet error rate to 1e-7, at SNRs in whole steps of 0.001 dB: from a table, once it pays."""
        return self._per_table.per(snr_db, lengths)

    def hopeless_below_db(self, lengths: Lengths) -> FloatArray | float:
        """Return the SNR below which every packet is erased: the error rate to 1e-7 is 1; -inf if there is none."""
        return self._per_table.hopeless_below_db(lengths)

    def in_range(self, distance_m: FloatArray) -> NDArray[np.bool_]:
        """Return whether distances, to the millimetre in which they are written, are within the range."""
        return np.less_equal(in_steps(distance_m, STEPS_PER_M), self.max_range_m)

    def link(
        self,
        slant_distance_m: ArrayLike | None = None,
        *,
        length_bytes: ArrayLike | None = None,
        **geometry: Unpack[Geometry],
    ) -> BudgetedLink:
        """Return the link budget and the error rates without shadowing and fading, all interferers on.

        Args:
            slant_distance_m: see `path`.
            length_bytes: payload length; the radio's nominal length if not given. Broadcasts.
            **geometry: positions, heights, attitudes, frequency: see `path`.

        Raises:
            ChannelInputError: see `path`; or a negative length.
        """
        path = self.path(slant_distance_m, **geometry)
        length = self._lengths(length_bytes)
        terms = self.budget.terms(path)
        power = np.asarray(total(terms))
        checks.broadcast(distance_m=power, length_bytes=length)
        noise = np.asarray(self.noise_dbm(path))
        snr = np.asarray(power - noise)
        distance = _separation(path)
        in_range = self.in_range(distance)
        return BudgetedLink(
            distance_m=distance,
            length_bytes=length,
            terms=terms,
            path_loss_db=np.negative(terms[-1].contribution),
            received_power_dbm=power,
            noise_dbm=noise,
            snr_db=snr,
            ber=self.config.error.ber(snr, self._band),
            per=np.where(in_range, self.per_unchecked(snr, length), 1.0),
            in_range=in_range,
            base_loss=self.config.base_loss,
        )

    def probability_of_delivery(
        self,
        slant_distance_m: ArrayLike | None = None,
        length_bytes: ArrayLike | None = None,
        **geometry: Unpack[Geometry],
    ) -> FloatArray:
        """Return the probability that a packet arrives, averaged over the random terms by quadrature."""
        return self.delivery(slant_distance_m, length_bytes, **geometry).probability

    def delivery(
        self,
        slant_distance_m: ArrayLike | None = None,
        length_bytes: ArrayLike | None = None,
        **geometry: Unpack[Geometry],
    ) -> Delivery:
        """Return the probability of delivery with a bound of the quadrature's error.

        Averaged over shadowing, fading, interferers with a duty, bursts and `base_loss`. The bound is the
        difference to a rule of half the nodes, plus the weight of the tails left out. Arguments as of `link`.
        """
        path = self.path(slant_distance_m, **geometry)
        length = self._lengths(length_bytes)
        power = self.mean_power_dbm(path)
        shape = checks.broadcast(distance_m=power, length_bytes=length)
        fine, coarse = np.zeros(shape), np.zeros(shape)
        for chance, noises in self._disturbance.cases(path, FINE_POINTS):
            for noise in noises:
                fine += chance / len(noises) * self._averaged(power, noise, length, path, PANELS)
        for chance, noises in self._disturbance.cases(path):
            for noise in noises:
                coarse += chance / len(noises) * self._averaged(power, noise, length, path, PANELS // 2)
        kept = np.where(self.in_range(_separation(path)), self.kept_share, 0.0)
        return Delivery(kept * fine, kept * (np.abs(fine - coarse) + 1e-14))

    def _averaged(
        self,
        power_dbm: FloatArray,
        noise_dbm: FloatArray | float,
        length: FloatArray,
        path: Path,
        panels: int,
    ) -> FloatArray:
        """Return E[1 - PER] by quadrature over shadowing and fading, and over the line of sight if it is drawn."""
        snr_db, least_db = power_dbm - noise_dbm, self._least_snr_db(noise_dbm)
        if self.sight is not None:
            return self.sight.averaged(snr_db, length, path, panels, least_db)
        success = self._expectation.averaged(snr_db, length, path.elevation_deg, panels, least_db)
        return self._where_locked(success, power_dbm)

    def _least_snr_db(self, noise_dbm: FloatArray | float) -> FloatArray | float | None:
        """Return the SNR below which no receiver locks on; None: it always does, or nothing is random."""
        return self.locks_from_dbm - noise_dbm if self.needs_preamble and self._is_random else None

    def _where_locked(self, success: FloatArray, power_dbm: FloatArray) -> FloatArray:
        """Return chances that are 0 where the signal is too weak for certain: nothing is random."""
        if not self.needs_preamble or self._is_random:
            return success
        return np.where(self.locks_on(power_dbm), success, 0.0)

    @property
    def shares_draws(self) -> bool:
        """Whether packets share what is drawn, by place or by time: their fates are not independent then."""
        shadowing, fading = self.config.shadowing, self.config.fading
        return (
            (shadowing.is_random and shadowing.decorrelation_m is not None)
            or (fading.is_random and fading.coherence != "packet")
            or self.sight is not None
            or self.config.bursts.mean_loss > 0.0
            or len(self._disturbance.states) > 1
        )

    def expected_delivery(
        self,
        slant_distance_m: ArrayLike | None = None,
        *,
        length_bytes: int | None = None,
        **geometry: Unpack[Geometry],
    ) -> FloatArray:
        """Return the probability of delivery from a table, which is made once: fast, within 1e-5 of `delivery`.

        Within 3e-4 where the error rate jumps and less than 1 dB is random, within 0.01 where a medium's preamble level
        (`needs_preamble`), shadowing and fading meet.

        Args:
            slant_distance_m: see `path`.
            length_bytes: payload length of all packets; the radio's nominal length if not given.
            **geometry: positions, heights, attitudes, frequency: see `path`.

        Raises:
            ChannelInputError: see `path`; or a length that no packet has.
        """
        path = self.path(slant_distance_m, **geometry)
        payload_bytes = self.config.nominal_payload_bytes if length_bytes is None else length_bytes
        checks.finite("length_bytes", payload_bytes, 0.0, MAX_LENGTH_BYTES)
        lengths = Lengths.same(self.length_bytes(payload_bytes))
        share = self.delivery_from_table(self.mean_power_dbm(path), path, lengths)
        return np.where(self.in_range(_separation(path)), share, 0.0)

    def delivery_from_table(self, mean_power_dbm: FloatArray, path: Path, lengths: Lengths) -> FloatArray:
        """As `expected_delivery`, of links whose mean power is known.

        Args:
            mean_power_dbm: as `mean_power_dbm` gives it for `path`.
            path: the links, range aside.
            lengths: as the error model counts them.
        """
        success: FloatArray | float = 0.0
        for chance, noises in self._disturbance.cases(path):
            if len(noises) == 1 or mean_power_dbm.ndim != 1:
                parts = [self._from_table(mean_power_dbm, noise, lengths, path) for noise in noises]
                part = parts[0] if len(parts) == 1 else np.mean(parts, axis=0)
            else:
                rows = np.tile(np.arange(mean_power_dbm.size), len(noises))
                power_dbm, noise_dbm = np.broadcast_arrays(mean_power_dbm, np.asarray(noises))
                tiled = self._from_table(
                    power_dbm.ravel(), noise_dbm.ravel(), lengths.at(rows), path_at(path, rows)
                )
                part = tiled.reshape(len(noises), -1).mean(axis=0)
            success = part if chance == 1.0 else success + chance * part
        return np.asarray(self.kept_share * success)

    def _from_table(
        self, power_dbm: FloatArray, noise_dbm: FloatArray | float, lengths: Lengths, path: Path
    ) -> FloatArray:
        """Return E[1 - PER] over shadowing, fading and the line of sight from tables."""
        snr_db, least_db = power_dbm - noise_dbm, self._least_snr_db(noise_dbm)
        # strong interference: many levels, below which all is lost anyway
        if isinstance(least_db, np.ndarray):
            least_db = np.maximum(least_db, self.hopeless_below_db(lengths))
        if self.sight is not None:
            return self.sight.from_table(snr_db, lengths, path, least_db)
        elevation = path.elevation_deg if self.config.fading.by_elevation else None
        success = self._expectation.from_table(snr_db, lengths, elevation, least_db)
        return self._where_locked(success, power_dbm)

    def _lengths(self, length_bytes: ArrayLike | None) -> FloatArray:
        if length_bytes is None:
            return np.asarray(float(self.length_bytes(self.config.nominal_payload_bytes)))
        payload = checks.finite("length_bytes", length_bytes, 0.0, MAX_LENGTH_BYTES)
        return np.asarray(np.vectorize(self.config.length.length_bytes, otypes=[np.float64])(payload))


def _separation(path: Path) -> FloatArray:
    """Return the true distances of a path that has positions, not clamped."""
    assert path.position_tx_ned_m is not None
    assert path.position_rx_ned_m is not None
    return separation_m(path.position_tx_ned_m, path.position_rx_ned_m)
