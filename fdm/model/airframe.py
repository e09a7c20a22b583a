"""Airframes as data: a YAML file that names a JSBSim model and says how an autopilot's channels drive it.

A file is validated once, when it is loaded; an error names the file, the line and the key. Whether the model
exists, and has the properties named, shows when `fdm.model.jsbsim_model` loads it; that is an AirframeError too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from fdm.errors import AirframeError
from sitl_configs.config_file import read_model, unknown
from sitl_configs.settings import Settings

AIRFRAMES_DIR = Path(__file__).resolve().parents[2] / "sitl_configs" / "airframes"
"""Where airframes are looked up by name."""

Sensor = Literal["rangefinder", "windvane"]
PropertyName = Annotated[str, Field(pattern=r"^[A-Za-z_][\w./\[\]-]*$")]


class ServoChannel(Settings):
    """How one servo channel drives one JSBSim property: clip(sign * scale_per_us * (pwm - offset_us), range).

    Attributes:
        channel: ArduPilot's SERVO number, 1 to 32.
        property: JSBSim property that is written.
        offset_us: pulse width at which the property is zero.
        scale_per_us: change of the property per us.
        sign: -1 turns the direction round (JSBSim's +elevator is nose down, ArduPilot's is nose up).
        range: lowest and highest value written.
        no_output: value while the channel has no output (pwm 0), within the range.
    """

    channel: Annotated[int, Field(ge=1, le=32)]
    property: PropertyName
    offset_us: float = 1000.0
    scale_per_us: Annotated[float, Field(gt=0)] = 0.001
    sign: Literal[1, -1] = 1
    range: tuple[float, float] = (0.0, 1.0)
    no_output: float = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.range[0] < self.range[1]:
            raise ValueError(f"range {list(self.range)}: the first must be below the second")
        if not self.range[0] <= self.no_output <= self.range[1]:
            raise ValueError(f"no_output {self.no_output}: outside the range {list(self.range)}")
        return self


class ChannelValues(dict[int, float]):
    """What a channel writes to its property, by pulse width in us; each is worked out once."""

    def __init__(self, channel: ServoChannel) -> None:
        super().__init__({0: channel.no_output})
        self._channel = channel

    def __missing__(self, pwm_us: int) -> float:
        channel = self._channel
        low, high = channel.range
        value = channel.sign * channel.scale_per_us * (pwm_us - channel.offset_us)
        self[pwm_us] = value = low if value < low else high if value > high else value
        return value


class JsbsimConfig(Settings):
    """The JSBSim side of an airframe.

    Attributes:
        model: name of the aircraft's directory and file.
        root: directory that holds aircraft/<model>/<model>.xml (and its engines in aircraft/<model>/Engines),
            relative to the airframe's file; None = that of the jsbsim package. Engines that are not found there
            come from the jsbsim package.
        min_rate_hz: slowest rate at which the ground contact is stable; slower frames are split into equal
            steps. Lags, rate limits and integrators of the model's flight control are those of 400 steps per second,
            or of this rate if it is higher (fdm.model.jsbsim_model).
        properties: values set once, before the initial conditions.
    """

    model: Annotated[str, Field(pattern=r"^[\w-]+$")]
    root: Path | None = None
    min_rate_hz: Annotated[float, Field(gt=0, le=10_000)]
    properties: dict[PropertyName, float] = Field(default_factory=dict)


class InitialConditions(Settings):
    """Where a UA starts, over its home.

    Attributes:
        height_above_ground_m: of the model's reference point.
        settle_s: sim time run before the first reply, so that the landing gear is at rest.
    """

    height_above_ground_m: Annotated[float, Field(ge=0, le=1000)]
    settle_s: Annotated[float, Field(ge=0, le=60)] = 3.0


class Px4Airframe(Settings):
    """What PX4 needs to know to fly an airframe.

    Attributes:
        autostart: PX4's own airframe (SYS_AUTOSTART) whose defaults it begins with.
        parameters: what differs; those that are whole numbers in PX4 are written as such.
    """

    autostart: Annotated[int, Field(ge=1)]
    parameters: dict[str, int | float] = Field(default_factory=dict)

    @property
    def motors(self) -> frozenset[int]:
        """Outputs that are motors (PX4's functions 101 to 112), counted from 1."""
        return frozenset(
            output
            for output in range(1, 17)
            if 101 <= self.parameters.get(f"PWM_MAIN_FUNC{output}", 0) <= 112
        )


class Airframe(Settings):
    """One airframe; see docs/reference/fdm-airframes.md for a worked example.

    Attributes:
        name: of the airframe.
        description: one line for people.
        vehicle: which ArduPilot flies it.
        jsbsim: the flight model.
        initial: its start.
        channels: what the servo channels drive; several may share a channel.
        sensors: optional sensors that are sent to the autopilot.
        ardupilot_parameters: parameters that ArduPilot needs for this airframe.
        px4: what PX4 needs; None: it is not known to fly it.
    """

    name: str
    description: str = ""
    vehicle: Literal["copter", "plane", "rover", "sub", "heli"]
    jsbsim: JsbsimConfig
    initial: InitialConditions
    channels: Annotated[tuple[ServoChannel, ...], Field(min_length=1)]
    sensors: tuple[Sensor, ...] = ()
    ardupilot_parameters: dict[str, float] = Field(default_factory=dict)
    px4: Px4Airframe | None = None

    @field_validator("channels")
    @classmethod
    def _each_property_once(cls, channels: tuple[ServoChannel, ...]) -> tuple[ServoChannel, ...]:
        names = [channel.property for channel in channels]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"property {name} is driven by more than one channel")
        return channels


def airframe_names() -> list[str]:
    """Names of the airframes that ship, sorted."""
    return sorted(path.stem for path in AIRFRAMES_DIR.glob("*.yaml"))


def load_airframe(name_or_path: str | Path) -> Airframe:
    """Load an airframe by name (``f450``) or from a YAML file.

    Raises:
        AirframeError: no such airframe, or the file is wrong; the text says where.
    """
    path = _find(name_or_path)
    return _with_absolute_root(read_model(path, Airframe, AirframeError), path)


def _find(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        if not path.is_file():
            raise AirframeError(f"no airframe file {path}")
        return path
    path = AIRFRAMES_DIR / f"{name_or_path}.yaml"
    if not path.is_file():
        raise AirframeError(unknown("unknown airframe", name_or_path, airframe_names()))
    return path


def _with_absolute_root(airframe: Airframe, path: Path) -> Airframe:
    if airframe.jsbsim.root is None:
        return airframe
    root = (path.resolve().parent / airframe.jsbsim.root).resolve()
    if not root.is_dir():
        raise AirframeError(f"{path}: jsbsim.root: no directory {root}")
    return airframe.model_copy(update={"jsbsim": airframe.jsbsim.model_copy(update={"root": root})})
