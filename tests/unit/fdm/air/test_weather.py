import math

import pytest
from click.testing import CliRunner
from pydantic import ValidationError

import fdm.__main__
from fdm.air.weather import WeatherConfig, in_weather
from fdm.errors import FdmError, WeatherError
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel

AIR_J_PER_KG_K = 287.05287
EARTH_M = 6_356_766.0


def home(alt_amsl_m):
    return Home(GeodeticPosition(47.0, 8.0, alt_amsl_m), 0.0)


def standard(alt_amsl_m, *, offset_k=0.0, home_m=None, qnh_hpa=1013.25):
    """(temperature K, pressure hPa, density kg/m^3), by stepping the hydrostatic equation up from home."""
    start = alt_amsl_m if home_m is None else home_m
    height, pressure = 0.0, qnh_hpa

    def step(to, pressure, height, offset):
        count = max(1, round(abs(to - height) * 5))
        rise = (to - height) / count
        for _ in range(count):
            middle = height + rise / 2
            gravity = 9.80665 * (EARTH_M / (EARTH_M + middle)) ** 2
            temperature = 288.15 + offset - 0.0065 * middle * EARTH_M / (EARTH_M + middle)
            pressure *= math.exp(-gravity * rise / (AIR_J_PER_KG_K * temperature))
            height += rise
        return pressure

    pressure = step(start, pressure, height, 0.0)
    pressure = step(alt_amsl_m, pressure, start, offset_k)
    temperature = 288.15 + offset_k - 0.0065 * alt_amsl_m * EARTH_M / (EARTH_M + alt_amsl_m)
    return temperature, pressure, pressure * 100.0 / (AIR_J_PER_KG_K * temperature)


def air_of(model):
    execute = model._exec
    return (
        execute["atmosphere/T-R"] / 1.8,
        execute["atmosphere/P-psf"] * 0.4788025898,
        execute["atmosphere/rho-slugs_ft3"] * 515.378818,
    )


@pytest.mark.parametrize("alt_amsl_m", [0.0, 488.0, 2500.0])
@pytest.mark.parametrize(
    ("weather", "offset_k", "qnh_hpa"),
    [
        ({}, 0.0, 1013.25),
        ({"temperature_offset_k": 20}, 20.0, 1013.25),
        ({"qnh_hpa": 980}, 0.0, 980.0),
        ({"temperature_offset_k": -15, "qnh_hpa": 1040}, -15.0, 1040.0),
    ],
)
def test_the_air_at_home_is_the_shifted_standard_atmosphere(alt_amsl_m, weather, offset_k, qnh_hpa):
    place = home(alt_amsl_m)
    airframe = in_weather(load_airframe("f450"), WeatherConfig.model_validate(weather), place)
    expected = standard(alt_amsl_m + 0.15, offset_k=offset_k, home_m=alt_amsl_m, qnh_hpa=qnh_hpa)
    assert air_of(JsbsimModel(airframe, place)) == pytest.approx(expected, rel=2e-5)


def test_the_air_above_home_thins_out_as_the_hydrostatic_equation_says():
    place = home(500.0)
    airframe = load_airframe("aerosonde")
    hot = in_weather(airframe, WeatherConfig(temperature_offset_k=25.0, qnh_hpa=990.0), place)
    model = JsbsimModel(hot, place)
    model._exec["ic/h-sl-ft"] = 2000.0 / 0.3048
    model._exec.run_ic()
    expected = standard(2000.0, offset_k=25.0, home_m=500.0, qnh_hpa=990.0)
    assert air_of(model) == pytest.approx(expected, rel=2e-5)


def test_a_temperature_on_the_ground_sets_the_offset():
    weather = WeatherConfig(ground_temperature_c=30.0)
    assert weather.offset_k(1000.0) == pytest.approx(30.0 - (15.0 - 6.5), abs=0.01)
    model = JsbsimModel(in_weather(load_airframe("f450"), weather, home(1000.0)), home(1000.0))
    assert air_of(model)[0] == pytest.approx(303.15, abs=0.01)


@pytest.mark.parametrize("offset_k", [-20.0, 0.0, 30.0])
def test_the_airspeed_sent_is_equivalent_and_that_in_truth_is_true(offset_k):
    place = home(1500.0)
    weather = WeatherConfig(temperature_offset_k=offset_k)
    model = JsbsimModel(in_weather(load_airframe("f450"), weather, place), place)
    model.set_wind((-12.0, 0.0, 0.0))
    model.step((18458, 400, 0, *(0,) * 16), 400)
    density = standard(1500.15, offset_k=offset_k, home_m=1500.0)[2]
    true_mps = model.truth(0, 0).airspeed_mps
    assert true_mps == pytest.approx(12.0, abs=0.01)
    assert model.sense()[15] == pytest.approx(true_mps * math.sqrt(density / 1.225), rel=1e-4)


def test_propellers_pull_less_in_thin_air():
    def thrust_n(weather):
        airframe = in_weather(load_airframe("hexa550"), weather, home(0.0))
        model = JsbsimModel(airframe, home(0.0))
        for _ in range(200):
            model.step((18458, 400, 0, *(1300,) * 6, *(0,) * 10), 400)
        return model._exec["propulsion/engine/thrust-lbs"] * 4.44822

    hot, cold = WeatherConfig(temperature_offset_k=40.0), WeatherConfig(temperature_offset_k=-40.0)
    assert 0.6 < thrust_n(hot) / thrust_n(cold) < 0.9


def test_the_standard_weather_changes_nothing():
    airframe = load_airframe("f450")
    assert in_weather(airframe, WeatherConfig(), home(488.0)) is airframe
    assert in_weather(airframe, WeatherConfig(temperature_offset_k=0.0), home(488.0)) is airframe


def test_the_command_line_sets_the_weather(monkeypatch):
    seen = []

    def no_exchange(specs, **_):
        seen.extend(specs)
        raise FdmError("enough")

    monkeypatch.setattr(fdm.__main__, "open_exchange", no_exchange)
    arguments = ["--home", "47,8,500,0", "--temperature-offset", "20", "--qnh", "990"]
    assert CliRunner().invoke(fdm.__main__.main, arguments).exit_code == 2
    model = JsbsimModel(seen[0].airframe, seen[0].home)
    expected = standard(500.15, offset_k=20.0, home_m=500.0, qnh_hpa=990.0)
    assert air_of(model) == pytest.approx(expected, rel=2e-5)


@pytest.mark.parametrize("alt_amsl_m", [50_000.0, 11_001.0, -2001.0, -EARTH_M])
def test_weather_is_for_homes_where_the_formulas_hold(alt_amsl_m):
    airframe = load_airframe("f450")
    assert in_weather(airframe, WeatherConfig(), home(alt_amsl_m)) is airframe
    with pytest.raises(WeatherError, match=r"home is at .* can be set from -2000 to 11000 m"):
        in_weather(airframe, WeatherConfig(qnh_hpa=990.0), home(alt_amsl_m))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"temperature_offset_k": 5, "ground_temperature_c": 20}, "not both"),
        ({"qnh_hpa": 29.92}, "greater than or equal to 850"),
        ({"temperature_offset_k": 300}, "less than or equal to 60"),
        ({"qnh": 1000}, "Extra inputs"),
        (
            {"qnh_hpa": 1000, "temperature_offset_k": True},
            "temperature_offset_k\n  Input should be a valid number",
        ),
    ],
)
def test_impossible_weather_is_refused(values, message):
    with pytest.raises(ValidationError, match=message):
        WeatherConfig.model_validate(values)
