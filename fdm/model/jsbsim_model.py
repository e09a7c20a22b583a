"""One airframe's flight model in JSBSim: the only module that imports JSBSim.

Signs and frames: body axes FRD, local axes NED. Specific force is the sum of the forces other than gravity on
the body axes over the mass, of the current frame, at the centre of gravity and with the landing gear's part
(``forces/fb?-total-lbs / inertia/mass-slugs``): JSBSim's own ``accelerations/a-pilot-*`` lag one frame
behind.
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Callable, Sequence
from math import atan2, ceil, cos, isfinite, radians
from pathlib import Path

import jsbsim

from fdm.errors import AirframeError, ModelDivergedError
from fdm.model.air_point import AirPoint, StaticAir
from fdm.model.airframe import Airframe, ChannelValues
from fdm.model.geodesy import LATLON_SCALE_M_PER_DEG, LONGITUDE_SCALE_MIN, Home
from fdm.model.ground_contact import slowest_stable_rate_hz
from fdm.model.truth import TrueState, Vector, quaternion_from_euler
from fdm.wire.servo_packet import PWM_OFFSET, Fields

FOOT_M = 0.3048
SLUG_KG = 14.59390294
PSF_PA = 47.88025898
RANKINE_K = 5.0 / 9.0
SETTLE_RATE_HZ = 400.0
DEPTH_MAX_M = 0.1
"""Of the centre of gravity below the ground, of what lies on its belly."""

_log = logging.getLogger(__name__)

Getter = Callable[[], float]

_SENSED = (
    "velocities/pi-rad_sec",
    "velocities/qi-rad_sec",
    "velocities/ri-rad_sec",
    "inertia/mass-slugs",
    "forces/fbx-total-lbs",
    "forces/fby-total-lbs",
    "forces/fbz-total-lbs",
    "position/lat-geod-deg",
    "position/long-gc-deg",
    "position/geod-alt-ft",
    "attitude/phi-rad",
    "attitude/theta-rad",
    "attitude/psi-rad",
    "velocities/v-north-fps",
    "velocities/v-east-fps",
    "velocities/v-down-fps",
    "velocities/ve-fps",
)
_TRUTH_ONLY = (
    "velocities/vtrue-fps",
    "atmosphere/total-wind-north-fps",
    "atmosphere/total-wind-east-fps",
    "atmosphere/total-wind-down-fps",
)


class _Console(jsbsim.FGLogger):
    """Takes JSBSim's console: all of it to the debug log, errors kept for the message of a failed load."""

    def __init__(self) -> None:
        super().__init__()
        self.errors: list[str] = []
        self._text = ""
        self._level = jsbsim.LogLevel.INFO

    def set_level(self, level: jsbsim.LogLevel) -> None:
        self._level = level

    def file_location(self, filename: str, line: int) -> None:
        self._text += f"{filename}:{line}: "

    def message(self, message: str) -> None:
        self._text += message

    def format(self, format: jsbsim.LogFormat) -> None:  # noqa: A002 - JSBSim's name
        """Colours: not ours."""

    def flush(self) -> None:
        text = " ".join(self._text.split())
        self._text = ""
        if not text:
            return
        _log.debug("JSBSim: %s", text)
        if self._level >= jsbsim.LogLevel.ERROR:
            self.errors.append(text)


class JsbsimModel:
    """The flight model of one UA, standing settled at its home.

    Args:
        airframe: what flies.
        home: where it stands.

    Raises:
        AirframeError: JSBSim cannot load the model, or a property named in the airframe is not there.
    """

    def __init__(self, airframe: Airframe, home: Home) -> None:
        self._airframe = airframe
        self._home = home
        self._exec = _load(airframe)
        manager = self._exec.get_property_manager()

        def node(name: str) -> jsbsim.FGPropertyNode:
            found = manager.get_node(name)
            if found is None:
                raise AirframeError(
                    f"airframe {airframe.name}: JSBSim model {airframe.jsbsim.model} has no property {name}"
                )
            return found

        def set_once(key: str, name: str, value: float) -> None:
            if not node(name).set_double_value(value):
                raise AirframeError(
                    f"airframe {airframe.name}: {key}: JSBSim computes the property {name}, which cannot be set"
                )

        for channel in airframe.channels:
            set_once("channels", channel.property, node(channel.property).get_double_value())
        self._drivers = tuple(
            (channel.channel - 1, node(channel.property).set_double_value, ChannelValues(channel))
            for channel in airframe.channels
        )
        self._channels_needed = max(channel.channel for channel in airframe.channels)
        for name, value in airframe.jsbsim.properties.items():
            set_once("jsbsim.properties", name, value)
        self._truth_only = tuple(node(name).get_double_value for name in _TRUTH_ONLY)
        self._north, self._east, self._down = (
            node(f"velocities/v-{axis}-fps").get_double_value for axis in ("north", "east", "down")
        )
        self._wind = tuple(
            node(f"atmosphere/wind-{axis}-fps").set_double_value for axis in ("north", "east", "down")
        )
        self._rate_hz = 0
        self._substeps = 1
        self._last_pwm: Fields = ()
        try:
            self._start()
        except jsbsim.BaseError as error:
            _never_end(self._exec)
            text = " ".join(str(error).split())
            raise AirframeError(
                f"airframe {airframe.name}: JSBSim model {airframe.jsbsim.model} does not run: {text}"
            ) from error
        self.sense: Callable[[], tuple[float, ...]] = _make_sense(
            [node(name).get_double_value for name in _SENSED], home, airframe, node
        )
        self._run = self._exec.run

    @property
    def home(self) -> Home:
        """Where the UA started."""
        return self._home

    def step(self, fields: Fields, rate_hz: int) -> None:
        """Drive the channels and step by 1 / rate_hz.

        Args:
            fields: an unpacked servo packet.
            rate_hz: frame rate, Hz.

        Raises:
            ModelDivergedError: JSBSim gave up.
        """
        if rate_hz != self._rate_hz:
            self._set_rate(rate_hz)
        pwm = fields[PWM_OFFSET:]
        if pwm != self._last_pwm:
            self._last_pwm = pwm
            self._drive(pwm)
        try:
            if self._substeps == 1:
                self._run()
            else:
                for _ in range(self._substeps):
                    self._run()
        except Exception as error:  # whatever JSBSim throws ends this UA, and only this one
            _never_end(self._exec)
            raise ModelDivergedError(f"JSBSim stopped: {' '.join(str(error).split())}") from error

    def set_wind(self, wind_ned_mps: Vector) -> None:
        """Set the velocity of the air around the UA, m/s, from the next step on."""
        for setter, component in zip(self._wind, wind_ned_mps, strict=True):
            setter(component / FOOT_M)

    def air_point(self, sim_time_ns: int) -> AirPoint:
        """Where it is in the air at `sim_time_ns`."""
        alt_amsl_m = self._exec["position/geod-alt-ft"] * FOOT_M
        return AirPoint(
            sim_time_ns,
            self._exec["position/lat-geod-deg"],
            self._exec["position/long-gc-deg"],
            alt_amsl_m,
            alt_amsl_m - self._home.position.alt_amsl_m,
            (self._north() * FOOT_M, self._east() * FOOT_M, self._down() * FOOT_M),
        )

    def air(self) -> StaticAir:
        """Pressure and temperature where it is: those of the standard atmosphere, as the weather has shifted them."""
        return StaticAir(self._exec["atmosphere/P-psf"] * PSF_PA, self._exec["atmosphere/T-R"] * RANKINE_K)

    def truth(self, ua_id: int, sim_time_ns: int) -> TrueState:
        """The true state, stamped `sim_time_ns`."""
        values = self.sense()
        airspeed, *wind = (getter() * FOOT_M for getter in self._truth_only)
        return TrueState(
            ua_id=ua_id,
            sim_time_ns=sim_time_ns,
            lat_deg=self._exec["position/lat-geod-deg"],
            lon_deg=self._exec["position/long-gc-deg"],
            alt_amsl_m=self._exec["position/geod-alt-ft"] * FOOT_M,
            position_ned_m=(values[6], values[7], values[8]),
            velocity_ned_mps=(values[12], values[13], values[14]),
            attitude_wxyz=quaternion_from_euler(values[9], values[10], values[11]),
            body_rates_frd_radps=(values[0], values[1], values[2]),
            specific_force_frd_mps2=(values[3], values[4], values[5]),
            airspeed_mps=airspeed,
            wind_ned_mps=(wind[0], wind[1], wind[2]),
        )

    def _drive(self, pwm: Fields) -> None:
        if len(pwm) < self._channels_needed:
            pwm += (0,) * (self._channels_needed - len(pwm))
        for index, setter, values in self._drivers:
            setter(values[pwm[index]])

    def _set_rate(self, rate_hz: int) -> None:
        self._rate_hz = rate_hz
        self._substeps = substeps_at(rate_hz, self._airframe.jsbsim.min_rate_hz)
        self._exec.set_dt(1.0 / (rate_hz * self._substeps))

    def _check_ground_contact(self) -> None:
        config = self._airframe.jsbsim
        file = Path(self._exec.get_aircraft_path()) / config.model / f"{config.model}.xml"
        mass_kg = self._exec["inertia/mass-slugs"] * SLUG_KG
        if not mass_kg > 0.0:
            raise AirframeError(
                f"airframe {self._airframe.name}: {file}: the mass is {mass_kg:g} kg: it has to be above 0"
            )
        needed_hz = slowest_stable_rate_hz(file, mass_kg)
        if config.min_rate_hz < needed_hz:
            raise AirframeError(
                f"airframe {self._airframe.name}: jsbsim.min_rate_hz {config.min_rate_hz:g}: the landing gear of "
                f"{config.model} is unstable below {needed_hz:.0f} Hz (damping over mass); give at least that"
            )

    def _start(self) -> None:
        """Put the UA at its home and let the gear come to rest."""
        place, initial, model = self._home.position, self._airframe.initial, self._exec
        rate_hz = _rate_at_load_hz(self._airframe)
        model["ic/terrain-elevation-ft"] = place.alt_amsl_m / FOOT_M
        model["ic/lat-geod-deg"] = place.lat_deg
        model["ic/long-gc-deg"] = place.lon_deg
        model["ic/h-agl-ft"] = initial.height_above_ground_m / FOOT_M
        model["ic/psi-true-deg"] = self._home.yaw_deg
        if not model.run_ic():
            raise AirframeError(f"airframe {self._airframe.name}: JSBSim refuses the initial conditions")
        self._check_ground_contact()
        for _ in range(ceil(initial.settle_s * rate_hz)):
            model.run()
        if not isfinite(model["position/geod-alt-ft"]):
            raise AirframeError(
                f"airframe {self._airframe.name}: JSBSim model {self._airframe.jsbsim.model} left the finite numbers "
                "as it settled at its home: see its inertia and ground contacts"
            )
        depth_m = -model["position/h-agl-ft"] * FOOT_M
        if depth_m > DEPTH_MAX_M:
            raise AirframeError(
                f"airframe {self._airframe.name}: JSBSim model {self._airframe.jsbsim.model} sank {depth_m:.1f} m into "
                "the ground as it settled at its home: see its mass, and its ground contacts and their springs"
            )


def substeps_at(rate_hz: int, min_rate_hz: float) -> int:
    """Into how many equal steps a frame at `rate_hz` is split: none is longer than 1 / min_rate_hz."""
    return max(1, ceil(min_rate_hz / rate_hz))


def _never_end(executive: jsbsim.FGFDMExec) -> None:
    """Keep a model that threw an error: in its destructor JSBSim would throw it again, and the process would abort."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(executive))


def _rate_at_load_hz(airframe: Airframe) -> float:
    """Steps per second at which a model is loaded and settles.

    JSBSim computes the lags, rate limits and integrators of a model's flight control for the step that it has when it
    loads them, and never anew: steps of another length make them faster or slower by that ratio.
    """
    return max(SETTLE_RATE_HZ, airframe.jsbsim.min_rate_hz)


def _load(airframe: Airframe) -> jsbsim.FGFDMExec:
    console = _Console()
    jsbsim.set_logger(console)
    executive = jsbsim.FGFDMExec(_jsbsim_root())
    executive.set_debug_level(0)
    executive.set_dt(1.0 / _rate_at_load_hz(airframe))
    if airframe.jsbsim.root is not None:
        # Its engine/ stays JSBSim's own: a model keeps engines of its own in aircraft/<model>/Engines.
        executive.set_aircraft_path(str(airframe.jsbsim.root / "aircraft"))
    try:
        loaded = executive.load_model(airframe.jsbsim.model)
    except jsbsim.BaseError as error:
        console.errors.append(" ".join(str(error).split()))  # once more what the console has, mostly
        loaded = False
    if not loaded:
        reason = "; ".join(list(dict.fromkeys(console.errors))[-3:]) or "no reason given"
        raise AirframeError(f"airframe {airframe.name}: JSBSim model {airframe.jsbsim.model}: {reason}")
    return executive


def _jsbsim_root() -> str | None:
    """Where JSBSim's own engines are: by itself it looks in the interpreter's site-packages alone."""
    beside = Path(jsbsim.__file__).parent
    return str(beside) if (beside / "engine").is_dir() else None


def _make_sense(
    getters: Sequence[Getter],
    home: Home,
    airframe: Airframe,
    node: Callable[[str], jsbsim.FGPropertyNode],
) -> Callable[[], tuple[float, ...]]:
    """The function that reads one frame's numbers in the order of fdm.wire.sensor_frame, less the timestamp.

    A closure, as the node getters are then locals: it runs once per frame, and a property costs 0.1 us.
    """
    p, q, r, mass, fx, fy, fz, lat, lon, alt, phi, theta, psi, north, east, down, eas = getters
    home_lat, home_lon, home_alt_m = (
        home.position.lat_deg,
        home.position.lon_deg,
        home.position.alt_amsl_m,
    )
    scale, half_rad = LATLON_SCALE_M_PER_DEG, 0.5 * radians(1.0)

    def base() -> tuple[float, ...]:
        foot_per_slug = FOOT_M / mass()
        lat_deg = lat()
        d_lon = lon() - home_lon
        if not -180.0 <= d_lon < 180.0:
            d_lon = (d_lon + 180.0) % 360.0 - 180.0
        east_scale = cos(half_rad * (lat_deg + home_lat))
        if east_scale < LONGITUDE_SCALE_MIN:
            east_scale = LONGITUDE_SCALE_MIN
        return (
            p(),
            q(),
            r(),
            fx() * foot_per_slug,
            fy() * foot_per_slug,
            fz() * foot_per_slug,
            (lat_deg - home_lat) * scale,
            d_lon * scale * east_scale,
            home_alt_m - alt() * FOOT_M,
            phi(),
            theta(),
            psi(),
            north() * FOOT_M,
            east() * FOOT_M,
            down() * FOOT_M,
            eas() * FOOT_M,
        )

    extras = [_extra_sensor(name, node) for name in ("rangefinder", "windvane") if name in airframe.sensors]
    if not extras:
        return base

    def with_extras() -> tuple[float, ...]:
        values = base()
        for extra in extras:
            values += extra()
        return values

    return with_extras


def _extra_sensor(name: str, node: Callable[[str], jsbsim.FGPropertyNode]) -> Callable[[], tuple[float, ...]]:
    if name == "rangefinder":
        agl, phi, theta = (
            node(n).get_double_value for n in ("position/h-agl-ft", "attitude/phi-rad", "attitude/theta-rad")
        )

        def rangefinder() -> tuple[float, ...]:
            """Slant distance to flat ground along the body's down axis, m; 1e4 m when it looks up."""
            tilt = cos(phi()) * cos(theta())
            return (min(agl() * FOOT_M / tilt, 1e4) if tilt > 1e-3 else 1e4,)

        return rangefinder
    u, v = (node(n).get_double_value for n in ("velocities/u-aero-fps", "velocities/v-aero-fps"))

    def windvane() -> tuple[float, ...]:
        """Where the apparent wind comes from, rad from the nose, and its speed in the body's plane, m/s."""
        forward, right = u() * FOOT_M, v() * FOOT_M
        return (atan2(right, forward), (forward * forward + right * right) ** 0.5)

    return windvane
