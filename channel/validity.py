"""Ranges in which a model was measured: outside them it refuses, or warns once, or counts the nearest place inside."""

from __future__ import annotations

import warnings
from typing import Literal

import numpy as np
from pydantic import Field, PrivateAttr

from channel.checks import ChannelInputError, FloatArray
from channel.variant import Variant

OUTSIDE_KEY = "`outside: warn` goes on with the formula, `outside: clamp` with the nearest place inside"


class ValidityWarning(UserWarning):
    """A model is used outside the range that it was made for."""


class OutsideValidityError(ChannelInputError):
    """A model is used outside the range that it was made for, and refuses."""


class RangedVariant(Variant):
    """A model with a validity range."""

    outside: Literal["refuse", "warn", "clamp"] = Field(
        default="refuse", description="what to do outside the model's validity range"
    )
    _warned: set[str] = PrivateAttr(default_factory=set)

    @property
    def frequencies_hz(self) -> tuple[float, float] | None:
        """The carriers for which the model was made; None: it says nothing of them."""
        return None

    def within_frequencies(self, frequency_hz: FloatArray | float) -> FloatArray:
        """Return the carriers to count with, as `within` does.

        Raises:
            OutsideValidityError: one lies outside of `frequencies_hz`, and the model is to refuse.
        """
        return self.within("frequency_hz", frequency_hz, *(self.frequencies_hz or (0.0, np.inf)))

    def within(self, name: str, value: FloatArray | float, low: float, high: float) -> FloatArray:
        """Return the values to count with: as they are, or with `clamp` the nearest of [low, high].

        Raises:
            OutsideValidityError: a value lies outside, and the model is to refuse.
        """
        array = np.asarray(value, dtype=np.float64)
        if self.outside == "clamp":
            return np.clip(array, low, high)
        if self.outside == "warn" and name in self._warned:
            return array
        bad = (array < low) | (array > high)
        if bad.any():
            self.say(name, float(array[bad].flat[0]), f"{low:g} to {high:g}")
        return array

    def say(self, name: str, value: float | str, allowed: str) -> None:
        """Say that a value lies outside: refuse, warn the first time, or nothing, as `outside` has it.

        Raises:
            OutsideValidityError: the model is to refuse.
        """
        model = getattr(self, "model", type(self).__name__)
        if self.outside == "refuse":
            raise OutsideValidityError(
                name, value, f"{allowed}, the validity range of {model}; {OUTSIDE_KEY}"
            )
        if self.outside == "warn" and name not in self._warned:
            self._warned.add(name)
            shown = value if isinstance(value, str) else f"{value:g}"
            message = f"{name} = {shown}: outside {allowed}, the validity range of {model}"
            warnings.warn(message, ValidityWarning, stacklevel=4)
