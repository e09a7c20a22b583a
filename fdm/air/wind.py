"""The air that each UA flies in: constant wind, gusts, turbulence and wind maps, added up.

A wind is data (YAML, see `load_wind`); `WindConfig.build` makes the wind that one UA feels. What it feels
depends on its own place, time and velocity, and on the seed and its id, but on no other UA and on no call
order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from fdm.air.turbulence import DrydenTurbulence
from fdm.air.wind_map import MapWind, load_wind_map
from fdm.errors import WindError
from fdm.model.air_point import AirPoint, Wind
from fdm.model.truth import Vector
from sitl_configs.config_file import read_model, unknown
from sitl_configs.settings import Settings, refused

WINDS_DIR = Path(__file__).resolve().parents[2] / "sitl_configs" / "wind"
KNOT_MPS = 1852.0 / 3600.0


class ConstantConfig(Settings):
    """The same wind everywhere.

    Attributes:
        speed_mps: of the air.
        from_deg: direction that it comes from, clockwise from true north.
        up_mps: vertical part, positive upwards.
    """

    speed_mps: Annotated[float, Field(ge=0, le=100)]
    from_deg: float = 0.0
    up_mps: Annotated[float, Field(ge=-50, le=50)] = 0.0

    def ned_mps(self) -> Vector:
        """As a vector, NED m/s; no component is -0.0."""
        angle = radians(self.from_deg)
        return (0.0 - self.speed_mps * cos(angle), 0.0 - self.speed_mps * sin(angle), 0.0 - self.up_mps)


class GustConfig(Settings):
    """A discrete gust: rises and falls as 1 - cos, and holds between (MIL-F-8785C, 3.7.1.3).

    Attributes:
        speed_mps: at its height.
        from_deg: direction that it comes from.
        up_mps: vertical part at its height.
        start_s: sim time at which it begins.
        rise_s, hold_s, fall_s: durations.
        every_s: it comes again after this long; None = once.
    """

    speed_mps: Annotated[float, Field(ge=0, le=100)]
    from_deg: float = 0.0
    up_mps: Annotated[float, Field(ge=-50, le=50)] = 0.0
    start_s: Annotated[float, Field(ge=0)]
    rise_s: Annotated[float, Field(gt=0)] = 1.0
    hold_s: Annotated[float, Field(ge=0)] = 0.0
    fall_s: Annotated[float, Field(gt=0)] = 1.0
    every_s: Annotated[float, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _over_before_it_comes_again(self) -> Self:
        if self.every_s is not None and self.every_s < self.rise_s + self.hold_s + self.fall_s:
            lasts_s = self.rise_s + self.hold_s + self.fall_s
            raise refused(f"{self.every_s:g} is shorter than the gust itself, {lasts_s:g} s", "every_s")
        return self


class TurbulenceConfig(Settings):
    """Dryden turbulence (MIL-F-8785C): give `level` or `w20_mps`.

    Attributes:
        level: light, moderate or severe: wind at 20 ft of 15, 30 or 45 knots.
        w20_mps: wind at 20 ft (6 m) above the ground, m/s.
    """

    level: Literal["light", "moderate", "severe"] | None = None
    w20_mps: Annotated[float, Field(gt=0, le=100)] | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.level is None) == (self.w20_mps is None):
            raise ValueError("give either level or w20_mps")
        return self

    def wind_at_20ft_mps(self) -> float:
        """Wind at 20 ft, m/s."""
        knots = {"light": 15.0, "moderate": 30.0, "severe": 45.0}
        return self.w20_mps if self.w20_mps is not None else knots[self.level or "light"] * KNOT_MPS


class MapConfig(Settings):
    """A wind map, see fdm.air.wind_map.

    Attributes:
        file: NetCDF file, relative to the YAML file.
        outside: what a UA outside the grid feels: the nearest edge's wind, or an error that ends the UA.
    """

    file: Path
    outside: Literal["clamp", "error"] = "clamp"


class WindConfig(Settings):
    """A wind: the sum of its parts.

    Attributes:
        description: one line for people.
        constant, gusts, turbulence, map: the parts, each may be left out.
    """

    description: str = ""
    constant: ConstantConfig | None = None
    gusts: tuple[GustConfig, ...] = ()
    turbulence: TurbulenceConfig | None = None
    map: MapConfig | None = None

    def build(self, *, seed: int, ua_id: int) -> Wind:
        """The wind that UA `ua_id` feels in a run with `seed`; a `ConstantWind` if it never changes.

        Raises:
            WindError: the wind map cannot be used.
        """
        constant = ConstantWind((0.0, 0.0, 0.0) if self.constant is None else self.constant.ned_mps())
        if self.map is None and self.turbulence is None and not self.gusts:
            return constant
        steady: list[Wind] = [constant]
        if self.map is not None:
            steady.append(MapWind(load_wind_map(self.map.file), self.map.outside))
        steady.extend(Gust(config) for config in self.gusts)
        mean = SumOfWinds(steady)
        if self.turbulence is None:
            return mean
        return DrydenTurbulence(mean, self.turbulence.wind_at_20ft_mps(), seed=seed, ua_id=ua_id)


@dataclass(frozen=True)
class ConstantWind:
    """The same wind everywhere and always."""

    ned_mps: Vector

    def air_ned_mps(self, point: AirPoint) -> Vector:  # noqa: ARG002 - the same everywhere
        """The wind."""
        return self.ned_mps


class Gust:
    """A discrete gust of 1 - cosine shape."""

    def __init__(self, config: GustConfig) -> None:
        self._config = config
        height = ConstantConfig(speed_mps=config.speed_mps, from_deg=config.from_deg, up_mps=config.up_mps)
        self._height_ned_mps = height.ned_mps()

    def air_ned_mps(self, point: AirPoint) -> Vector:
        """The gust's part of the wind."""
        share = self._share(point.sim_time_ns / 1e9)
        north, east, down = self._height_ned_mps
        return (share * north, share * east, share * down)

    def _share(self, time_s: float) -> float:
        config = self._config
        since_s = time_s - config.start_s
        if since_s < 0:
            return 0.0
        if config.every_s is not None:
            since_s %= config.every_s
        if since_s < config.rise_s:
            return 0.5 * (1 - cos(pi * since_s / config.rise_s))
        left_s = config.rise_s + config.hold_s + config.fall_s - since_s
        if left_s <= 0:
            return 0.0
        return 1.0 if left_s >= config.fall_s else 0.5 * (1 - cos(pi * left_s / config.fall_s))


class SumOfWinds:
    """Winds added up."""

    def __init__(self, parts: Sequence[Wind]) -> None:
        self._parts = tuple(parts)

    def air_ned_mps(self, point: AirPoint) -> Vector:
        """The sum."""
        north = east = down = 0.0
        for part in self._parts:
            n, e, d = part.air_ned_mps(point)
            north, east, down = north + n, east + e, down + d
        return (north, east, down)


def wind_names() -> list[str]:
    """Names of the winds that ship, sorted."""
    return sorted(path.stem for path in WINDS_DIR.glob("*.yaml"))


def load_wind(name_or_path: str | Path) -> WindConfig:
    """Load a wind by name (``calm``) or from a YAML file.

    Raises:
        WindError: no such wind, or the file is wrong; the text says where.
    """
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml"):
        if not path.is_file():
            raise WindError(f"no wind file {path}")
    elif not (path := WINDS_DIR / f"{name_or_path}.yaml").is_file():
        raise WindError(unknown("no wind", name_or_path, wind_names()))
    return _with_map_from(path.resolve().parent, read_model(path, WindConfig, WindError))


def wind_from_mapping(mapping: Mapping[str, Any]) -> WindConfig:
    """The wind of a mapping with the keys of a wind's file; a `preset` in it is the wind that the other keys change.

    Raises:
        WindError: there is no such preset, or its file is wrong.
        ValidationError: a key or value of the mapping is wrong.
    """
    own = {key: value for key, value in mapping.items() if key != "preset"}
    preset = mapping.get("preset")
    if preset is None:
        return WindConfig.model_validate(own)
    if not isinstance(preset, str):
        raise WindError(f"preset: has to be the name of a wind, or a YAML file (got {preset!r})")
    below = load_wind(preset).model_dump(exclude_none=True)
    return WindConfig.model_validate(_laid_over(below, own))


def _laid_over(below: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """One wind's parts over another's, key by key; the two ways to give turbulence exclude each other."""
    merged = dict(below)
    for key, value in over.items():
        old = merged.get(key)
        replaced = key == "turbulence" or not (isinstance(old, Mapping) and isinstance(value, Mapping))
        merged[key] = value if replaced else _laid_over(old or {}, value)
    return merged


def _with_map_from(folder: Path, config: WindConfig) -> WindConfig:
    """The wind with the absolute path of its map, as seen from a folder."""
    if config.map is None:
        return config
    file = (folder / config.map.file).resolve()
    return config.model_copy(update={"map": config.map.model_copy(update={"file": file})})
