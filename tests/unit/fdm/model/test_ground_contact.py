import pytest

from fdm.errors import AirframeError
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.ground_contact import contact_damping_ns_per_m
from fdm.model.jsbsim_model import JsbsimModel

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)
CONTACT = '<contact><damping_coeff unit="{unit}"> {value} </damping_coeff></contact>'


def write(tmp_path, body, name="model.xml"):
    path = tmp_path / name
    path.write_text(f"<fdm_config>{body}</fdm_config>")
    return path


def test_damping_is_summed_over_contacts_in_newton(tmp_path):
    contacts = CONTACT.format(unit="N/M/SEC", value=100) + CONTACT.format(unit="LBS/FT/SEC", value=10)
    path = write(tmp_path, f"<ground_reactions>{contacts}</ground_reactions>")
    assert contact_damping_ns_per_m(path) == pytest.approx(100 + 145.939, abs=1e-3)


def test_an_included_file_is_followed(tmp_path):
    write(tmp_path, CONTACT.format(unit="N/M/SEC", value=7), "Gear.xml")
    assert contact_damping_ns_per_m(write(tmp_path, '<ground_reactions file="Gear.xml"/>')) == 7


def test_without_contacts_nothing_damps(tmp_path):
    assert contact_damping_ns_per_m(write(tmp_path, "")) == 0


@pytest.mark.parametrize(
    "body",
    ["<a>", CONTACT.join(["<ground_reactions>", "</ground_reactions>"]), '<ground_reactions file="no.xml"/>'],
)
def test_a_file_that_cannot_be_read_is_an_airframe_error(tmp_path, body):
    with pytest.raises(AirframeError, match=r"xml: "):
        contact_damping_ns_per_m(write(tmp_path, body))


def test_a_rate_at_which_the_gear_would_explode_is_refused():
    airframe = load_airframe("f450")
    slow = airframe.jsbsim.model_copy(update={"min_rate_hz": 100.0})
    with pytest.raises(AirframeError, match="unstable below 229 Hz"):
        JsbsimModel(airframe.model_copy(update={"jsbsim": slow}), HOME)
