"""Real ArduCopter behind a modem: what it does with RADIO_STATUS, without its ground station, and beside others.

The station is a script that says its words at given instants of sim time, so nothing hangs on how fast the machine is.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from bridge.record.names import from_autopilot
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.record.tables.truth import TRUTH
from tests.integration.bridge.mavlink.scripted_station import Said, flown, messages, out_of
from tests.integration.bridge.mavlink.test_modem_networks import flown_again

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow, pytest.mark.timeout(3000)]
READY_S = 50
SCENARIO = """schema: 1
name: modem
seed: 5
autopilot: ardupilot
speed: max
duration_s: {duration_s}
figure: false
origin: {{lat_deg: 47.0, lon_deg: 8.0, alt_amsl_m: 500}}
radio: perfect
networks: {{telemetry: {radio}}}
ports: {{first_slot: {slot}}}
zenoh: false
mcap: {{write: false}}
nodes:
  - id: 0
    count: {count}
    home: {{line: {{spacing_m: 10}}}}
    parameters: {{FS_GCS_ENABLE: 1, FS_GCS_TIMEOUT: 5}}
    modems: {{telemetry: {{baud: {baud}}}}}
    agent: {{type: still}}
  - id: gcs
    kind: ground
    place: {{east_m: 20}}
    modems: {{telemetry: {{baud: {baud}, serve: [pty]}}}}
    agent: {{type: still}}
"""
ELRS = '{preset: elrs-900-200, medium: {pairs: [[gcs, "0"]]}}'
NETID = "{preset: sik-433, medium: {units: {25: [gcs, 0, 1, 2]}}}"
Fly = Callable[..., Path]


@pytest.fixture
def fly(tmp_path: Path, arducopter: Path, free_slot: Callable[[int], int]) -> Fly:
    """Fly with a script: heartbeats once a second, and what it says. ``again``: then in many processes, too."""

    def fly_one(
        said: Said,
        duration_s: int,
        *,
        baud: int = 57_600,
        radio: str = "sik-433",
        count: int = 1,
        again: bool = False,
    ) -> Path:
        values = {"duration_s": duration_s, "slot": free_slot(count), "baud": baud, "radio": radio}
        text = SCENARIO.format(**values, count=count)
        run, summary = flown(text, tmp_path, said, ardupilot=arducopter.parent)
        if again:
            other = flown_again(run, tmp_path, free_slot(count), "many")
            assert other["difference"] is None
            assert other["summary"]["digests"] == summary["digests"]
        return run

    return fly_one


def test_all_parameters_take_half_a_minute(fly: Fly) -> None:
    run = fly([(READY_S, mav.MAVLink_param_request_list_message(1, 1))], READY_S + 60)
    came = out_of(run, "gcs", "PARAM_VALUE")
    count = came[0][1].param_count
    assert len({message.param_index for _, message in came}) > 0.9 * count > 900
    assert came[-1][0] - came[0][0] >= 28.0


def test_all_parameters_over_expresslrs_take_two_minutes(fly: Fly) -> None:
    """As its documentation says of 900 MHz at 200 Hz: 1354 of 20 to 37 B at 466 B/s at most.

    Lost are those alone whose chunk the firmware damages: a repeated fragment that meets statistics.
    """
    run = fly([(READY_S, mav.MAVLink_param_request_list_message(1, 1))], READY_S + 150, radio=ELRS)
    came = [(at_s, each) for at_s, each in out_of(run, "gcs", "PARAM_VALUE") if at_s > READY_S]
    listed = [(at_s, each) for at_s, each in came if each.param_index < each.param_count]
    rows = read_columns(run, DELIVERIES, ("radio", "tx", "fate"))
    damaged = rows["fate"][
        (rows["radio"] == "telemetry") & (rows["tx"] == "0") & (rows["fate"] != "delivered")
    ]
    assert set(damaged) <= {"channel_erasure"}
    count = listed[0][1].param_count
    assert len({each.param_index for _, each in listed}) + len(damaged) >= count > 900
    assert len(damaged) <= 0.01 * count
    assert 100.0 < listed[-1][0] - listed[0][0] < 150.0
    told = out_of(run, "0", "RADIO_STATUS")
    assert {(each.get_srcSystem(), each.get_srcComponent()) for _, each in told} == {(255, 68)}
    assert len(told) / (READY_S + 150) == pytest.approx(1.0 / 0.011, rel=0.02)


def test_three_copters_on_one_netid_do_not_get_their_parameters_over(fly: Fly) -> None:
    """Lists are asked for in turn for a minute; one copter alone has them over in half a minute."""
    asked_s = range(READY_S, READY_S + 60, 2)
    said: Said = [
        (at_s, mav.MAVLink_param_request_list_message(turn % 3 + 1, 1)) for turn, at_s in enumerate(asked_s)
    ]
    run = fly(said, READY_S + 100, radio=NETID, count=3, again=True)
    came = [each for at_s, each in out_of(run, "gcs", "PARAM_VALUE") if at_s > READY_S]
    beats = [at_s for at_s, _ in out_of(run, "gcs", "HEARTBEAT") if at_s > READY_S]
    got = [len({each.param_index for each in came if each.get_srcSystem() == sysid}) for sysid in (1, 2, 3)]
    assert max(got) < 1300
    assert sum(got) < 0.65 * 3 * 1300
    assert len(beats) < 0.65 * 3 * 100, "one copter is heard once a second"


def test_a_saturated_link_settles(fly: Fly) -> None:
    """115200 baud bring more than 64 kb/s carry: streams are slowed down until half of the buffer or more is free."""
    streams: Said = [
        (at_s, mav.MAVLink_request_data_stream_message(1, 1, 0, 25, 1)) for at_s in (20.5, 22.5, 25.5)
    ]
    run = fly(streams, 200, baud=115_200, again=True)
    free = [message.txbuf for at_s, message in out_of(run, "0", "RADIO_STATUS") if at_s > 100.0]
    assert 50.0 <= np.mean(free) <= 90.0
    assert len(out_of(run, "gcs", "ATTITUDE")) > 100


def test_out_of_range_the_copter_comes_home(fly: Fly) -> None:
    def command(number: int, *values: float) -> Any:
        return mav.MAVLink_command_long_message(1, 1, number, 0, *values, *[0.0] * (7 - len(values)))

    far = (0b110111111000, round(47.01e7), round(8.0e7), 30.0, 0, 0, 0, 0, 0, 0, 0, 0)
    said: Said = []
    for again in (0.0, 0.5, 1.25):  # any may be lost
        said += [
            (READY_S + again, command(mav.MAV_CMD_DO_SET_MODE, 1, 4)),
            (READY_S + 3 + again, command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)),
            (READY_S + 6 + again, command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 30)),
            (READY_S + 25 + again, mav.MAVLink_set_position_target_global_int_message(0, 1, 1, 6, *far)),
        ]
    run = fly(said, 300, radio="{preset: sik-433, transmit_power_dbm: -32}", again=True)
    beats = [(at_s, each) for at_s, each in out_of(run, "gcs", "HEARTBEAT") if each.autopilot == 3]
    own = [
        (at_s, each)
        for at_s, each in messages(from_autopilot("0").path(run))
        if each.get_type() == "HEARTBEAT"
    ]
    rtl_s = next(at_s for at_s, each in own if each.custom_mode == 6)
    gaps = np.diff([at_s for at_s, _ in beats])
    assert gaps.max() > 4.0, "it is never out of range"
    lost_s = beats[int(gaps.argmax())][0]
    assert lost_s - 10.0 < rtl_s < lost_s + 15.0
    assert beats[-1][0] > rtl_s + 60.0, "it is never found again"
    assert beats[-1][1].custom_mode == 6
    places = read_columns(run, TRUTH, ("node", "position_north_m"))
    north_m = places["position_north_m"][places["node"] == "0"]
    assert north_m.max() > 200.0
    assert abs(north_m[-1]) < 5.0
    statuses = out_of(run, "gcs", "RADIO_STATUS")  # of its own modem, which goes on
    assert np.diff([at_s for at_s, _ in statuses]).max() < 6.0
