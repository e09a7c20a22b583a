"""The airframes that ship, each in its own flight model."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit, fsolve

from fdm.air.wind import ConstantConfig
from fdm.model.airframe import airframe_names, load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel

HOME = Home(GeodeticPosition(47.0, 8.0, 0.0), 0.0)
CRUISE_MPS = 25.0


def packet(*pwm_us, rate_hz=400):
    return (18458, rate_hz, 0, *pwm_us, *(0,) * (16 - len(pwm_us)))


def fly(model, fields, seconds):
    for _ in range(round(seconds * fields[1])):
        model.step(fields, fields[1])


@pytest.mark.parametrize("name", airframe_names())
@pytest.mark.parametrize("rate_hz", [100, 400, 1200])
def test_every_airframe_stands_still_at_any_rate(name, rate_hz):
    model = JsbsimModel(load_airframe(name), HOME)
    before = model.sense()
    fly(model, packet(rate_hz=rate_hz), 3.0)
    after = model.sense()
    assert after[6:9] == pytest.approx(before[6:9], abs=2e-3)
    assert after[12:15] == pytest.approx((0, 0, 0), abs=1e-3)
    assert math.hypot(*after[3:6]) == pytest.approx(9.807, abs=0.01)


@pytest.mark.parametrize("from_deg", [0, 60, 270])
@pytest.mark.parametrize("name", [n for n in airframe_names() if load_airframe(n).vehicle == "copter"])
def test_a_multirotor_that_stands_in_the_wind_stays_where_it_is(name, from_deg):
    model = JsbsimModel(load_airframe(name), HOME)
    before = model.sense()
    model.set_wind(ConstantConfig(speed_mps=10, from_deg=from_deg).ned_mps())
    fly(model, packet(), 10.0)
    after = model.sense()
    assert after[6:9] == pytest.approx(before[6:9], abs=0.02)
    assert math.hypot(*after[12:15]) < 0.002


@pytest.mark.parametrize("yaw_deg", [45, 90, 135, 190, 225, 270])
def test_the_fixed_wing_that_stands_in_the_wind_stays_where_it_is(yaw_deg):
    model = JsbsimModel(load_airframe("aerosonde"), Home(HOME.position, yaw_deg))
    before = model.sense()
    model.set_wind(ConstantConfig(speed_mps=8, from_deg=270).ned_mps())
    fly(model, packet(1500, 1500, 1000, 1500), 60.0)
    after = model.sense()
    assert after[6:9] == pytest.approx(before[6:9], abs=0.01)
    assert after[9:12] == pytest.approx(before[9:12], abs=math.radians(1.5))
    assert math.hypot(*after[12:15]) < 0.002


@pytest.mark.parametrize(
    ("motors", "index"),
    [
        ((1500, 1700, 1650, 1550, 1550, 1650), 9),  # more on the left (2, 3, 6): rolls right
        ((1600, 1600, 1650, 1550, 1650, 1550), 10),  # more in front (3, 5): pitches up
        ((1550, 1650, 1550, 1650, 1650, 1550), 2),  # more on the counter-clockwise ones (2, 4, 5): yaws right
    ],
)
def test_hexa_motors_turn_it_as_ardupilots_x_frame_does(motors, index):
    model = JsbsimModel(load_airframe("hexa550"), HOME)
    fly(model, packet(*(1600,) * 6), 0.5)
    before = model.sense()[index]
    fly(model, packet(*motors), 0.1)
    assert model.sense()[index] - before > 0.01


@pytest.mark.parametrize("name", [n for n in airframe_names() if load_airframe(n).vehicle == "copter"])
def test_px4_is_told_the_propellers_torque_over_thrust(name):
    airframe = load_airframe(name)
    for motor in range(airframe.px4.parameters["CA_ROTOR_COUNT"]):
        model = JsbsimModel(airframe, HOME)
        fly(model, packet(*(1300 if index == motor else 1000 for index in range(6))), 2.0)  # it stands
        torque_nm = model._exec["moments/n-prop-lbsft"] * 0.3048 * 4.4482216
        thrust_n = -model._exec["forces/fbz-prop-lbs"] * 4.4482216
        expected = airframe.px4.parameters[f"CA_ROTOR{motor}_KM"]
        assert torque_nm / thrust_n == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("controls", "index", "sign"),
    [
        ((1700, 1500, 1700, 1500), 9, +1),  # aileron up: rolls right
        ((1500, 1700, 1700, 1500), 10, +1),  # elevator up: pitches up
        ((1500, 1500, 1700, 1700), 2, +1),  # rudder up: yaws right
    ],
)
def test_fixed_wing_controls_have_ardupilots_signs(controls, index, sign):
    model = airborne()
    before = model.sense()[index]
    fly(model, packet(*controls), 0.2)
    assert sign * (model.sense()[index] - before) > 0.02


def test_the_fixed_wing_rolls_over_the_ground_and_steers_right():
    model = JsbsimModel(load_airframe("aerosonde"), HOME)
    fly(model, packet(1500, 1500, 1500, 1600), 3.0)
    values = model.sense()
    assert values[12] > 1.0
    assert 0.05 < values[11] < 3.0


def airborne(speed_mps=CRUISE_MPS, alpha_rad=0.0):
    """An Aerosonde in level flight, far from the ground."""
    model = JsbsimModel(load_airframe("aerosonde"), HOME)
    execute = model._exec
    execute["ic/h-sl-ft"] = 100.0 / 0.3048
    execute["ic/vt-fps"] = speed_mps / 0.3048
    execute["ic/alpha-rad"] = alpha_rad
    execute["ic/theta-rad"] = alpha_rad
    execute["ic/psi-true-deg"] = 0.0
    assert execute.run_ic()
    execute["propulsion/engine/propeller-rpm"] = 5000.0
    return model


def aerodynamics(alpha_rad, beta_rad=0.0):
    """Coefficients of force along the body's axes, and of the pitching moment, with free controls and no turn rate."""
    model = JsbsimModel(load_airframe("aerosonde"), HOME)
    execute = model._exec
    level = math.cos(beta_rad)
    wind = math.cos(alpha_rad) * level, math.sin(beta_rad), math.sin(alpha_rad) * level
    execute["ic/h-sl-ft"] = 1000.0
    for axis, share in zip("uvw", wind, strict=True):
        execute[f"ic/{axis}-fps"] = CRUISE_MPS / 0.3048 * share
    assert execute.run_ic()
    assert execute["aero/alpha-rad"] == pytest.approx(alpha_rad, abs=1e-6)
    pressure_lbf = execute["aero/qbar-area"]
    forces = [execute[f"forces/fb{axis}-aero-lbs"] / pressure_lbf for axis in "xyz"]
    return (*forces, execute["moments/m-aero-lbsft"] / pressure_lbf / execute["metrics/cbarw-ft"])


@pytest.mark.parametrize("beta_deg", [-10, 0, 5, 15])
@pytest.mark.parametrize("alpha_deg", [0, 5, 10])
def test_forces_in_a_sideslip_are_the_book_s(alpha_deg, beta_deg):
    # Chapter 4: lift and drag turned by alpha alone, the side force along the body's y axis.
    alpha, beta = math.radians(alpha_deg), math.radians(beta_deg)
    lift = CL0 + CL_ALPHA * alpha
    drag = CD_P + lift**2 / (math.pi * EFFICIENCY * ASPECT)
    fx, fz = (
        lift * math.sin(alpha) - drag * math.cos(alpha),
        -lift * math.cos(alpha) - drag * math.sin(alpha),
    )
    assert aerodynamics(alpha, beta)[:3] == pytest.approx((fx, CY_BETA * beta, fz), abs=2e-4)


@pytest.mark.parametrize("alpha_deg", [-175, -135, -100, 60, 90, 120, 150, 179])
def test_beyond_the_stall_it_is_a_flat_plate(alpha_deg):
    # The normal force 2 sin^2(alpha), and at its arm of 1.42 chords the pitching moment; almost none along the plate.
    alpha = math.radians(alpha_deg)
    fx, _, fz, moment = aerodynamics(alpha)
    assert fz == pytest.approx(-2 * math.sin(alpha) * abs(math.sin(alpha)), abs=0.03)
    assert abs(fx) < 0.05
    assert moment == pytest.approx(CM0 - 2 * 1.4218 * math.sin(alpha), abs=1e-3)


# The book's equations of motion in the longitudinal plane, written here anew as the oracle.

MASS, JY, S, B, C, GRAVITY = 11.0, 1.135, 0.55, 2.8956, 0.18994, 9.8066
CL0, CL_ALPHA, CL_Q, CL_DE = 0.23, 5.61, 7.95, 0.13
CD_P, CD_DE, EFFICIENCY = 0.043, 0.0135, 0.9
CM0, CM_ALPHA, CM_Q, CM_DE = 0.0135, -2.74, -38.21, -0.99
JX, JZ, JXZ = 0.8244, 1.759, 0.1204
CY_BETA, CL_BETA, CN_BETA = -0.98, -0.13, 0.073
CL_P, CN_P, CL_R, CN_R = -0.51, -0.069, 0.25, -0.095
ASPECT = B**2 / S


def thrust(throttle, speed_mps, rho):
    """Thrust of motor and propeller, N (addendum to chapter 4: the steady propeller speed)."""
    diameter, kv, resistance, idle_a = 20 * 0.0254, 60 / (2 * math.pi * 145), 0.042, 1.5
    volts = 44.4 * throttle
    a = -0.01664, 0.004970, 0.005230
    quadratic = a[2] * rho * diameter**5 / (2 * math.pi) ** 2
    linear = a[1] * rho * diameter**4 * speed_mps / (2 * math.pi) + kv**2 / resistance
    constant = a[0] * rho * diameter**3 * speed_mps**2 - kv * volts / resistance + kv * idle_a
    omega = (-linear + math.sqrt(linear**2 - 4 * quadratic * constant)) / (2 * quadratic)
    advance = 2 * math.pi * speed_mps / (omega * diameter)
    ct = 0.09357 - 0.06044 * advance - 0.1079 * advance**2
    return ct * rho * (omega / (2 * math.pi)) ** 2 * diameter**4


@pytest.mark.parametrize("speed_mps", [15.0, 25.0, 33.0])
@pytest.mark.parametrize("throttle", [0.0, 0.1, 0.25, 0.5, 1.0])
def test_thrust_is_the_book_s_down_to_a_motor_at_idle(throttle, speed_mps):
    model = airborne(speed_mps, 0.05)
    fly(model, packet(1500, 1600, 1500, 1500), 0.3)  # in JSBSim no air turns a propeller that stands
    fly(model, packet(1500, 1600, 1000 + 1000 * throttle, 1500), 0.3)
    expected = thrust(throttle, model._exec["velocities/u-aero-fps"] * 0.3048, density(model))
    assert model._exec["propulsion/engine/thrust-lbs"] * 4.4482216 == pytest.approx(expected, abs=0.15)


def longitudinal(state, elevator_rad, throttle, rho):
    """d/dt of (u, w, q, theta)."""
    u, w, q, theta = state
    speed, alpha = math.hypot(u, w), math.atan2(w, u)
    pressure = 0.5 * rho * speed**2 * S
    pitch_rate = q * C / (2 * speed)
    lift = pressure * (CL0 + CL_ALPHA * alpha + CL_Q * pitch_rate + CL_DE * elevator_rad)
    induced = (CL0 + CL_ALPHA * alpha) ** 2 / (math.pi * EFFICIENCY * ASPECT)
    drag = pressure * (CD_P + induced + CD_DE * abs(elevator_rad))
    moment = pressure * C * (CM0 + CM_ALPHA * alpha + CM_Q * pitch_rate + CM_DE * elevator_rad)
    fx = thrust(throttle, speed, rho) - drag * math.cos(alpha) + lift * math.sin(alpha)
    fz = -drag * math.sin(alpha) - lift * math.cos(alpha)
    return np.array(
        [
            fx / MASS - GRAVITY * math.sin(theta) - q * w,
            fz / MASS + GRAVITY * math.cos(theta) + q * u,
            moment / JY,
            q,
        ]
    )


def book_trim(rho):
    """(alpha, elevator, throttle) of level flight at the cruise speed."""

    def residual(x):
        alpha = x[0]
        state = (CRUISE_MPS * math.cos(alpha), CRUISE_MPS * math.sin(alpha), 0.0, alpha)
        return longitudinal(state, x[1], x[2], rho)[:3]

    return fsolve(residual, (0.05, -0.1, 0.6))


def book_modes(rho):
    """Eigenvalues (short period, phugoid), the one with positive imaginary part of each."""
    alpha, elevator, throttle = book_trim(rho)
    state = np.array([CRUISE_MPS * math.cos(alpha), CRUISE_MPS * math.sin(alpha), 0.0, alpha])
    step = 1e-5
    jacobian = np.array(
        [
            (
                longitudinal(state + step * unit, elevator, throttle, rho)
                - longitudinal(state - step * unit, elevator, throttle, rho)
            )
            / (2 * step)
            for unit in np.eye(4)
        ]
    ).T
    values = sorted((v for v in np.linalg.eigvals(jacobian) if v.imag > 0), key=abs)
    return values[1], values[0]


def history(model, elevator_rad, throttle, seconds):
    """Fly with these controls and level wings; rows of (time, speed, alpha, sink rate) per frame."""
    rows = []
    for frame in range(round(seconds * 400)):
        values = model.sense()
        roll = (values[9] + math.pi) % (2 * math.pi) - math.pi
        aileron_us = 1500 - 800 * roll - 300 * values[0]
        model.step(packet(aileron_us, 1500 - elevator_rad / 0.000872, 1000 + 1000 * throttle, 1500), 400)
        speed = model._exec["velocities/vtrue-fps"] * 0.3048
        rows.append((frame / 400, speed, model._exec["aero/alpha-rad"], values[14]))
    return np.array(rows)


def density(model):
    return model._exec["atmosphere/rho-slugs_ft3"] * 515.379


def fitted_mode(times, values, mean, guess):
    """Eigenvalue of the damped oscillation about `mean` that fits best."""

    def oscillation(t, growth, omega, a, b):
        return np.exp(growth * t) * (a * np.cos(omega * t) + b * np.sin(omega * t))

    start = (guess.real, guess.imag, values[0] - mean, 0.0)
    (growth, omega, _, _), _ = curve_fit(oscillation, times, values - mean, p0=start)
    return complex(growth, omega)


def test_the_fixed_wing_holds_the_trim_that_the_book_s_equations_give():
    alpha, elevator, throttle = book_trim(density(airborne()))
    times, speeds, alphas, sinks = history(airborne(alpha_rad=alpha), elevator, throttle, 60.0).T
    settled = times > 30.0
    assert speeds[settled].mean() == pytest.approx(CRUISE_MPS, rel=0.01)
    assert alphas[settled].mean() == pytest.approx(alpha, abs=math.radians(0.1))
    assert sinks[settled].mean() == pytest.approx(0.0, abs=0.05)


def test_the_phugoid_is_that_of_the_linear_model():
    rho = density(airborne())
    alpha, elevator, throttle = book_trim(rho)
    _, expected = book_modes(rho)
    times, speeds, *_ = history(airborne(CRUISE_MPS + 1.0, alpha_rad=alpha), elevator, throttle, 40.0).T
    mode = fitted_mode(times[400:], speeds[400:], CRUISE_MPS, expected)
    assert mode.imag == pytest.approx(expected.imag, rel=0.15)
    assert mode.real == pytest.approx(expected.real, rel=0.15)


def test_the_short_period_is_that_of_the_linear_model():
    rho = density(airborne())
    alpha, elevator, throttle = book_trim(rho)
    expected, _ = book_modes(rho)
    times, _, alphas, _ = history(airborne(alpha_rad=alpha + 0.03), elevator, throttle, 0.7).T
    mode = fitted_mode(times, alphas, alpha, expected)
    assert mode.imag == pytest.approx(expected.imag, rel=0.15)
    assert mode.real == pytest.approx(expected.real, rel=0.15)


def dutch_roll(rho):
    """Eigenvalue of the book's linear lateral model (section 5.5), of (v, p, r, phi) about the trim."""
    alpha, *_ = book_trim(rho)
    u, w = CRUISE_MPS * math.cos(alpha), CRUISE_MPS * math.sin(alpha)
    pressure, rate = 0.5 * rho * CRUISE_MPS**2 * S, B / (2 * CRUISE_MPS)
    inertia = np.linalg.inv([[JX, -JXZ], [-JXZ, JZ]])
    roll = pressure * B * np.array([CL_BETA / CRUISE_MPS, CL_P * rate, CL_R * rate, 0.0])
    yaw = pressure * B * np.array([CN_BETA / CRUISE_MPS, CN_P * rate, CN_R * rate, 0.0])
    side = [pressure * CY_BETA / MASS / CRUISE_MPS, w, -u, GRAVITY * math.cos(alpha)]
    matrix = np.vstack([side, inertia @ np.vstack([roll, yaw]), [0.0, 1.0, math.tan(alpha), 0.0]])
    return max(np.linalg.eigvals(matrix), key=lambda value: value.imag)


def test_the_dutch_roll_is_that_of_the_linear_model():
    rho = density(airborne())
    alpha, elevator, throttle = book_trim(rho)
    expected = dutch_roll(rho)
    model = airborne(alpha_rad=alpha)
    pwm_us = (1500, 1500 - elevator / 0.000872, 1000 + 1000 * throttle)
    fly(model, packet(*pwm_us, 1500), 1.0)
    fly(model, packet(*pwm_us, 1600), 0.3)
    rows = []
    for frame in range(1000):
        fly(model, packet(*pwm_us, 1500), 1 / 400)
        rows.append((frame / 400, model.sense()[2]))

    def oscillation(t, growth, omega, a, b, mean, drift):
        return np.exp(growth * t) * (a * np.cos(omega * t) + b * np.sin(omega * t)) + mean + drift * t

    start = (expected.real, expected.imag, rows[0][1], 0.0, 0.0, 0.0)
    (growth, omega, *_), _ = curve_fit(oscillation, *np.array(rows).T, p0=start)
    assert omega == pytest.approx(expected.imag, rel=0.03)
    assert growth == pytest.approx(expected.real, rel=0.05)


def test_roll_and_yaw_are_coupled_as_the_book_s_product_of_inertia_does():
    model = airborne()
    fly(model, packet(1800, 1500, 1700, 1500), 0.01)
    foot_pound = 1.35581795
    roll, yaw = (model._exec[f"moments/{axis}-total-lbsft"] * foot_pound for axis in "ln")
    expected = np.linalg.solve([[JX, -JXZ], [-JXZ, JZ]], [roll, yaw])
    assert model._exec["accelerations/rdot-rad_sec2"] == pytest.approx(expected[1], rel=0.01)


def test_the_worked_example_of_the_docs_flies():
    example = Path(__file__).parents[4] / "examples" / "airframe" / "mini.yaml"
    model = JsbsimModel(load_airframe(example), HOME)
    fly(model, packet(1450, 1450, 1450, 1450), 0.5)
    before = model.sense()
    assert before[14] < 0.0  # it climbs
    fly(model, packet(1450, 1500, 1500, 1450), 0.1)  # more on the left: rolls right
    assert model.sense()[0] - before[0] > 0.5
