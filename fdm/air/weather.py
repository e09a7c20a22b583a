"""Temperature and pressure of the air: the standard atmosphere (ISO 2533), shifted.

JSBSim's standard atmosphere takes a temperature deviation, the same at every height, and the pressure at sea level; it
integrates the pressure with the shifted temperature. Density, speed of sound, forces, propeller thrust and the ratio
of equivalent to true airspeed follow. Valid below 11 km; heights are geopotential in the formulas:

    T(H) = 288.15 K + offset - 6.5 K/km H
    p(H) = p_sea_level (1 - 6.5 K/km H / (288.15 K + offset))^5.25588
"""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from fdm.errors import WeatherError
from fdm.model.airframe import Airframe
from fdm.model.geodesy import Home
from sitl_configs.settings import Settings

SEA_LEVEL_TEMPERATURE_K = 288.15
SEA_LEVEL_PRESSURE_HPA = 1013.25
LAPSE_K_PER_M = 0.0065
EXPONENT = 9.80665 / (287.05287 * LAPSE_K_PER_M)
EARTH_RADIUS_M = 6_356_766.0
"""Of the geopotential height (ISO 2533)."""
CELSIUS_ZERO_K = 273.15
RANKINE_PER_K = 1.8
PSF_PER_HPA = 100.0 / 47.88025898
OFFSET_MAX_K = 60.0
QNH_RANGE_HPA = (850.0, 1100.0)
HOME_RANGE_M = (-2000.0, 11_000.0)
"""Heights of home, above mean sea level, at which the formulas hold."""


class WeatherConfig(Settings):
    """Temperature and pressure at home; without any of it the standard atmosphere.

    Attributes:
        temperature_offset_k: how much warmer than the standard atmosphere, at every height.
        ground_temperature_c: temperature at home instead, from which the offset follows.
        qnh_hpa: pressure at home, reduced to sea level in the standard atmosphere, as aerodromes report it.
    """

    temperature_offset_k: Annotated[float, Field(ge=-OFFSET_MAX_K, le=OFFSET_MAX_K)] | None = None
    ground_temperature_c: Annotated[float, Field(ge=-80, le=60)] | None = None
    qnh_hpa: Annotated[float, Field(ge=QNH_RANGE_HPA[0], le=QNH_RANGE_HPA[1])] = SEA_LEVEL_PRESSURE_HPA

    @model_validator(mode="after")
    def _at_most_one_temperature(self) -> Self:
        if self.temperature_offset_k is not None and self.ground_temperature_c is not None:
            raise ValueError("give temperature_offset_k or ground_temperature_c, not both")
        return self

    @property
    def is_standard(self) -> bool:
        """Whether it is the standard atmosphere."""
        shifted = self.temperature_offset_k or self.ground_temperature_c is not None
        return not shifted and self.qnh_hpa == SEA_LEVEL_PRESSURE_HPA

    def check(self, home_alt_amsl_m: float) -> None:
        """See that the formulas hold at a home.

        Raises:
            WeatherError: it is outside HOME_RANGE_M, and the atmosphere is not the standard one.
        """
        if not self.is_standard and not HOME_RANGE_M[0] <= home_alt_amsl_m <= HOME_RANGE_M[1]:
            raise WeatherError(
                f"weather: home is at {home_alt_amsl_m:g} m; temperature and pressure can be set from "
                f"{HOME_RANGE_M[0]:g} to {HOME_RANGE_M[1]:g} m"
            )

    def offset_k(self, home_alt_amsl_m: float) -> float:
        """Deviation from the standard atmosphere's temperature, K."""
        if self.ground_temperature_c is None:
            return self.temperature_offset_k or 0.0
        standard_k = SEA_LEVEL_TEMPERATURE_K - LAPSE_K_PER_M * geopotential_m(home_alt_amsl_m)
        return self.ground_temperature_c + CELSIUS_ZERO_K - standard_k

    def pressure_at_home_hpa(self, home_alt_amsl_m: float) -> float:
        """Pressure at home, hPa."""
        return self.qnh_hpa * _pressure_ratio(home_alt_amsl_m, 0.0)

    def sea_level_pressure_hpa(self, home_alt_amsl_m: float) -> float:
        """Pressure at sea level under air of this temperature, hPa; the QNH if the temperature is standard."""
        offset_k = self.offset_k(home_alt_amsl_m)
        return self.pressure_at_home_hpa(home_alt_amsl_m) / _pressure_ratio(home_alt_amsl_m, offset_k)


def geopotential_m(alt_amsl_m: float) -> float:
    """Geopotential height of a geometric height, m."""
    return EARTH_RADIUS_M * alt_amsl_m / (EARTH_RADIUS_M + alt_amsl_m)


def _pressure_ratio(alt_amsl_m: float, offset_k: float) -> float:
    """Pressure over that at sea level, in air that is `offset_k` warmer than the standard."""
    cooled = LAPSE_K_PER_M * geopotential_m(alt_amsl_m) / (SEA_LEVEL_TEMPERATURE_K + offset_k)
    return float((1.0 - cooled) ** EXPONENT)


def in_weather(airframe: Airframe, weather: WeatherConfig, home: Home) -> Airframe:
    """The airframe in this weather: its JSBSim model starts with these atmospheric properties.

    Args:
        airframe: what flies; its own settings of the atmosphere, if any, give way.
        weather: temperature and pressure.
        home: where they were measured.

    Raises:
        WeatherError: home is outside HOME_RANGE_M.
    """
    alt_amsl_m = home.position.alt_amsl_m
    weather.check(alt_amsl_m)
    if weather.is_standard:
        return airframe
    air = {
        "atmosphere/delta-T": weather.offset_k(alt_amsl_m) * RANKINE_PER_K,
        "atmosphere/P-sl-psf": weather.sea_level_pressure_hpa(alt_amsl_m) * PSF_PER_HPA,
    }
    jsbsim = airframe.jsbsim
    changed = jsbsim.model_copy(update={"properties": {**jsbsim.properties, **air}})
    return airframe.model_copy(update={"jsbsim": changed})
