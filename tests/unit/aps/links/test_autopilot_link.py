import pytest

from aps.links.autopilot_link import AutopilotAddress, parse_autopilot, parse_host_port


def test_addresses():
    assert parse_autopilot("tcp:127.0.0.1:5760") == AutopilotAddress("127.0.0.1", 5760)
    assert str(parse_autopilot("tcp:host:1")) == "tcp:host:1"
    assert parse_host_port("[::1]:80") == ("::1", 80)
    assert parse_host_port("0.0.0.0:0", lowest_port=0) == ("0.0.0.0", 0)


@pytest.mark.parametrize(
    "text", ["127.0.0.1:5760", "tcp:5760", "tcp::5760", "tcp:h:0", "tcp:h:65536", "tcp:h:x"]
)
def test_bad_addresses(text):
    with pytest.raises(ValueError, match="is not"):
        parse_autopilot(text)
