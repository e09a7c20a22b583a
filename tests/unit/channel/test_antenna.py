import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import trapezoid

from channel import presets
from channel.antenna import HalfWaveDipole, Pattern, Polarisation, Sector, rotate, to_body
from channel.link.radio import Radio

FORWARD, RIGHT, DOWN = np.eye(3)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def roll(degrees):
    half = np.radians(degrees) / 2
    return np.array([np.cos(half), np.sin(half), 0.0, 0.0])


def yaw(degrees):
    half = np.radians(degrees) / 2
    return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])


def test_rotation_of_a_right_turn_and_a_right_bank():
    assert rotate(yaw(90), FORWARD) == pytest.approx(RIGHT)
    assert rotate(roll(90), RIGHT) == pytest.approx(DOWN)
    assert to_body(yaw(90), RIGHT) == pytest.approx(FORWARD)


def test_dipole_abeam_along_its_axis_and_at_45_degrees():
    dipole = HalfWaveDipole(null_depth_db=30.0)
    assert dipole.towards_db(np.stack((FORWARD, RIGHT))) == pytest.approx([2.151, 2.151], abs=1e-3)
    assert float(dipole.towards_db(DOWN)) == pytest.approx(2.151 - 30.0, abs=1e-3)
    slant = (FORWARD + DOWN) / np.sqrt(2)
    by_hand = 10 * np.log10(1.640922 * (np.cos(np.pi / 2 * np.sqrt(0.5)) / np.sqrt(0.5)) ** 2)
    assert float(dipole.towards_db(slant)) == pytest.approx(by_hand, abs=1e-6)


def test_dipole_directivity_is_power_conserving():
    t = np.linspace(0.0, np.pi, 2001)[1:-1]
    directions = np.stack((np.sin(t), np.zeros_like(t), np.cos(t)), axis=-1)
    gain = 10 ** (HalfWaveDipole(null_depth_db=200.0).towards_db(directions) / 10)
    assert float(trapezoid(gain * np.sin(t), t) / 2) == pytest.approx(1.0, abs=1e-4)


def test_sector_in_the_middle_at_half_width_and_behind():
    sector = Sector(gain_db=10.0, azimuth_deg=90.0, azimuth_beamwidth_deg=60.0, front_to_back_db=20.0)
    assert float(sector.towards_db(RIGHT)) == pytest.approx(10.0)
    edge = np.array([np.cos(np.radians(60)), np.sin(np.radians(60)), 0.0])
    assert float(sector.towards_db(edge)) == pytest.approx(7.0)
    assert float(sector.towards_db(-RIGHT)) == pytest.approx(-10.0)


def test_pattern_interpolates_and_wraps():
    table = tuple(
        (az, el, az / 100.0 + el / 10.0) for az in (0.0, 90.0, 180.0, 270.0) for el in (-90.0, 0.0, 90.0)
    )
    pattern = Pattern(pattern=table)
    assert float(pattern.towards_db(RIGHT)) == pytest.approx(0.9)
    assert float(pattern.towards_db((FORWARD + RIGHT) / np.sqrt(2))) == pytest.approx(0.45)
    assert float(pattern.towards_db((FORWARD - RIGHT) / np.sqrt(2))) == pytest.approx(1.35)
    assert float(pattern.towards_db(np.array([0.0, 0.0, -1.0]))) == pytest.approx(9.0)


def test_patterns_that_were_used_are_equal_by_their_rows():
    one, same, other = (Pattern(pattern=((0.0, 0.0, 1.0), (90.0, 0.0, top_db))) for top_db in (3.0, 3.0, 2.0))
    for each in (one, same, other):
        each.towards_db(FORWARD)
    assert (one == same, hash(one) == hash(same), one == other) == (True, True, False)


def test_pattern_that_is_no_grid():
    with pytest.raises(ValidationError, match="full grid"):
        Pattern(pattern=((0.0, 0.0, 1.0), (90.0, 10.0, 1.0)))


def test_pattern_by_angles_from_the_zenith_is_refused():
    """As measured patterns often are: 0 up, 180 down."""
    with pytest.raises(ValidationError, match="elevations have to be from -90 to 90 degrees"):
        Pattern(pattern=tuple((az, polar, 1.0) for az in (0.0, 90.0) for polar in (0.0, 90.0, 180.0)))


def pattern_in(tmp_path, text, encoding="utf-8"):
    """The pattern of a radio that names a file with this text."""
    (tmp_path / "horn.csv").write_text(text, encoding=encoding)
    antenna = {"model": "pattern", "pattern_file": str(tmp_path / "horn.csv")}
    return presets.load_radio("perfect", {"antenna": antenna}).antenna.pattern


def test_pattern_without_rows_is_refused(tmp_path):
    with pytest.raises(presets.PresetError, match=r"antenna\.pattern: has to have at least 1"):
        pattern_in(tmp_path, "azimuth_deg,elevation_deg,gain_db\n")


def test_a_pattern_without_a_heading_keeps_the_first_row_of_a_file_as_spreadsheets_write_it(tmp_path):
    pattern = pattern_in(tmp_path, "0,0,9\n180,0,-9\n", encoding="utf-8-sig")
    assert pattern == ((0.0, 0.0, 9.0), (180.0, 0.0, -9.0))


def test_a_first_row_that_lacks_a_number_is_no_heading(tmp_path):
    with pytest.raises(presets.PresetError, match=r"horn\.csv:1: .*not a row of numbers"):
        pattern_in(tmp_path, "0,0,\n180,0,-9\n")


def test_a_row_that_lacks_a_number_is_named_by_its_line(tmp_path):
    with pytest.raises(presets.PresetError, match=r"horn\.csv:4: .*not a row of numbers"):
        pattern_in(tmp_path, "azimuth_deg,elevation_deg,gain_db\n\n0,0,9\n180,0,\n")


def test_pattern_from_csv(tmp_path):
    (tmp_path / "horn.csv").write_text("azimuth_deg,elevation_deg,gain_db\n0,0,9\n180,0,-9\n")
    (tmp_path / "mine.yaml").write_text(
        "preset: perfect\nantenna: {model: pattern, pattern_file: horn.csv}\n"
    )
    radio = Radio(presets.load_radio(tmp_path / "mine.yaml"))
    contributions = {term.name: float(np.asarray(term.contribution)) for term in radio.link(100.0).terms}
    assert contributions["transmit_antenna_gain_db"] == 9.0
    assert contributions["receive_antenna_gain_db"] == -9.0


def test_polarisation_by_bank_angle():
    """X + (1 - X) cos^2 with X = 0.01: at 60 degrees 0.01 + 0.99 / 4 = 0.2575, 5.892 dB."""
    loss = Polarisation(cross_polar_db=20.0).loss_db
    assert float(loss(LEVEL, LEVEL, FORWARD)) == pytest.approx(0.0, abs=1e-9)
    assert float(loss(LEVEL, roll(60), FORWARD)) == pytest.approx(5.892, abs=1e-3)
    assert float(loss(LEVEL, roll(90), FORWARD)) == pytest.approx(20.0)


@pytest.mark.parametrize("bank_deg", [0.0, 1.0, 20.0, 60.0])
@pytest.mark.parametrize("track", [FORWARD, RIGHT, (FORWARD + RIGHT) / np.sqrt(2)])
def test_polarisation_has_no_jump_overhead(bank_deg, track):
    """An aircraft passes 50 m over another, in steps of 0.1 m."""
    along = np.arange(-100.0, 100.0, 0.1)[:, np.newaxis] * track
    way = along + np.array([0.0, 0.0, -50.0])
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    loss = Polarisation().loss_db(LEVEL, roll(bank_deg), way)
    assert np.max(np.abs(np.diff(loss))) < 0.3
    assert np.all((loss >= 0.0) & (loss <= 20.0))
    if bank_deg == 0.0:
        assert loss == pytest.approx(0.0, abs=1e-9)


def test_sector_has_its_own_limit_above_and_below():
    """TR 36.814, table A.2.1.1-2: SLA_v = 20 dB in elevation, A_m = 25 dB in azimuth and together."""
    sector = Sector(gain_db=0.0)
    up, behind = np.array([0.0, 0.0, -1.0]), -FORWARD
    assert float(sector.towards_db((FORWARD + up) / np.sqrt(2))) == pytest.approx(-20.0)
    assert float(sector.towards_db(behind)) == pytest.approx(-25.0)
    assert float(sector.towards_db((behind + up) / np.sqrt(2))) == pytest.approx(-25.0)
    aside = np.array([np.cos(np.radians(20.0)), np.sin(np.radians(20.0)), 0.0])
    high = np.cos(np.radians(45.0)) * aside + np.sin(np.radians(45.0)) * up
    assert float(sector.towards_db(high)) == pytest.approx(-20.0 - 12.0 * (20.0 / 70.0) ** 2, abs=1e-9)


def test_a_pattern_is_sorted_once():
    pattern = Pattern(pattern=tuple((az, el, 0.0) for az in range(0, 360, 10) for el in range(-90, 91, 10)))
    pattern.towards_db(FORWARD)
    assert pattern._table is pattern._table
    assert Pattern.model_validate(pattern.model_dump()) == pattern


def test_cables_take_at_both_ends():
    bare, cabled = (Radio(presets.load_radio("perfect", {"cable_loss_db": db})) for db in (0.0, 1.5))
    received = [float(radio.link(100.0).received_power_dbm) for radio in (bare, cabled)]
    assert received[0] - received[1] == pytest.approx(3.0)
    terms = {term.name: float(np.asarray(term.contribution)) for term in cabled.link(100.0).terms}
    assert terms["transmit_cable_db"] == terms["receive_cable_db"] == -1.5


def test_attitude_reaches_the_budget():
    radio = Radio(presets.load_radio("perfect", {"antenna": {"model": "dipole"}}))
    ends = {"position_tx_ned_m": (0, 0, -40), "position_rx_ned_m": (0, 100, -40)}
    level = radio.link(**ends).received_power_dbm
    banked = radio.link(**ends, attitude_tx_wxyz=roll(90)).received_power_dbm
    assert float(level - banked) == pytest.approx(30.0, abs=0.01)


def test_rotations_are_scipys():
    from scipy.spatial.transform import Rotation

    rng = np.random.Generator(np.random.PCG64(5))
    wxyz = rng.normal(size=(50, 4))
    wxyz /= np.linalg.norm(wxyz, axis=-1, keepdims=True)
    vectors = rng.normal(size=(50, 3))
    turn = Rotation.from_quat(np.roll(wxyz, -1, axis=-1))
    assert rotate(wxyz, vectors) == pytest.approx(turn.apply(vectors), abs=1e-12)
    assert to_body(wxyz, vectors) == pytest.approx(turn.inv().apply(vectors), abs=1e-12)


def test_polarisation_of_any_two_attitudes():
    """By the definition: parts of scipy's rotated axes across the way."""
    from scipy.spatial.transform import Rotation

    rng = np.random.Generator(np.random.PCG64(6))
    quaternions = rng.normal(size=(2, 200, 4))
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    way = rng.normal(size=(200, 3))
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    parts = []
    for wxyz in quaternions:
        axis = Rotation.from_quat(np.roll(wxyz, -1, axis=-1)).apply(DOWN)
        parts.append(axis - np.sum(axis * way, axis=-1, keepdims=True) * way)
    leak = 0.01 / 0.99
    share = (np.sum(parts[0] * parts[1], axis=-1) ** 2 + leak) / (
        np.sum(parts[0] ** 2, axis=-1) * np.sum(parts[1] ** 2, axis=-1) + leak
    )
    got = Polarisation(cross_polar_db=20.0).loss_db(*quaternions, way)
    assert got == pytest.approx(-10.0 * np.log10(share), abs=1e-9)
