"""`lostlink air`: a medium's table, without flying."""

from __future__ import annotations

import json
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from channel.access.settings.air_time import AirTimeMedium
from channel.access.settings.base import Surroundings
from channel.access.trial import Load, under_load
from channel.cli.air_command import air
from channel.link.radio import Radio
from channel.network.radio_world import RadioWorld
from channel.numbers.units import db_from_ratio
from channel.presets import load_radio


def results(*arguments: str) -> list[dict[str, Any]]:
    """The loads of a JSON output."""
    done = CliRunner().invoke(air, [*arguments, "--json"])
    assert done.exit_code == 0, done.output
    loads: list[dict[str, Any]] = json.loads(done.stdout)["loads"]
    return loads


def test_no_more_is_carried_than_the_air_has_time_for() -> None:
    """Six nodes at 200 packets a second of 1400 bytes over 64 kb/s, in slots: at most 64 kb/s come through."""
    (load,) = results(
        "tdma", "--length-bytes", "1400", "--load-bps", str(6 * 200 * 1400 * 8), "--duration", "10"
    )
    assert load["delivered_bps"] < 64_000.0
    assert load["lost"]["queue_full"] > 0.8 * load["sent"]
    assert load["sent"] == load["delivered"] + load["in_flight"] + sum(load["lost"].values())


@pytest.mark.parametrize("medium", ["airtime", "csma", "tdma", "sik"])
def test_little_load_comes_through_at_once(medium: str) -> None:
    """A packet a second and node: nearly all arrive."""
    (load,) = results(
        medium, "--load-bps", "1000", "--length-bytes", "20", "--nodes", "3", "--duration", "30"
    )
    assert load["delivered"] > 0.97 * load["sent"]
    assert load["delay_median_s"] < {"tdma": 0.03, "sik": 0.12}.get(medium, 0.005)


def test_headers_of_the_layers_above_are_on_the_air() -> None:
    """802.11g, 6 Mb/s: DIFS of 28 us, then 554 us for 328 + 28 + 36 bytes."""
    (load,) = results("csma", *("--load-bps", "1000", "--length-bytes", "328", "--header-bytes", "28"))
    assert load["delay_median_s"] == pytest.approx((28 + 554) / 1e6)


@pytest.mark.slow
def test_a_network_of_delays() -> None:
    """95 % come within what is asked for, and the outage of two ends is 1 - (4/5)^2 on average."""
    (load,) = results(
        *("delay", "--delay-ms", "20", "45", "120", "--bitrate-bps", "1e9", "--outage-s", "0.4", "0.1"),
        *("--reorder", "--load-bps", "20000", "--length-bytes", "50", "--duration", "300"),
    )
    assert load["delay_95_s"] == pytest.approx(0.120, rel=0.05)
    assert load["lost"]["outage"] / load["sent"] == pytest.approx(0.36, abs=0.04)


def test_what_a_mode_of_expresslrs_carries_down() -> None:
    """Offered twice what the firmware promises: 490 B/s at 200 Hz, of which 62 of 65 are the user's."""
    (load,) = results(
        *("elrs", "--mode", "900-200", "--to", "one", "--length-bytes", "62"),
        *("--load-bps", str(2 * 8 * 490), "--duration", "30"),
    )
    assert load["delivered_bps"] / 8 == pytest.approx(490 * 62 / 65, rel=0.02)
    assert load["lost"]["queue_full"] > 0.4 * load["sent"]


def test_far_nodes_hear_less() -> None:
    """With a radio its powers count."""
    shares = []
    short = ("--to", "one", "--duration", "3", "--load-bps", "50000")
    for ring_m in ("100", "100000"):
        (load,) = results("csma", "--radio", "wifi-2.4", "--ring-m", ring_m, *short)
        shares.append(load["delivered"] / load["sent"])
    assert shares[0] > 0.99
    assert shares[1] == 0.0


def test_base_loss_takes_its_share() -> None:
    """5 % of wifi-2.4's frames, 30 m away as anywhere; they all came."""
    short = ("--ring-m", "30", "--load-bps", "50000", "--duration", "60")
    (load,) = results("csma", "--radio", "wifi-2.4", *short)
    share = load["lost"]["noise"] / load["sent"]
    assert share == pytest.approx(0.05, abs=4.0 * (0.05 * 0.95 / load["sent"]) ** 0.5)


def test_frames_last_by_the_bit_rate_of_the_radio() -> None:
    """200 bytes at 200 kb/s; at 64 kb/s unless a radio is given."""
    short = ("--load-bps", "1000", "--to", "one", "--duration", "30")
    for radio, frame_s in ((("--radio", "xbee-900hp"), 0.008), ((), 0.025)):
        (load,) = results("airtime", *radio, *short)
        assert load["delay_median_s"] == pytest.approx(frame_s, abs=1e-5)


def test_receivers_hear_as_those_of_a_run_do() -> None:
    """With the powers of the radio: no later signal takes a receiver over, unless a medium has `capture_db`."""
    nodes, ring_m, load = 6, 2000.0, Load(100e3, 200, None, 20.0)
    turn = 2.0 * pi / (nodes - 1)
    ring = {n: (ring_m * cos(turn * n), ring_m * sin(turn * n), -40.0) for n in range(1, nodes)}
    config = load_radio("xbee-900hp")
    world = RadioWorld(Radio(config), {0: (0.0, 0.0, -40.0)} | ring)
    noise_dbm = float(db_from_ratio(world.noise_mw))
    places = {str(n): n for n in range(nodes)}
    medium = AirTimeMedium().open(Surroundings.of(world, places, load.seed, config, noise_dbm))
    (found,) = results("airtime", "--radio", "xbee-900hp", "--ring-m", "2000", "--load-bps", "100e3")
    assert found == under_load(medium, load).as_dict()
    assert found["lost"]["collided"] > 0


def test_a_node_without_a_peer_carries_nothing() -> None:
    """Of three ExpressLRS nodes one has no peer; what it sent was taken for carried."""
    (load,) = results(
        "elrs", "--nodes", "3", "--load-bps", "1000", "--length-bytes", "40", "--duration", "100"
    )
    assert load["delivered_bps"] == pytest.approx(load["delivered"] * 8 * 40 / 100)
    assert load["delivered_bps"] == pytest.approx(1000 * 2 / 3, rel=0.25)


@pytest.mark.slow
def test_table_and_plot(tmp_path: Path) -> None:
    """What a person reads."""
    file = tmp_path / "air.png"
    done = CliRunner().invoke(air, ["csma", "--duration", "1", "--nodes", "4", "--plot", str(file)])
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[0].split()[:2] == ["offered", "carried"]
    assert len(done.stdout.splitlines()) == 8
    assert file.read_bytes().startswith(b"\x89PNG")


def test_a_mistake_is_one_line() -> None:
    """With the values that there are."""
    done = CliRunner().invoke(air, ["csma", "--standard", "11b", "--rate-mbps", "54"])
    assert done.exit_code == 2
    assert "802.11b at 54 Mb/s: one of 1, 2, 5.5, 11" in done.output


def test_slots_that_hold_no_packet_are_refused() -> None:
    """200 bytes at 64 kb/s last 25 ms, and 5 ms of guard come to it."""
    done = CliRunner().invoke(air, ["tdma", "--slot-ms", "29", "--guard-ms", "5"])
    assert done.exit_code == 2
    assert "--slot-ms 29: a packet takes 30 ms, its guard included" in done.output
    assert results("tdma", "--slot-ms", "30", "--guard-ms", "5", "--duration", "2")[0]["delivered"] > 0


def test_it_says_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter(range(0, 100, 3))
    monkeypatch.setattr("channel.cli.air_command.monotonic", lambda: next(times))
    done = CliRunner().invoke(air, ["tdma", "--duration", "1", "--load-bps", "1e3", "--load-bps", "2e3"])
    assert done.exit_code == 0
    assert done.stderr == "1 of 2 loads\n"


@pytest.mark.parametrize("number", ["inf", "nan"])
@pytest.mark.parametrize(
    ("medium", "option", "count"),
    [
        ("tdma", "--slot-ms", 1),
        ("tdma", "--guard-ms", 1),
        ("delay", "--delay-ms", 3),
        ("delay", "--outage-s", 2),
        ("airtime", "--bitrate-bps", 1),
        ("airtime", "--load-bps", 1),
        ("airtime", "--duration", 1),
    ],
)
def test_a_number_that_is_not_finite_is_refused(medium: str, option: str, count: int, number: str) -> None:
    """They gave a traceback, an outage that never was, or no end."""
    done = CliRunner().invoke(air, [medium, option, *[number] * count])
    assert done.exit_code == 2
    assert f"Invalid value for '{option}': '{number}' is not a finite number." in done.output
