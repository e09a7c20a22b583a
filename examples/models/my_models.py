"""Models of one's own for a radio: a class per model, named in YAML as `class: my_models.py:Name`.

    lostlink link --radio corrected --distance 400 --set propagation.class=examples/models/my_models.py:ThroughForest

Methods take and return arrays; `channel/propagation/path_loss.py`, `channel/fading/laws.py`, `channel/antenna.py` and
`channel/phy/error_model.py` say what each kind of model needs. Fields are the keys of the YAML, checked by pydantic.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from channel.checks import FloatArray
from channel.geometry import Path
from channel.phy.error_model import Band, Smooth
from channel.propagation.path_loss import FreeSpace
from channel.variant import Variant


class ThroughForest(Variant):
    """Free space and what trees take: Weissberger's exponential decay, 230 MHz to 95 GHz, 14 to 400 m of dry trees."""

    depth_m: float = Field(default=50.0, ge=14.0, le=400.0)

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return free space + 1.33 f^0.284 depth^0.588, f in GHz."""
        ghz = np.divide(path.frequency_hz, 1e9)
        return FreeSpace().path_loss_db(path) + 1.33 * np.power(ghz, 0.284) * self.depth_m**0.588


class Cardioid(Variant):
    """A patch on the nose: (1 + cos angle) / 2 in amplitude, never below 20 dB under its peak."""

    gain_db: float = 5.0

    @property
    def needs_direction(self) -> bool:
        """True."""
        return True

    def towards_db(self, direction_frd: FloatArray, /) -> FloatArray:
        """Return the gain towards unit vectors in body axes (forward, right, down), dB."""
        amplitude = 0.5 * (1.0 + direction_frd[..., 0])
        return np.asarray(self.gain_db + 20.0 * np.log10(np.maximum(amplitude, 0.1)))


class Logistic(Smooth):
    """A packet error rate that falls with the SNR as a logistic curve, whatever the length."""

    half_db: float = 5.0
    width_db: float = Field(default=1.0, gt=0.0)

    def ber(self, snr_db: FloatArray, band: Band, /) -> FloatArray:
        """Return the packet error rate of one bit."""
        return self.per(snr_db, 0.125, band)

    def per(self, snr_db: FloatArray, _length_bytes: FloatArray | float, _band: Band, /) -> FloatArray:
        """Return 1 / (1 + exp((snr - half) / width))."""
        return np.asarray(
            1.0 / (1.0 + np.exp(np.clip((snr_db - self.half_db) / self.width_db, -700.0, 700.0)))
        )
