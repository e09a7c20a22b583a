"""The random terms of one packet at its receivers, each from its own stream of draws."""

from __future__ import annotations

import numpy as np

from channel.checks import FloatArray
from channel.draws import Draws, Purpose, uniform_from_words
from channel.fading.laws import coherence_block, coherence_time_s
from channel.fading.shadow_field import ShadowField
from channel.geometry import Path
from channel.link.radio import Radio, States
from channel.phy.bursts import Timeline

Receivers = tuple[str, ...]
LEVEL = np.zeros(())


class RandomTerms:
    """Draws of one radio in one run.

    Args:
        radio: the radio.
        draws: the run's draws.
    """

    def __init__(self, radio: Radio, draws: Draws) -> None:
        self._radio = radio
        self._config = radio.config
        self._draws = draws
        spacing_m = radio.config.shadowing.decorrelation_m
        self._field = None if spacing_m is None else ShadowField(draws, spacing_m)
        self._timelines: dict[tuple[str, str], Timeline] = {}
        self._blocks: dict[tuple[str, str], tuple[tuple[int, int], float, float]] = {}

    def shadowing_db(self, tx: str, receivers: Receivers, path: Path) -> FloatArray:
        """Return the loss by shadowing that lasts over some way, at each receiver, dB."""
        assert self._field is not None
        assert path.position_tx_ned_m is not None
        assert path.position_rx_ned_m is not None
        normal = self._field.standard_normal(tx, receivers, path.position_tx_ned_m, path.position_rx_ned_m)
        return self._config.shadowing.loss_db(normal)

    def fading_db(
        self, tx: str, receivers: Receivers, sim_time_ns: int, path: Path, speed_mps: FloatArray
    ) -> FloatArray:
        """Return the gain by fading that lasts for a coherence time, at each receiver, dB.

        Args:
            tx: transmitting node.
            receivers: receiving nodes.
            sim_time_ns: when the packet was sent.
            path: the links.
            speed_mps: relative speeds of the two ends.
        """
        times_s = coherence_time_s(speed_mps, path.frequency_hz, self._config.fading.max_coherence_s)
        pairs = [
            self._of_block(tx, rx, coherence_block(sim_time_ns, time_s))
            for rx, time_s in zip(receivers, times_s.tolist(), strict=True)
        ]
        first, second = np.asarray(pairs).T
        return self.fading_gain_db(first, second, path)

    def fading_gain_db(self, first: FloatArray, second: FloatArray, path: Path) -> FloatArray:
        """Return the gain by fading for two uniform draws of each link, dB."""
        fading = self._config.fading
        return fading.gain_db(first, second, path.elevation_deg if fading.by_elevation else LEVEL)

    def _of_block(self, tx: str, rx: str, block: tuple[int, int]) -> tuple[float, float]:
        """Return the two uniform draws of a pair for one block of time; both directions share them."""
        pair = (tx, rx) if tx <= rx else (rx, tx)
        kept = self._blocks.get(pair)
        if kept is None or kept[0] != block:
            words = self._draws.words((*pair, "fading", str(block[0])), max(block[1], 0), 1)
            first, second = uniform_from_words(words[0, :2]).tolist()
            kept = self._blocks[pair] = (block, first, second)
        return kept[1], kept[2]

    def interferers_on(self, sim_time_ns: int) -> States:
        """Return which interferers transmit at an instant: the same for every receiver."""
        return tuple(
            each.duty >= 1.0 or self._slot_draw(i, max(sim_time_ns // each.slot_ns, 0)) < each.duty
            for i, each in enumerate(self._config.interference.interferers)
        )

    def _slot_draw(self, index: int, slot: int) -> float:
        words = self._draws.words(("interferer", str(index), "slots"), slot, 1)
        return float(uniform_from_words(words[0, 0]))

    def burst_losses(self, tx: str, receivers: Receivers, seq: int, sim_time_ns: int) -> list[bool]:
        """Return which receivers lose a packet to a burst."""
        chances = [self._config.bursts.loss_at(self._timeline(tx, rx), sim_time_ns) for rx in receivers]
        draws = self._draws.uniforms(Purpose.BURST, tx, receivers, seq)
        return [draw <= chance for draw, chance in zip(draws.tolist(), chances, strict=True)]

    def _timeline(self, tx: str, rx: str) -> Timeline:
        timeline = self._timelines.get((tx, rx))
        if timeline is None:
            timeline = self._timelines[tx, rx] = Timeline(self._draws, tx, rx)
        return timeline
