"""What a radio is, as data: typed, validated once, frozen."""

from __future__ import annotations

from typing import Annotated, Literal, Protocol

from pydantic import Field

from channel.antenna import Isotropic
from channel.error_model import ErfcBytes, Lossless, Threshold, UncodedAwgn
from channel.noise import FixedNoise, ThermalNoise
from channel.path_loss import FreeSpace, LogDistance, NoPathLoss
from channel.shadowing import NormalShadowing, NoShadowing, OneSidedNormalShadowing
from channel.variant import Settings, Variant

Propagation = Annotated[FreeSpace | LogDistance | NoPathLoss, Field(discriminator="model")]
Shadowing = Annotated[NoShadowing | OneSidedNormalShadowing | NormalShadowing, Field(discriminator="model")]
Noise = Annotated[FixedNoise | ThermalNoise, Field(discriminator="model")]
Error = Annotated[ErfcBytes | UncodedAwgn | Lossless | Threshold, Field(discriminator="model")]


class LengthModel(Protocol):
    """How long a packet is on air."""

    def length_bytes(self, payload_bytes: int, /) -> int:
        """Return the length that the error model counts, bytes."""
        ...


class FixedLength(Variant):
    """Every packet counts as this long, whatever it carries (the paper's 40 bytes)."""

    model: Literal["fixed"] = "fixed"
    fixed_bytes: int = Field(alias="length_bytes", ge=0, le=65535)

    def length_bytes(self, _payload_bytes: int, /) -> int:
        """Return the fixed length."""
        return self.fixed_bytes


class PayloadLength(Variant):
    """A packet is as long as its payload plus the headers of the layers below."""

    model: Literal["payload"] = "payload"
    overhead_bytes: int = Field(default=0, ge=0, le=1000)

    def length_bytes(self, payload_bytes: int, /) -> int:
        """Return payload + overhead."""
        return payload_bytes + self.overhead_bytes


Length = Annotated[FixedLength | PayloadLength, Field(discriminator="model")]


class RadioConfig(Settings):
    """A radio: everything between a transmitted packet and its fate, positions aside."""

    name: str = Field(default="custom", description="what reports call it")
    description: str = Field(default="", description="one line")
    source: str = Field(default="", description="where the numbers come from")
    frequency_hz: float = Field(gt=0.0, le=1e12, description="carrier")
    bandwidth_hz: float = Field(default=20e6, gt=0.0, le=1e11, description="noise bandwidth")
    bit_rate_bps: float = Field(default=20e6, gt=0.0, le=1e12, description="bit rate on air")
    transmit_power_dbm: float = Field(ge=-200.0, le=200.0)
    antenna: Isotropic = Field(default_factory=Isotropic, description="of both ends")
    default_height_m: float = Field(default=40.0, gt=0.0, description="of both ends, where none is given")
    min_distance_m: float = Field(default=1.0, gt=0.0, description="shorter distances count as this")
    max_range_m: float | None = Field(default=None, gt=0.0, description="nothing is received beyond it")
    offset_db: float = Field(default=0.0, description="added to the received power (the paper's delta)")
    propagation: Propagation = Field(default_factory=FreeSpace)
    shadowing: Shadowing = Field(default_factory=NoShadowing)
    noise: Noise = Field(default_factory=ThermalNoise)
    error: Error = Field(default_factory=UncodedAwgn)
    length: Length = Field(default_factory=PayloadLength)
    nominal_payload_bytes: int = Field(default=40, ge=0, le=65535, description="where no length is given")
    base_loss: float = Field(
        default=0.0,
        ge=0.0,
        le=1.0,
        description="share of packets lost whatever the range (interference, ...)",
    )
