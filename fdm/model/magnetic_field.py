"""The earth's magnetic field: the World Magnetic Model, by pygeomag."""

from __future__ import annotations

from fdm.model.geodesy import GeodeticPosition
from fdm.model.truth import Vector

NANOTESLA_PER_GAUSS = 1e5
SECONDS_PER_YEAR = 31_556_952
"""Mean year of the Gregorian calendar."""
_EPOCHS = (2010, 2015, 2020, 2025)
_SPAN_YEARS = 5


def magnetic_field_ned_gauss(place: GeodeticPosition, unix_s: float) -> Vector:
    """The field at a place and time: north, east, down, gauss.

    Args:
        place: where.
        unix_s: when, s since 1970. The model's coefficients are those of its five years; before 2010 and after the
            last one that there is, those of the nearest year that is covered.

    Source: NOAA NCEI and British Geological Survey, World Magnetic Model.
    """
    from pygeomag import GeoMag  # late: whoever flies no PX4 does without

    year = 1970.0 + unix_s / SECONDS_PER_YEAR
    epoch = max((each for each in _EPOCHS if each <= year), default=_EPOCHS[0])
    year = min(max(year, float(epoch)), float(epoch + _SPAN_YEARS))
    model = GeoMag(coefficients_file=f"wmm/WMM_{epoch}.COF")
    field = model.calculate(glat=place.lat_deg, glon=place.lon_deg, alt=place.alt_amsl_m / 1000.0, time=year)
    return (
        field.x / NANOTESLA_PER_GAUSS,
        field.y / NANOTESLA_PER_GAUSS,
        field.z / NANOTESLA_PER_GAUSS,
    )
