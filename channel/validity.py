"""Ranges in which a model was measured: outside them it warns once, refuses, or says nothing, as configured."""

from __future__ import annotations

import warnings
from typing import Literal

import numpy as np
from pydantic import Field, PrivateAttr

from channel.checks import ChannelInputError, FloatArray
from channel.variant import Variant


class ValidityWarning(UserWarning):
    """A model is used outside the range that it was made for."""


class RangedVariant(Variant):
    """A model with a validity range."""

    outside: Literal["warn", "refuse", "ignore"] = Field(
        default="warn", description="what to do outside the model's validity range"
    )
    _warned: set[str] = PrivateAttr(default_factory=set)

    def within(self, name: str, value: FloatArray | float, low: float, high: float) -> None:
        """Act as configured if any of the values lies outside [low, high].

        Raises:
            ChannelInputError: it does, and the model is to refuse.
        """
        if self.outside == "ignore" or name in self._warned:
            return
        array = np.asarray(value)
        bad = (array < low) | (array > high)
        if not bad.any():
            return
        first = float(array[bad].flat[0])
        allowed = f"{low:g} to {high:g}, the validity range of {getattr(self, 'model', type(self).__name__)}"
        if self.outside == "refuse":
            raise ChannelInputError(name, first, allowed)
        self._warned.add(name)
        warnings.warn(f"{name} = {first:g}: outside {allowed}", ValidityWarning, stacklevel=3)
