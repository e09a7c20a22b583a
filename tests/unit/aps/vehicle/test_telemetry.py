import math
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.telemetry import Telemetry, VehicleState
from aps.wire.framer import Framer

S = 1_000_000_000
UNMEASURED = {"sysid", "link_open", "heartbeat_age_s", "as_of_ns", "heard_ns"}
RECORDING = Path(__file__).parents[3] / "data" / "mavlink_arducopter.bin"
"""ArduCopter 4.7-dev SITL (--model quad), system 4: arm, takeoff to 10 m, GUIDED leg, LAND; 50 s at 4 Hz."""


class Feed:
    def __init__(self, sysid=4):
        self.telemetry = Telemetry(sysid)
        self.mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)

    def __call__(self, message, now_ns=0):
        (frame,) = Framer().receive(bytes(message.pack(self.mav)))
        assert self.telemetry.update(frame, now_ns)
        return self.telemetry.state(now_ns)


@pytest.fixture
def feed():
    return Feed()


def heartbeat(mode=4, armed=False, vehicle=mavlink.MAV_TYPE_QUADROTOR, status=3):
    base = 0x51 | (0x80 if armed else 0)
    return mavlink.MAVLink_heartbeat_message(vehicle, 3, base, mode, status, 3)


def test_nothing_heard_yet():
    state = Telemetry(9).state(5 * S)
    assert (state.sysid, state.mode, state.armed, state.ready_to_arm) == (9, "", False, False)
    assert state.heartbeat_age_s == math.inf
    assert not state.connected
    assert math.isnan(state.lat_deg)
    assert math.isnan(state.airspeed_mps)
    assert all(math.isnan(component) for component in state.wind_body_mps)


@pytest.mark.parametrize(
    ("vehicle", "number", "name"),
    [
        (mavlink.MAV_TYPE_QUADROTOR, 4, "GUIDED"),
        (mavlink.MAV_TYPE_HEXAROTOR, 6, "RTL"),
        (mavlink.MAV_TYPE_FIXED_WING, 5, "FBWA"),
        (mavlink.MAV_TYPE_FIXED_WING, 15, "GUIDED"),
        (20, 19, "QLOITER"),
        (mavlink.MAV_TYPE_GROUND_ROVER, 15, "GUIDED"),
        (mavlink.MAV_TYPE_QUADROTOR, 99, "MODE_99"),
    ],
)
def test_mode_by_vehicle_type(feed, vehicle, number, name):
    assert feed(heartbeat(number, vehicle=vehicle)).mode == name


def test_heartbeat(feed):
    state = feed(heartbeat(armed=True, status=4), 3 * S)
    assert state.armed
    assert state.base_mode == "CUSTOM_MODE_ENABLED|STABILIZE_ENABLED|MANUAL_INPUT_ENABLED|SAFETY_ARMED"
    assert state.system_status == "ACTIVE"
    later = feed.telemetry.state(10 * S)
    assert later.heartbeat_age_s == 7.0
    assert not later.connected


def test_the_state_of_an_instant_is_made_once_until_something_changes_it(feed):
    telemetry = feed.telemetry
    before = feed(heartbeat(mode=4), S)
    assert telemetry.state(S) is before
    assert telemetry.state(2 * S).heartbeat_age_s == 1.0
    assert feed(heartbeat(mode=6), 2 * S).mode == "RTL"
    assert telemetry.state(2 * S).heartbeat_age_s == 0.0
    telemetry.link_down()
    assert not telemetry.state(2 * S).link_open
    telemetry.link_up()
    assert telemetry.state(2 * S).link_open
    telemetry.forget()
    assert telemetry.state(2 * S).mode == ""


def test_position_attitude_velocity(feed):
    feed(mavlink.MAVLink_attitude_message(2000, 0.1, -0.2, 3.0, 0, 0, 0))
    feed(
        mavlink.MAVLink_global_position_int_message(
            2001, -353632620, 1491652370, 624_500, 40_500, 100, -200, 30, 0
        )
    )
    state = feed(mavlink.MAVLink_local_position_ned_message(2002, 1.5, -2.5, -40.5, 1.25, -2.25, 0.5))
    assert (state.roll_rad, state.pitch_rad, state.yaw_rad) == pytest.approx((0.1, -0.2, 3.0))
    assert (state.lat_deg, state.lon_deg) == pytest.approx((-35.363262, 149.165237), abs=1e-9)
    assert (state.alt_amsl_m, state.alt_rel_m) == (624.5, 40.5)
    assert state.position_ned_m == (1.5, -2.5, -40.5)
    assert state.velocity_ned_mps == (1.25, -2.25, 0.5)
    assert state.time_boot_ms == 2002


def test_velocity_from_the_global_position_while_there_is_no_local_one(feed):
    state = feed(mavlink.MAVLink_global_position_int_message(1, 0, 0, 0, 0, 100, -200, 30, 0))
    assert state.velocity_ned_mps == (1.0, -2.0, 0.3)


def test_speeds_and_true_airspeed_against_the_wind(feed):
    state = feed(mavlink.MAVLink_vfr_hud_message(11.0, 10.0, 90, 45, 600.0, 1.5))
    assert (state.indicated_airspeed_mps, state.groundspeed_mps) == (11.0, 10.0)
    assert (state.throttle_percent, state.climb_mps) == (45.0, 1.5)
    assert state.airspeed_mps == 11.0
    feed(mavlink.MAVLink_local_position_ned_message(1, 0, 0, 0, 10.0, 0.0, 0.0))
    # 3 m/s from the north: flying north at 10 m/s over ground means 13 m/s through the air.
    state = feed(mavlink.MAVLink_wind_message(0.0, 3.0, 0.0))
    assert state.wind_ned_mps == pytest.approx((-3.0, 0.0, 0.0))
    assert state.airspeed_mps == pytest.approx(13.0)


def test_wind_in_body_axes(feed):
    feed(mavlink.MAVLink_attitude_message(1, 0.0, 0.0, math.pi / 2, 0, 0, 0))
    # From the east while heading east: a head wind.
    state = feed(mavlink.MAVLink_wind_message(90.0, 5.0, 3.0))
    assert state.wind_ned_mps == pytest.approx((0.0, -4.0, 3.0), abs=1e-6)
    assert state.wind_body_mps == pytest.approx((-4.0, 0.0, 3.0), abs=1e-5)
    feed(mavlink.MAVLink_attitude_message(2, 0.0, math.pi / 2, 0.0, 0, 0, 0))
    # Nose straight up: down is towards the tail.
    state = feed(mavlink.MAVLink_wind_message(0.0, 5.0, 5.0))
    assert state.wind_body_mps == pytest.approx((-5.0, 0.0, 0.0), abs=1e-5)


PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK


@pytest.mark.parametrize(
    ("enabled", "health", "ready"), [(PREARM, 0, False), (PREARM, PREARM, True), (0, 0, True)]
)
def test_ready_to_arm_is_the_autopilots_verdict(feed, enabled, health, ready):
    message = mavlink.MAVLink_sys_status_message(
        PREARM, enabled, health, 0, 12_600, 1850, 87, 0, 0, 0, 0, 0, 0
    )
    state = feed(message)
    assert state.ready_to_arm is ready
    assert (state.voltage_v, state.current_a, state.battery_remaining_percent) == (12.6, 18.5, 87.0)


def test_unmeasured_battery_is_nan(feed):
    state = feed(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0xFFFF, -1, -1, 0, 0, 0, 0, 0, 0))
    assert math.isnan(state.voltage_v)
    assert math.isnan(state.current_a)
    assert math.isnan(state.battery_remaining_percent)


def test_other_sources(feed):
    feed(mavlink.MAVLink_gps_raw_int_message(1, 3, 0, 0, 0, 0, 0, 0, 0, 14))
    feed(mavlink.MAVLink_mission_current_message(3))
    feed(mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, 250, 0, 0, 0))
    feed(mavlink.MAVLink_ekf_status_report_message(831, 0, 0, 0, 0, 0))
    feed(mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [12000] * 10, 2150, 0, 0, 80))
    state = feed(
        mavlink.MAVLink_home_position_message(-353632620, 1491652370, 584_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
    )
    assert (state.gps_fix_type, state.satellites_visible, state.mission_current) == (3, 14, 3)
    assert (state.waypoint_distance_m, state.position_ok, state.current_a) == (250.0, True, 21.5)
    assert (state.home_lat_deg, state.home_lon_deg) == pytest.approx((-35.363262, 149.165237), abs=1e-9)
    assert state.home_alt_amsl_m == 584.0


def test_second_battery_is_not_taken_for_the_first(feed):
    state = feed(mavlink.MAVLink_battery_status_message(1, 0, 0, 0, [12000] * 10, 2150, 0, 0, 80))
    assert math.isnan(state.current_a)


def test_nonsense_latitude_is_counted_and_dropped(feed):
    state = feed(mavlink.MAVLink_global_position_int_message(1, 2_000_000_000, 0, 0, 0, 0, 0, 0, 0))
    assert math.isnan(state.lat_deg)
    assert feed.telemetry.decode_errors == 1


def test_a_quadplane_says_so_beside_its_heartbeat(feed):
    assert not feed(mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, 1)).vtol
    assert feed(mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_FW, 2)).vtol


def clock(ms):
    return mavlink.MAVLink_system_time_message(0, ms)


def test_flight_time_runs_by_the_autopilots_clock_from_lift_off_to_touch_down(feed):
    def landed(state):
        return mavlink.MAVLink_extended_sys_state_message(0, state)

    feed(clock(10_000))
    feed(heartbeat(armed=True))
    assert feed(landed(1)).landed_state == "on_ground"
    assert feed(clock(12_000)).flight_time_s == 0.0
    assert feed(landed(3)).landed_state == "takeoff"
    feed(landed(2))
    assert feed(clock(30_000)).flight_time_s == 18.0
    feed(landed(1))
    assert feed(clock(40_000)).flight_time_s == 18.0
    feed(landed(2))
    assert feed(clock(41_000)).flight_time_s == 1.0


def test_what_was_said_in_flight_does_not_outlast_disarming(feed):
    """Who lands and arms again at once would fly by what was said before."""
    feed(heartbeat(armed=True))
    assert feed(mavlink.MAVLink_extended_sys_state_message(0, 4)).landed_state == "landing"
    assert feed(heartbeat(armed=False)).landed_state == "undefined"
    assert feed(heartbeat(armed=True)).landed_state == "undefined"
    assert feed(mavlink.MAVLink_extended_sys_state_message(0, 1)).landed_state == "on_ground"
    assert feed(heartbeat(armed=False)).landed_state == "on_ground"


def test_reboot_forgets_the_old_boot(feed):
    feed(heartbeat(armed=True))
    feed(mavlink.MAVLink_extended_sys_state_message(0, 2))
    feed(clock(500_000))
    state = feed(clock(499_000))  # late, not a reboot
    assert (state.time_boot_ms, feed.telemetry.reboots) == (500_000, 0)
    state = feed(clock(3_000))
    assert feed.telemetry.reboots == 1
    assert (state.time_boot_ms, state.armed, state.landed_state, state.flight_time_s) == (
        3_000,
        False,
        "undefined",
        0.0,
    )


def test_trimmed_and_mavlink1_payloads(feed):
    message = mavlink.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0, 0, 0)
    assert feed(message).yaw_rad == 0.0
    raw = bytes(
        mavlink.MAVLink_attitude_message(7, 0.5, 0.0, 0.25, 0, 0, 0).pack(feed.mav, force_mavlink1=True)
    )
    (frame,) = Framer().receive(raw)
    feed.telemetry.update(frame, 0)
    assert (feed.telemetry.state(0).roll_rad, feed.telemetry.state(0).yaw_rad) == (0.5, 0.25)


def test_a_message_without_state_is_none_of_ours(feed):
    (frame,) = Framer().receive(bytes(mavlink.MAVLink_ping_message(1, 2, 0, 0).pack(feed.mav)))
    assert feed.telemetry.update(frame, 0) is False


def test_recorded_flight_frames_as_pymavlink_reads_them():
    data = RECORDING.read_bytes()
    framer = Framer()
    ours = [frame for at in range(0, len(data), 97) for frame in framer.receive(data[at : at + 97])]
    parser = mavlink.MAVLink(None)
    theirs = [message for message in parser.parse_buffer(data) or [] if message.get_type() != "BAD_DATA"]
    assert [frame.raw for frame in ours] == [bytes(message.get_msgbuf()) for message in theirs]
    assert framer.counters.skipped_bytes == framer.counters.bad_crc == 0
    assert len(ours) > 1000


def test_recorded_flight_replays_to_the_states_that_pymavlink_decodes():
    telemetry = Telemetry(4)
    parser = mavlink.MAVLink(None)
    newest: dict[str, object] = {}
    heights, modes = [], []
    for frame in Framer().receive(RECORDING.read_bytes()):
        (message,) = parser.parse_buffer(frame.raw)
        newest[message.get_type()] = message
        telemetry.update(frame, 0)
        state = telemetry.state(0)
        heights.append(state.alt_rel_m)
        if not modes or modes[-1] != state.mode:
            modes.append(state.mode)
    assert [mode for mode in modes if mode] == ["GUIDED", "LAND"]
    assert max(height for height in heights if not math.isnan(height)) == pytest.approx(12.0, abs=0.3)
    attitude, position = newest["ATTITUDE"], newest["GLOBAL_POSITION_INT"]
    local, hud, status = newest["LOCAL_POSITION_NED"], newest["VFR_HUD"], newest["SYS_STATUS"]
    assert (state.roll_rad, state.pitch_rad, state.yaw_rad) == (attitude.roll, attitude.pitch, attitude.yaw)
    assert (state.lat_deg, state.lon_deg) == (position.lat * 1e-7, position.lon * 1e-7)
    assert state.alt_rel_m == position.relative_alt * 1e-3
    assert state.position_ned_m == (local.x, local.y, local.z)
    assert state.velocity_ned_mps == (local.vx, local.vy, local.vz)
    assert (state.groundspeed_mps, state.throttle_percent) == (hud.groundspeed, hud.throttle)
    assert state.voltage_v == status.voltage_battery / 1000
    assert (state.armed, state.landed_state, state.position_ok) == (False, "on_ground", True)
    assert state.flight_time_s == pytest.approx(36.0, abs=2.0)
    assert telemetry.reboots == telemetry.decode_errors == 0


@pytest.mark.parametrize("infinite", [math.inf, -math.inf])
def test_infinite_values_are_an_error_and_change_nothing(feed, infinite):
    feed(mavlink.MAVLink_wind_message(90.0, 5.0, 3.0))
    before = feed(mavlink.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0, 0, 0))
    for message in (
        mavlink.MAVLink_wind_message(infinite, 5.0, 3.0),
        mavlink.MAVLink_attitude_message(2000, infinite, 0.0, 0.0, 0, 0, 0),
        mavlink.MAVLink_local_position_ned_message(2000, 1.0, infinite, 0.0, 0, 0, 0),
    ):
        feed(message)
    after = feed.telemetry.state(0)
    assert (after.wind_ned_mps, after.roll_rad, after.time_boot_ms) == (
        before.wind_ned_mps,
        before.roll_rad,
        1000,
    )
    assert all(math.isfinite(component) for component in after.wind_body_mps)
    assert feed.telemetry.decode_errors == 3


def test_values_that_are_not_a_number_are_unknown(feed):
    state = feed(mavlink.MAVLink_wind_message(math.nan, 5.0, 3.0))
    assert math.isnan(state.wind_ned_mps[0])
    assert feed.telemetry.decode_errors == 0


def place(lat, lon, alt_mm=1_690_000, alt_rel_mm=20_000):
    return mavlink.MAVLink_global_position_int_message(1000, lat, lon, alt_mm, alt_rel_mm, 0, 0, 0, 0)


def home(lat, lon):
    return mavlink.MAVLink_home_position_message(lat, lon, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)


def test_a_place_of_0_0_before_home_is_none(feed):
    """With a home it is where Greenwich meets the equator."""
    assert math.isnan(feed(place(0, 0)).lat_deg)
    assert math.isnan(feed(place(0, 0)).alt_rel_m)
    feed(home(0, 0))
    assert feed(place(0, 0)).lon_deg == 0.0
    assert feed.telemetry.decode_errors == 0


def test_what_ardupilot_reckons_from_0_0_is_no_place(feed):
    """As ArduPlane 4.7 sends it in wind from 2 s on, and from 9 s to 10 s with the height of a home at 0 m."""
    feed(heartbeat(vehicle=mavlink.MAV_TYPE_FIXED_WING))
    assert math.isnan(feed(place(1600, -12, -250, -259)).lat_deg)
    assert math.isnan(feed(place(401_331_000, -1_052_403_999, 90, 91)).alt_amsl_m)
    feed(home(401_331_000, -1_052_403_999))
    known = feed(place(401_331_000, -1_052_403_999, 1_690_160, -93))
    assert (known.lat_deg, known.alt_amsl_m) == (pytest.approx(40.1331), pytest.approx(1690.16))


def test_a_place_beside_0_0_is_one_once_the_estimator_has_it_and_stays_known_without_gps(feed):
    feed(heartbeat())
    feed(mavlink.MAVLink_ekf_status_report_message(mavlink.EKF_POS_HORIZ_ABS, 0, 0, 0, 0, 0))
    feed(place(1600, -12, 0, 0))
    feed(mavlink.MAVLink_ekf_status_report_message(mavlink.EKF_CONST_POS_MODE, 0, 0, 0, 0, 0))
    feed(mavlink.MAVLink_gps_raw_int_message(0, 1, 0, 0, 0, 0, 0, 0, 0, 0))
    assert feed(place(1700, -12, 0, 0)).lat_deg == pytest.approx(1.7e-4)


def test_a_place_elsewhere_is_one_though_neither_home_nor_estimator_was_heard(feed):
    """ArduCopter's from its first fix on, 10 s before it has a home; or over a link that carries little else."""
    feed(heartbeat())
    assert feed(place(401_331_000, -1_052_357_000, 1_690_150, -167)).lat_deg == pytest.approx(40.1331)


@pytest.mark.parametrize("autopilot", [mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_GENERIC])
def test_others_send_a_place_once_they_have_one(feed, autopilot):
    feed(mavlink.MAVLink_heartbeat_message(2, autopilot, 0, 0, 3, 3))
    assert feed(place(0, 10)).lon_deg == pytest.approx(1e-6)


def test_home_that_is_not_on_earth_is_an_error(feed):
    message = mavlink.MAVLink_home_position_message(2_000_000_000, 0, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
    assert math.isnan(feed(message).home_lat_deg)
    assert feed.telemetry.decode_errors == 1


@pytest.mark.parametrize(
    ("main", "sub", "name"), [(6, 0, "OFFBOARD"), (4, 4, "AUTO.MISSION"), (3, 0, "POSCTL"), (9, 9, None)]
)
def test_modes_of_px4(feed, main, sub, name):
    custom_mode = main << 16 | sub << 24
    message = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, 12, 0x51, custom_mode, 3, 3)
    assert feed(message).mode == (name or f"MODE_{custom_mode}")


@pytest.mark.parametrize(
    ("vehicle", "number", "name"), [(12, 19, "MANUAL"), (12, 9, "SURFACE"), (11, 10, "AUTO")]
)
def test_modes_of_sub_and_boat(feed, vehicle, number, name):
    assert feed(heartbeat(number, vehicle=vehicle)).mode == name


def test_each_field_has_the_age_of_its_own_message(feed):
    feed(heartbeat(), 1 * S)
    feed(mavlink.MAVLink_attitude_message(2000, 0.1, -0.2, 3.0, 0, 0, 0), 4 * S)
    state = feed.telemetry.state(10 * S)
    assert (state.age_s("mode"), state.age_s("roll_rad"), state.age_s("time_boot_ms")) == (9.0, 6.0, 6.0)
    assert state.age_s("lat_deg") == math.inf
    assert state.age_s("wind_body_mps") == math.inf
    feed(mavlink.MAVLink_wind_message(0.0, 3.0, 0.0), 9 * S)
    state = feed.telemetry.state(10 * S)
    assert (state.age_s("wind_ned_mps"), state.age_s("wind_body_mps")) == (1.0, 6.0)
    with pytest.raises(ValueError, match="'sysid' is no measured field"):
        state.age_s("sysid")


def test_every_number_of_the_state_has_an_age(feed):
    told = set(feed.telemetry.state(0).ages_s())
    fields = {name for name in VehicleState.__dataclass_fields__ if name not in UNMEASURED}
    assert fields | {"wind_body_mps"} == told


def test_what_made_no_sense_does_not_make_a_field_younger(feed):
    feed(mavlink.MAVLink_global_position_int_message(1, 0, 0, 0, 0, 0, 0, 0, 0), 1 * S)
    feed(mavlink.MAVLink_global_position_int_message(2, 2_000_000_000, 0, 0, 0, 0, 0, 0, 0), 5 * S)
    assert feed.telemetry.state(6 * S).age_s("lat_deg") == 5.0


def test_the_autopilots_clock_may_begin_anew_after_49_days(feed):
    feed(heartbeat(armed=True))
    last_ms = (1 << 32) - 500
    feed(clock(last_ms))
    state = feed(clock(1500))
    assert (state.time_boot_ms, feed.telemetry.reboots, state.armed) == (last_ms + 2000, 0, True)
    assert feed(clock((1 << 32) - 100)).time_boot_ms == last_ms + 2000  # late
    assert feed(clock(2500)).time_boot_ms == last_ms + 3000
    feed(clock(900_000))
    assert feed(clock(100)).time_boot_ms == 100
    assert feed.telemetry.reboots == 1


def test_another_boot_at_the_end_of_a_new_connection_is_a_reboot_even_if_it_is_older(feed):
    noon_us = 1_700_000_000_000_000
    feed(heartbeat(armed=True))
    feed(mavlink.MAVLink_system_time_message(noon_us, 50_000))
    feed(mavlink.MAVLink_system_time_message(noon_us + 60_000_000, 50_001))  # GPS sets the clock: no reboot
    assert feed.telemetry.reboots == 0
    feed.telemetry.link_up()
    feed(mavlink.MAVLink_system_time_message(0, 55_000))  # not known yet
    state = feed(mavlink.MAVLink_system_time_message(noon_us + 3_600_000_000, 300_000))
    assert (feed.telemetry.reboots, state.armed, state.time_boot_ms) == (1, False, 300_000)
    feed.telemetry.link_up()
    feed(mavlink.MAVLink_system_time_message(noon_us + 3_601_000_000, 301_000))
    assert feed.telemetry.reboots == 1


def test_mission_state(feed):
    state = feed(mavlink.MAVLink_mission_current_message(3, 12, 5))
    assert (state.mission_current, state.mission_total, state.mission_state) == (3, 12, "COMPLETE")
    state = feed(mavlink.MAVLink_mission_current_message(3))
    assert (state.mission_current, state.mission_total, state.mission_state) == (3, -1, "")


@pytest.mark.parametrize(("heard_s", "mode"), [(10.05, ""), (12.5, ""), (13.5, "GUIDED")])
def test_a_heartbeat_that_a_new_boot_sends_before_its_clock_stays(feed, heard_s, mode):
    """The last clock of the old boot comes at 10 s, the first of the new one at 14 s, 1 s after it began."""
    feed(heartbeat(5), 9 * S)
    feed(clock(500_000), 10 * S)
    feed(heartbeat(4), round(heard_s * S))
    state = feed(clock(1_000), 14 * S)
    assert (state.mode, feed.telemetry.reboots) == (mode, 1)
    assert state.age_s("mode") == (14.0 - heard_s if mode else math.inf)
