import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.execution import Outcome
from tests.unit.aps.vehicle.peer import Bench

S = 1_000_000_000


def test_the_last_message_its_rate_and_its_age():
    bench = Bench()
    board = bench.vehicle.messages
    assert board.last("WIND", 0) is None
    for number in range(31):
        bench.now_ns = number * S // 10
        bench.tell(mavlink.MAVLink_wind_message(float(number), 3.0, float("nan")))
    last = board.last("WIND", 4 * S)
    assert last.fields == {"direction": 30.0, "speed": 3.0, "speed_z": None}
    assert (last.count, last.age_s, last.rate_hz) == (31, 1.0, pytest.approx(10.0))
    assert board.last("wind", 60 * S).rate_hz == 0.0
    assert board.names() == ["HEARTBEAT", "WIND"]
    with pytest.raises(ValueError, match="no MAVLink message 'WINDY'"):
        board.last("WINDY", 0)


def test_a_message_is_asked_for_until_it_comes():
    bench = Bench()
    bench.commands.start("message", "AUTOPILOT_VERSION", on_done=(ends := []).append)
    for _ in range(150):
        bench.step()
    asked = bench.heard("COMMAND_LONG")
    assert [(m.command, m.param1) for m in asked] == [(512, 148.0)] * 2
    bench.autopilot.say(
        mavlink.MAVLink_autopilot_version_message(0, 5, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)
    )
    bench.step()
    assert ends[0].reached
    assert ends[0].value["flight_sw_version"] == 5


def test_a_message_that_the_autopilot_lacks_is_refused():
    bench = Bench()
    bench.commands.start("message", "ODOMETRY", on_done=(ends := []).append)
    bench.step()
    bench.autopilot.say(mavlink.MAVLink_command_ack_message(512, 3, 0, 0, 7, 191))
    bench.step()
    assert ends[0].outcome is Outcome.REFUSED
    assert ends[0].reason == "UNSUPPORTED: no ODOMETRY from this autopilot"


def test_a_message_is_sent_to_the_autopilot_unless_it_says_otherwise():
    bench = Bench()
    assert bench.run("send", "STATUSTEXT", {"severity": 6, "text": "hello"}).reached
    assert (bench.heard("STATUSTEXT")[0].text, bench.heard("STATUSTEXT")[0].get_srcComponent()) == (
        "hello",
        191,
    )
    bench.run("send", "STATUSTEXT", {"text": "\N{GREEK SMALL LETTER ALPHA}" * 25})
    assert ("\N{GREEK SMALL LETTER ALPHA}" * 25).encode() in bench.heard("STATUSTEXT")[1].get_msgbuf()
    bench.run("send", "RC_CHANNELS_OVERRIDE", {"chan1_raw": 1500})
    sent = bench.heard("RC_CHANNELS_OVERRIDE")[0]
    assert (sent.target_system, sent.target_component, sent.chan1_raw, sent.chan2_raw) == (7, 1, 1500, 0)
    bench.run("send", "GPS_INJECT_DATA", {"len": 3, "data": [1, 2, 3]})
    assert bench.heard("GPS_INJECT_DATA")[0].data[:4] == [1, 2, 3, 0]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("NOTHING", {}), "no MAVLink message 'NOTHING'"),
        (("WIND", {"power": 3}), "WIND has no field 'power': direction, speed, speed_z"),
        (("WIND", {"speed": "fast"}), "WIND cannot be made of"),
        (("HEARTBEAT", {"type": 300}), "HEARTBEAT cannot be made of"),
        (("GPS_INJECT_DATA", {"data": [1] * 500}), "GPS_INJECT_DATA cannot be made of"),
        (
            ("STATUSTEXT", {"text": "x" * 51}),
            "STATUSTEXT cannot be made of 51 bytes of text in text: 50 at most",
        ),
        (("PARAM_SET", {"param_id": "A" * 17}), "17 bytes of text in param_id: 16 at most"),
        (("WIND", [1, 2]), "fields must be names and values"),
    ],
)
def test_mistakes_of_the_caller_raise(arguments, text):
    with pytest.raises(ValueError, match=text):
        Bench().commands.start("send", *arguments)


@pytest.mark.parametrize("param", [float("nan"), float("inf"), 1e39, 2.0**31, "1", True])
def test_a_number_that_no_autopilot_can_read_says_so(param):
    """Of 1e39 no message could be made, and the daemon ended."""
    with pytest.raises(ValueError, match="param must be "):
        Bench().commands.start("message", "MESSAGE_INTERVAL", param)
