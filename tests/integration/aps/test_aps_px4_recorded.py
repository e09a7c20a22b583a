"""The daemon on what a real PX4 said: a flight by every verb, recorded with ``tests.interop.px4.px4_flight``."""

import asyncio
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.config import DaemonConfig
from aps.held import HeldDaemon
from tests.interop.px4.px4_flight import METADATA, TICK_S, Pilot, read_record

RECORD = Path(__file__).parents[2] / "data" / "mavlink_px4.bin.xz"
SYSID = 8
OFFBOARD, HOLD, MISSION, RTL = (6, 0), (4, 3), (4, 4), (4, 5)


class RecordedPx4:
    """Says at each exchange what was recorded there, and keeps what it is told."""

    def __init__(self, said):
        self.said, self.tick, self.told = said, 0, []

    def connect(self):
        """aps: a client is there."""

    def disconnect(self):
        """aps: it is gone."""

    def read(self):
        self.tick += 1
        return self.said.get(self.tick, b"")

    def write(self, data):
        parser = mavlink.MAVLink(None)
        self.told += [(self.tick * TICK_S, message) for message in parser.parse_buffer(data)]


async def replay(said):
    """Fly on the record; gives results, messages to the autopilot with their times, and the states."""
    px4 = RecordedPx4(said)
    config = DaemonConfig(autopilot="tcp:127.0.0.1:1", sysid=SYSID)
    async with HeldDaemon(config, autopilot=px4) as daemon:
        daemon.vehicle.events.learn(json.dumps(METADATA).encode())
        texts, states = [], []
        daemon.texts = texts.append
        await daemon.connect()
        pilot = Pilot(daemon, 100)
        for tick in range(1, max(said) + 20):
            daemon.begin_exchange(round(tick * TICK_S * 1e9))
            pilot.decide()
            daemon.end_exchange()
            states.append(daemon.state)
            if tick % 50 == 0:
                await asyncio.sleep(0)
        return daemon, pilot, px4.told, states, texts


@pytest.fixture(scope="module")
def flown():
    """The replay, made once."""
    return asyncio.run(replay(read_record(RECORD)))


def test_every_verb_ends_as_it_did_with_px4(flown):
    _, pilot, _, _, _ = flown
    assert [str(result) for result in pilot.results] == [
        "takeoff refused: the UA is not armed: PX4 would acknowledge takeoff, and drop it",
        "mode reached",
        "arm refused: TEMPORARILY_REJECTED: No manual control input",
        "mode reached",
        "parameter_get reached",
        "parameter_set reached",
        "parameter_set reached",
        "parameter_set refused: COM_RC_IN_MODE is a whole number in -2.14748e+09..2.14748e+09: 4.5 is none",
        "parameters reached",
        "mission_upload reached",
        "mission_download reached",
        "mission_upload reached",
        "mission_download reached",
        "mission_upload reached",
        "arm reached",
        "takeoff reached",
        "takeoff refused: it flies already: PX4 would take this for a height to climb to",
        "goto refused: Reposition is outside geofence",
        "goto reached",
        "velocity reached",
        "goto_ned reached",
        "hold reached",
        "disarm refused: TEMPORARILY_REJECTED: event 0x018ab9b5, whose text is not known",
        "mission reached",
        "rtl reached",
        "mission_clear reached",
    ]


def test_values_are_those_of_px4(flown):
    """The airframe, 10040, and what px4 printed at its start: CAL_ACC0_ID 1310988, MAV_SYS_ID 8, COM_RC_LOSS_T 1."""
    daemon, pilot, _, _, _ = flown
    values = [result.value for result in pilot.results]
    assert values[4] == 10040
    parameters = values[8]
    assert len(parameters) > 850
    expected = {
        "CAL_ACC0_ID": 1310988,
        "MAV_SYS_ID": 8,
        "COM_RC_LOSS_T": 1.0,
        "GF_ACTION": 2,
        "MPC_XY_CRUISE": 4.5,
    }
    assert {name: parameters[name] for name in expected} == expected
    assert parameters["CAL_MAG0_PRIO"] == 50
    assert all(value == round(value) for name, value in parameters.items() if name.startswith("CAL_ACC0_ID"))
    first, second, third = values[10]
    assert (first["command"], second["command"], third["command"]) == (22, 16, 16)
    assert first["params"][4:] == pytest.approx([47.397743, 8.545594, 10.0], abs=1e-4)
    assert [item["command"] for item in values[12]] == [5001] * 4
    assert daemon.telemetry.decode_errors == 0
    assert daemon.vehicle.acks.counters.stray == daemon.vehicle.acks.counters.late == 0


def commands_of(told, number):
    return [(at, m) for at, m in told if m.get_type().startswith("COMMAND_") and m.command == number]


def test_what_px4_is_told(flown):
    _, _, told, states, _ = flown
    modes = [(int(m.param2), int(m.param3)) for _, m in commands_of(told, 176)]
    assert modes == [(1, 0), HOLD, OFFBOARD, HOLD, OFFBOARD, HOLD, MISSION, RTL]
    home_m = next(state.home_alt_amsl_m for state in states if state.armed)
    ((_, climb),) = commands_of(told, 22)
    assert climb.param7 == pytest.approx(home_m + 8.0, abs=0.5)
    beyond, goto, stay = (m for _, m in commands_of(told, 192))
    assert beyond.z == pytest.approx(home_m + 10.0, abs=0.5)
    assert (goto.param2, goto.param4) == (1.0, pytest.approx(np.pi / 2))
    assert stay.z == pytest.approx(home_m + 10.0, abs=1.5), "where goto_ned has ended"


def test_setpoints_come_before_offboard_and_without_a_gap(flown):
    """PX4 asks for a setpoint before OFFBOARD, and for more than 2 a second in it."""
    _, _, told, _, _ = flown
    setpoints = [at for at, m in told if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    entries = [at for at, m in commands_of(told, 176) if int(m.param2) == 6]
    ends = [at for at, m in commands_of(told, 176) if int(m.param2) == 4][1:2]
    assert len([at for at in setpoints if entries[0] - 0.6 <= at < entries[0]]) >= 3
    flight = [at for at in setpoints if entries[0] - 0.6 <= at <= ends[0]]
    assert max(b - a for a, b in pairwise(flight)) < 0.3
    assert flight[-1] - flight[0] > 3.4, "half a second before it, and 3 s"


def test_the_state_is_px4s(flown):
    _, _, told, states, texts = flown
    seen = [a.mode for a, b in pairwise([*states, states[0]]) if a.mode != b.mode]
    assert {"MANUAL", "AUTO.TAKEOFF", "AUTO.LOITER", "OFFBOARD", "AUTO.MISSION", "AUTO.RTL"} <= set(seen)
    assert not any(mode.startswith("MODE_") for mode in seen)
    assert any(state.position_ok for state in states)
    assert max(state.mission_total for state in states) == 2, "items 0 to 2"
    assert ("No manual control input", 4) in [(text.text, text.severity) for text in texts]
    asked = {int(m.param1) for _, m in commands_of(told, 511)}
    assert {230, 231} <= asked
    assert not asked & {0, 42, 62, 168, 193}


@pytest.mark.parametrize("seed", range(4))
async def test_a_record_with_errors_harms_nobody(seed):
    """One bit in 4000 is wrong, and one exchange in 50 is lost: nothing is raised."""
    random = np.random.default_rng(seed)
    torn = {}
    for tick, data in read_record(RECORD).items():
        if tick > 700 or random.random() < 0.02:
            continue
        raw = np.frombuffer(data, np.uint8).copy()
        hits = random.random(raw.size) < 8 / 4000
        raw[hits] ^= (1 << random.integers(8, size=int(hits.sum()))).astype(np.uint8)
        torn[tick] = raw.tobytes()
    daemon, pilot, _, _, _ = await replay(torn)
    assert daemon.hub.links[0].framer.counters.bad_crc > 0
    assert daemon.vehicle.callbacks.errors == 0
    assert pilot.results[0].reason.startswith("the UA is not armed")
