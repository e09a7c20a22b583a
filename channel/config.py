"""What a radio is, as data: typed, validated once, frozen."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from channel.access.settings.base import Ideal, RadioOnAir
from channel.access.settings.elrs import ElrsMedium
from channel.access.settings.medium import MediumSettings
from channel.access.settings.sik import SikMedium
from channel.antenna import AntennaModel, HalfWaveDipole, Isotropic, Pattern, Polarisation, Sector
from channel.fading.bursts import GilbertElliott, NoBursts
from channel.fading.laws import Nakagami, NoFading, Rayleigh, Rician
from channel.fading.shadowing import (
    CorrelatedShadowing,
    NormalShadowing,
    NoShadowing,
    OneSidedNormalShadowing,
)
from channel.own.models import own_models
from channel.own.trials import (
    ANTENNA,
    BURSTS,
    ERROR,
    FADING,
    NOISE,
    PROPAGATION,
    SHADOWING,
    try_gain,
    try_lasting,
    try_losses,
    try_mean_loss,
)
from channel.phy.error_model import ErfcBytes, Lossless, NoncoherentFsk, SnrTable, Threshold, UncodedAwgn
from channel.phy.interference import Interference
from channel.phy.noise import FixedNoise, ManMadeNoise, NoiseModel, ThermalNoise
from channel.phy.ofdm import OfdmNist, OfdmYans
from channel.propagation.air_to_ground import AlHourani, RmaAv, UmaAv
from channel.propagation.atmosphere import ItuAtmosphere, NoAtmosphere
from channel.propagation.gain_map import GainMap
from channel.propagation.hata import Cost231Hata, OkumuraHata
from channel.propagation.path_loss import FreeSpace, LogDistance, NoPathLoss, PathLossModel
from channel.propagation.terrain import Terrain
from channel.propagation.two_ray import TwoRay, TwoSlope
from channel.routing.settings import NoRouting, RoutingSettings
from channel.variant import Variant, called, name_of
from sitl_configs.settings import Settings, refused

LAWS = ("propagation", "atmosphere", "shadowing", "fading", "noise", "bursts", "error", "antenna")
SHADOWING_METHODS = (
    "is_random",
    "decorrelation_m",
    "spread_db",
    "loss_db",
    "chance_below",
    "in_sight",
    "with_sigma",
)
Propagation = Annotated[
    FreeSpace
    | LogDistance
    | NoPathLoss
    | TwoRay
    | TwoSlope
    | OkumuraHata
    | Cost231Hata
    | AlHourani
    | UmaAv
    | RmaAv
    | Terrain
    | GainMap,
    Field(discriminator="model"),
    *own_models("propagation", "path_loss_db", base=PathLossModel, methods=PROPAGATION, trial=try_losses),
]
Shadowing = Annotated[
    NoShadowing | OneSidedNormalShadowing | NormalShadowing | CorrelatedShadowing,
    Field(discriminator="model"),
    *own_models("shadowing", *SHADOWING_METHODS, methods=SHADOWING, trial=try_lasting),
]
Fading = Annotated[
    NoFading | Rayleigh | Rician | Nakagami,
    Field(discriminator="model"),
    *own_models(
        "fading",
        "gain_db",
        "rule",
        "is_random",
        "by_elevation",
        "coherence",
        "max_coherence_s",
        methods=FADING,
        trial=try_gain,
    ),
]
Antenna = Annotated[
    Isotropic | HalfWaveDipole | Sector | Pattern,
    Field(discriminator="model"),
    *own_models("antenna", "needs_direction", "towards_db", methods=ANTENNA),
]
Atmosphere = Annotated[NoAtmosphere | ItuAtmosphere, Field(discriminator="model")]
Bursts = Annotated[
    NoBursts | GilbertElliott,
    Field(discriminator="model"),
    *own_models("bursts", "mean_loss", "loss_at", methods=BURSTS, trial=try_mean_loss),
]
Noise = Annotated[
    FixedNoise | ThermalNoise | ManMadeNoise,
    Field(discriminator="model"),
    *own_models("noise", "noise_floor_dbm", base=NoiseModel, methods=NOISE),
]
Error = Annotated[
    ErfcBytes | UncodedAwgn | NoncoherentFsk | OfdmNist | OfdmYans | SnrTable | Lossless | Threshold,
    Field(discriminator="model"),
    *own_models("error", "breaks_db", "ber", "per", methods=ERROR),
]


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
    frequency_hz: float = Field(ge=1e6, le=1e12, description="carrier, Hz: 2412 MHz are 2.412e+9")
    bandwidth_hz: float = Field(default=20e6, gt=0.0, le=1e11, description="noise bandwidth")
    bit_rate_bps: float = Field(default=20e6, gt=0.0, le=1e12, description="bit rate on air")
    transmit_power_dbm: float = Field(ge=-200.0, le=200.0)
    antenna: Antenna = Field(default_factory=Isotropic, description="of both ends")
    receive_antenna: Antenna | None = Field(default=None, description="of the receiver, if it is another")
    polarisation: Polarisation | None = Field(
        default=None, description="loss by the attitudes of the two ends"
    )
    default_height_m: float = Field(default=40.0, gt=0.0, description="of both ends, where none is given")
    min_distance_m: float = Field(default=1.0, gt=0.0, description="shorter distances count as this")
    max_range_m: float | None = Field(default=None, gt=0.0, description="nothing is received beyond it")
    offset_db: float = Field(
        default=0.0, description="added to what is received, wanted or not (the paper's delta)"
    )
    cable_loss_db: float = Field(
        default=0.0, ge=0.0, le=100.0, description="between radio and antenna, at each end"
    )
    receive_cable_loss_db: float | None = Field(
        default=None, ge=0.0, le=100.0, description="of the receiver, if it is another"
    )
    propagation: Propagation = Field(default_factory=FreeSpace)
    earth_radius_factor: float | None = Field(
        default=4.0 / 3.0, ge=0.1, le=100.0, description="by which the air bends rays; null: a flat Earth"
    )
    atmosphere: Atmosphere = Field(default_factory=NoAtmosphere, description="gases and rain")
    shadowing: Shadowing = Field(default_factory=NoShadowing)
    fading: Fading = Field(default_factory=NoFading)
    noise: Noise = Field(default_factory=ThermalNoise)
    interference: Interference = Field(default_factory=Interference)
    error: Error = Field(default_factory=UncodedAwgn)
    length: Length = Field(default_factory=PayloadLength)
    mtu_bytes: int = Field(default=65535, ge=1, le=1 << 20, description="longest payload that it takes")
    nominal_payload_bytes: int = Field(default=40, ge=0, le=65535, description="where no length is given")
    base_loss: float = Field(
        default=0.0,
        ge=0.0,
        le=1.0,
        description="share of packets lost whatever the range (interference, ...)",
    )
    bursts: Bursts = Field(default_factory=NoBursts)
    medium: MediumSettings = Field(
        default_factory=Ideal, description="who transmits when, for how long and how often"
    )
    routing: RoutingSettings = Field(
        default_factory=NoRouting, description="whether nodes hand packets on, and how they find routes"
    )

    @model_validator(mode="after")
    def _has_a_sigma(self) -> Self:
        if self.shadowing.in_sight(True) is None and not self.propagation.has_sigmas:
            text = "is missing: only uma-av and rma-av with a drawn line of sight have their own"
            raise refused(text, "shadowing", "sigma_db")
        return self

    @model_validator(mode="after")
    def _can_be_routed(self) -> Self:
        if isinstance(self.routing, NoRouting):
            return self
        routing, medium = name_of(self.routing), name_of(self.medium)
        if isinstance(self.medium, Ideal):
            raise refused(
                f"{routing}: each hop takes time on the air, and with medium: {medium} nothing does: "
                "take airtime, csma, tdma or delay",
                "routing",
            )
        if isinstance(self.medium, SikMedium | ElrsMedium):
            raise refused(
                f"{routing}: with medium: {medium} a radio has one peer, and cannot hand on", "routing"
            )
        return self

    @property
    def on_air(self) -> RadioOnAir:
        """As media see it."""
        filter_rows = self.interference.filter_rows(self.bandwidth_hz)
        return RadioOnAir(self.bit_rate_bps, self.bandwidth_hz, filter_rows)

    @property
    def laws(self) -> dict[str, str]:
        """What each of its models is called, by key, but for those that do nothing."""
        names = {key: called(getattr(self, key)) for key in LAWS}
        return {key: name for key, name in names.items() if name != "none"}

    @property
    def receiving_antenna(self) -> AntennaModel:
        """The receiver's antenna."""
        return self.antenna if self.receive_antenna is None else self.receive_antenna

    @property
    def receiving_cable_loss_db(self) -> float:
        """What the receiver's cable takes, dB."""
        return self.cable_loss_db if self.receive_cable_loss_db is None else self.receive_cable_loss_db

    @property
    def noise_floor_dbm(self) -> float:
        """The noise power at the receiver, behind its cable, dBm."""
        return self.noise.behind_cable_dbm(self.bandwidth_hz, self.frequency_hz, self.receiving_cable_loss_db)
