"""Interference: what other transmitters add to the noise, summed in watt."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
from pydantic import Field, model_validator

from channel.checks import ChannelInputError, FloatArray
from channel.numbers.units import dbm_from_watt, watt_from_dbm
from channel.phy.spectrum import Rows, masked
from sitl_configs.settings import Settings

NS_PER_S = 1_000_000_000
MAX_PULSED = 8
MAX_REJECTION_DB = 300.0
ISOLATION_DB = 25.0
"""Recommended of two antennas of one product in their band (u-blox, JODY-W2 data sheet UBX-18017567, appendix A).

It is also what free space takes over 0.17 m at 2.44 GHz, and over 0.46 m at 915 MHz.
"""


class Interferer(Settings):
    """A transmitter that is not ours: a jammer, an access point.

    With a duty below 1 it is on or off for whole slots, drawn anew for each.
    """

    name: str = Field(default="interferer")
    position_ned_m: tuple[float, float, float] = Field(description="in the frame of the run")
    power_dbm: float = Field(ge=-200.0, le=200.0, description="radiated (EIRP)")
    frequency_hz: float | None = Field(
        default=None, ge=1e6, le=1e12, description="carrier, Hz; that of the radio if not given"
    )
    bandwidth_hz: float = Field(default=1e3, gt=0.0, le=1e11, description="its power is flat within")
    duty: float = Field(default=1.0, ge=0.0, le=1.0, description="share of slots in which it transmits")
    slot_s: float = Field(default=0.01, ge=1e-6, le=1e6)

    @property
    def slot_ns(self) -> int:
        """Length of a slot, ns of sim time."""
        return round(self.slot_s * NS_PER_S)


class Interference(Settings):
    """All interferers, and how well the receiver rejects what is beside its channel."""

    interferers: tuple[Interferer, ...] = Field(default=())
    rejection: tuple[tuple[float, float], ...] | None = Field(
        default=None,
        description="of the receiver's filter: rows of frequency offset in Hz and rejection in dB, linear between, "
        "constant beyond; if not given, by the radio's bandwidth",
    )
    isolation_db: float = Field(
        default=ISOLATION_DB,
        ge=0.0,
        le=MAX_REJECTION_DB,
        description="between radios of one node, from the power of one to the input of another: in place of a way",
    )

    @model_validator(mode="after")
    def _is_a_curve(self) -> Interference:
        offsets = None if self.rejection is None else [row[0] for row in self.rejection]
        if offsets is not None and (
            not offsets or offsets[0] < 0.0 or any(b <= a for a, b in pairwise(offsets))
        ):
            raise ValueError("rejection: offsets have to rise from row to row, from 0 on")
        if any(not 0.0 <= rejection_db <= MAX_REJECTION_DB for _, rejection_db in self.rejection or ()):
            raise ValueError(f"rejection: from 0 to {MAX_REJECTION_DB:g} dB")
        if sum(0.0 < each.duty < 1.0 for each in self.interferers) > MAX_PULSED:
            raise ValueError(f"at most {MAX_PULSED} interferers with a duty between 0 and 1")
        return self

    def filter_rows(self, bandwidth_hz: float) -> Rows:
        """Return the filter of a receiver of that bandwidth: offsets in Hz and levels in dB, at most 0."""
        if self.rejection is None:
            return masked(bandwidth_hz)
        return tuple((offset_hz, -rejection_db) for offset_hz, rejection_db in self.rejection)

    def states(self, emitters: Sequence[float] = ()) -> list[tuple[float, tuple[bool, ...]]]:
        """Return every combination of transmitting interferers with its probability.

        Args:
            emitters: duties of emitters, which come after the interferers.

        Raises:
            ChannelInputError: more than MAX_PULSED have a duty between 0 and 1.
        """
        duties = [*(each.duty for each in self.interferers), *emitters]
        pulsed = sum(0.0 < duty < 1.0 for duty in duties)
        if pulsed > MAX_PULSED:
            allowed = f"at most {MAX_PULSED} interferers and emitters with a duty between 0 and 1"
            raise ChannelInputError("duty", duties, allowed)
        choices = [[(duty, True), (1.0 - duty, False)] if duty < 1.0 else [(1.0, True)] for duty in duties]
        combinations = []
        for combination in product(*choices):
            chance = float(np.prod([probability for probability, _ in combination]))
            if chance > 0.0:
                combinations.append((chance, tuple(on for _, on in combination)))
        return combinations


def sum_dbm(noise_dbm: float, powers_dbm: list[FloatArray]) -> FloatArray:
    """Return noise and interference together: summed in watt, in dBm."""
    total = np.asarray(watt_from_dbm(noise_dbm))
    for power in powers_dbm:
        total = total + watt_from_dbm(power)
    return dbm_from_watt(total)
