"""Received powers by generators of our own, for the judge: no field, draw or wave of the channel is in them.

Shadowing is an Ornstein-Uhlenbeck process over the way along straight tracks, which has Gudmundson's autocorrelation
(Doob 1942); fading is a sum of many waves with random directions for each link (Jakes 1974), or drawn by the definition
of its law; a state of line of sight is such a process below a quantile. Powers are written to 0.001 dB.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from channel import presets
from channel.link.decision import Signal
from channel.link.radio import Radio
from channel.medium.judge.changes import FROM_PACKET_TO_PACKET, OVER_PLACE
from channel.medium.judge.judge import Judge
from channel.medium.links import LinksOfPass
from channel.medium.reception import EVERYBODY, Packets

SIGHT = {"propagation": {"model": "uma-av", "outside": "clamp"}}
DEEP = {
    "shadowing": {"model": "gudmundson", "sigma_db": 4.0, "decorrelation_m": 25.0},
    "fading": {"model": "rayleigh", "coherence": "doppler"},
}
SIGMA_OF_TABLE = {"shadowing": {"model": "gudmundson", "sigma_db": None, "decorrelation_m": 37.0}}
WAVES = 64
OVER, PACKETS = OVER_PLACE.name, FROM_PACKET_TO_PACKET.name
LIGHT_MPS = 299_792_458.0


@dataclass(frozen=True)
class World:
    """How pairs of nodes fly, and what is wrong with what they hear.

    Attributes:
        pairs: links, each of two nodes of its own.
        packets: of each link.
        step_s: between its packets.
        speed_mps: of one end of each link; the other stands.
        too_long: decorrelation distances are longer by this factor.
        redrawn: fading is drawn anew for each packet.
        off_db: added to all powers.
        spread: by which all gains of shadowing are multiplied.
    """

    pairs: int = 4
    packets: int = 1000
    step_s: float = 1.0
    speed_mps: float = 15.0
    too_long: float = 1.0
    redrawn: bool = False
    off_db: float = 0.0
    spread: float = 1.0

    def verdict(self, radio, seed):
        """The verdict of a judge that takes what is heard here for what `radio` says."""
        rng = np.random.default_rng(seed)
        judge = Judge(2 * self.pairs, seed)
        for pair in range(self.pairs):
            self._hear(radio, judge, pair, rng)
        return judge.verdict()

    def _hear(self, radio, judge, pair, rng):
        n = self.packets
        time_s = self.step_s * np.arange(n)
        turn = rng.uniform(0.0, 2.0 * math.pi)
        along = np.outer(self.speed_mps * time_s, (math.cos(turn), math.sin(turn), 0.0))
        tx = np.broadcast_to(np.array([0.0, 0.0, -40.0]), (n, 3))
        rx = np.array([200.0 * math.cos(turn), 200.0 * math.sin(turn), -50.0]) + along
        path = radio.paths.of(tx, rx, np.linalg.norm(rx - tx, axis=-1))
        mean_dbm = radio.mean_power_dbm(path)
        gain_db = self._gain_db(radio, path, time_s, rng)
        power_dbm = np.rint((mean_dbm + gain_db + self.off_db) * 1e3) / 1e3
        noise_dbm = radio.noise_dbm(path)
        when_ns = np.rint(time_s * 1e9).astype(np.int64)
        packets = Packets(when_ns, np.full(n, 2 * pair), np.arange(n), np.full(n, 40), np.full(n, EVERYBODY))
        links = LinksOfPass(packets, np.arange(n), packets.tx, packets.tx + 1, path, path.distance_m)
        snr_db = np.rint((power_dbm - noise_dbm) * 1e3) / 1e3
        signal = Signal(path.distance_m, power_dbm, snr_db, np.zeros(n))
        judge.begin(links)
        judge.take(radio, links, mean_dbm, noise_dbm, signal, np.zeros(n, dtype=bool))

    def _gain_db(self, radio, path, time_s, rng):
        config, way_m = radio.config, self.speed_mps * time_s
        return self._shadowed_db(radio, path, way_m, rng) + self._faded_db(config, way_m, time_s, path, rng)

    def _shadowed_db(self, radio, path, way_m, rng):
        shadowing, n = radio.config.shadowing, len(way_m)
        z = np.zeros(n)
        if shadowing.is_random:
            spacing_m = shadowing.decorrelation_m
            z = self.spread * (
                rng.standard_normal(n) if spacing_m is None else self._process(way_m, spacing_m, rng)
            )
        if radio.sight is not None:
            seen, hidden = radio.sight.states(path)
            is_seen = self._process(way_m, radio.sight.decorrelation_m, rng) < ndtri(seen.chance)
            excess_db = np.where(is_seen, seen.excess_db, hidden.excess_db)
            return np.where(is_seen, seen.sigma_db, hidden.sigma_db) * z - excess_db
        if shadowing.model == "one-sided-normal":
            return -shadowing.sigma_db * np.abs(z)
        return shadowing.spread_db * z

    def _process(self, way_m, spacing_m, rng):
        """Ornstein and Uhlenbeck's process at places along a way."""
        fresh = rng.standard_normal(len(way_m))
        steps = np.diff(way_m, prepend=-1e9) / (spacing_m * self.too_long)
        keep = np.exp(-steps)
        out, last = np.empty_like(fresh), 0.0
        for i, (k, z) in enumerate(zip(keep.tolist(), fresh.tolist(), strict=True)):
            out[i] = last = k * last + math.sqrt(1.0 - k * k) * z
        return out

    def _faded_db(self, config, way_m, time_s, path, rng):
        fading, n = config.fading, len(way_m)
        if not fading.is_random:
            return np.zeros(n)
        if self.redrawn or fading.coherence == "packet":
            scatter = (rng.standard_normal(n) + 1j * rng.standard_normal(n)) / math.sqrt(2.0)
        else:
            scatter = self._waves(config, way_m, time_s, rng)
        k = 10.0 ** (getattr(fading, "k_db", -400.0) / 10.0)
        direct = np.exp(2j * math.pi * path.distance_m * config.frequency_hz / LIGHT_MPS)
        return 10.0 * np.log10(np.abs(math.sqrt(k / (k + 1.0)) * direct + scatter / math.sqrt(k + 1.0)) ** 2)

    def _waves(self, config, way_m, time_s, rng):
        """Jakes: waves from all around, over the way, and slower ones of the surroundings, over time."""
        come, phase, others = rng.uniform(0.0, 2.0 * math.pi, (3, WAVES, 1))
        doppler_hz = 9.0 / (16.0 * math.pi) / config.fading.max_coherence_s
        turns = way_m * config.frequency_hz / LIGHT_MPS * np.cos(come) + time_s * doppler_hz * np.cos(others)
        weight = np.sqrt(rng.standard_exponential((WAVES, 1)) / WAVES)
        return np.sum(weight * np.exp(1j * (2.0 * math.pi * turns + phase)), axis=0)


FLIGHT = World(packets=1000)
HOVER = World(speed_mps=0.0, step_s=0.05, packets=3000)
CREEP = World(speed_mps=0.3, step_s=0.05, packets=3000)
"""Much less than a wavelength from packet to packet."""
MANY = World(pairs=15, speed_mps=0.0, step_s=0.25, packets=80)
"""For twenty seconds: changes on a link swing at almost one frequency meanwhile."""

RIGHT = {
    "steps of the line of sight": ("perfect", SIGHT, FLIGHT),
    "one-sided and rounded": ("moon2020", {}, FLIGHT),
    "line of sight and shadowing": ("corrected", SIGHT | SIGMA_OF_TABLE, FLIGHT),
    "shadowing and Rician fading": ("wifi-2.4", {}, FLIGHT),
    "fading of ends that hover": ("wifi-2.4", DEEP, HOVER),
    "fading of ends that creep": ("wifi-2.4", DEEP, CREEP),
    "Rician fading of many ends that hover": ("wifi-2.4", {"shadowing": {"model": "none"}}, MANY),
}
WRONG = {
    "decorrelation times four": ("wifi-2.4", {}, replace(FLIGHT, too_long=4.0), OVER),
    "decorrelation times four with line of sight": (
        "corrected",
        SIGHT | SIGMA_OF_TABLE,
        replace(FLIGHT, too_long=4.0),
        OVER,
    ),
    "Rayleigh fading redrawn in a hover": ("wifi-2.4", DEEP, replace(HOVER, redrawn=True), PACKETS),
    "Rayleigh fading redrawn in a creep": ("wifi-2.4", DEEP, replace(CREEP, redrawn=True), PACKETS),
    "Rician fading redrawn in a creep": ("wifi-2.4", {}, replace(CREEP, redrawn=True), PACKETS),
    "2 dB less than one-sided": ("moon2020", {}, replace(FLIGHT, off_db=-2.0), "level of the powers"),
    "2 dB more than with fading": ("wifi-2.4", {}, replace(FLIGHT, off_db=2.0), "level of the powers"),
    "one-sided sigma of 8 for 6 dB": (
        "moon2020",
        {},
        replace(FLIGHT, spread=8.0 / 6.0),
        "spread of the powers",
    ),
}


def radio_of(name, changes):
    return Radio(presets.load_radio(name, changes))


def verdicts(case, repeats):
    """Verdicts on worlds of a case, one for each seed."""
    radio, world = radio_of(*case[:2]), case[2]
    return [world.verdict(radio, seed) for seed in range(repeats)]


def failures(judged):
    """What failed in each world that did not pass, by seed."""
    return {
        seed: [check for check in verdict.checks if not check.passed]
        for seed, verdict in enumerate(judged)
        if not verdict.passed
    }


def chances(judged):
    """Chances of each check that counts something, by its name."""
    found = {}
    for verdict in judged:
        for check in verdict.checks:
            if check.wrong != "any":
                found.setdefault(check.name, []).append(check.chance)
    return found
