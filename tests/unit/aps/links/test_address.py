import pytest

from aps.links.address import parse_address, parse_autopilot, parse_host_port
from aps.links.link import Role
from aps.links.rules import Filter


def test_addresses():
    autopilot = parse_autopilot("tcp:127.0.0.1:5760")
    assert (autopilot.kind, autopilot.host, autopilot.port) == ("tcp", "127.0.0.1", 5760)
    assert autopilot.opening.role is Role.AUTOPILOT
    assert str(parse_autopilot("tcp:host:1")) == "tcp:host:1"
    assert str(parse_address("udp-out:[::1]:14550")) == "udp-out:[::1]:14550"
    assert parse_address("tcp-server::6760").host == "127.0.0.1"
    assert parse_address("udp-in:0.0.0.0:0").opening.role is Role.CLIENT
    assert parse_host_port("[::1]:80") == ("::1", 80)
    assert parse_host_port("0.0.0.0:0", lowest_port=0) == ("0.0.0.0", 0)


def test_serial_lines():
    line = parse_autopilot("serial:/dev/ttyACM0:115200")
    assert (line.device, line.baud) == ("/dev/ttyACM0", 115200)
    assert parse_address("serial:/dev/ttyUSB0").baud == 57600


@pytest.mark.parametrize(
    "text",
    [
        "127.0.0.1:5760",
        "tcp:5760",
        "tcp:h:0",
        "tcp:h:65536",
        "tcp:h:x",
        "tcp:a..b:5760",
        f"tcp:{'a' * 64}.example:5760",
        "tcp:a\0b:5760",
        "tcp-server:h:1",
        "serial:",
        "serial:/dev/x:fast",
    ],
)
def test_bad_addresses(text):
    with pytest.raises(ValueError, match="is not"):
        parse_autopilot(text)


def test_rules():
    rules = parse_address(
        "udp-out:h:1,read-only,block-out=30/33,allow-in-systems=255,max-hz=30:5/*:2"
    ).opening.rules
    assert rules.read_only
    assert rules.outgoing == Filter(block_messages=frozenset({30, 33}))
    assert rules.incoming == Filter(allow_systems=frozenset({255}))
    assert rules.max_rate_hz == {30: 5.0, -1: 2.0}


@pytest.mark.parametrize(
    "rule", ["readonly", "block-out=ATTITUDE", "max-hz=30", "max-hz=30:0", "read-only=yes"]
)
def test_bad_rules(rule):
    with pytest.raises(ValueError, match=r"udp-out:h:1|rate of message 30"):
        parse_address(f"udp-out:h:1,{rule}")
