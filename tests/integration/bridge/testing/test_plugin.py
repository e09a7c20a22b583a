"""The pytest plugin as users have it: tests in files of their own, several at once, real flights."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from lostlink import load_run

EXAMPLE = Path(__file__).parents[4] / "examples" / "agents" / "test_turn_back.py"
STILL = """
import pytest

STILL = {
    "schema": 1, "name": "still", "duration_s": 4,
    "origin": {"lat_deg": 40.13, "lon_deg": -105.24, "alt_amsl_m": 1690},
    "radio": "moon2020",
    "nodes": [{"id": 0, "agent": {"type": "still"}}, {"id": 1, "home": {"north_m": 380}, "agent": {"type": "still"}}],
}
"""
OWN = (
    STILL
    + """

@pytest.mark.parametrize("seed", [1, 1, 2])
async def test_two_flights_at_once(fleet, seed, record_property):
    one, two = await fleet(STILL, seed=seed), await fleet(STILL, seed=seed, changes={"radio": "corrected"})
    await one.at(2.0)
    share = one.link(0, 1).delivery(to_s=2.0)
    assert (await one.end()).ok
    assert one.link(0, 1).delivery(to_s=2.0) == share  # what was said of a time stays true
    assert one.record.scenario.ports.first_slot != two.record.scenario.ports.first_slot
    assert one.ua(1).state(3.0)["mode"]
    print("digest", seed, one.result().summary["digest"])


def test_without_await(fleet):
    flight = fleet.fly(STILL)
    assert flight.ua(1).position_ned_m(1.0)[0] == pytest.approx(380, abs=0.5)


async def test_what_fails(fleet):
    flight = await fleet(STILL)
    await flight.ua(1).at(north_m=500, before_s=2.0)


async def test_too_late(fleet):
    await (await fleet(STILL)).at(60.0)


def test_wrong(fleet):
    fleet.fly({**STILL, "radio": "moon2021"})
"""
)
FAILING = (
    STILL
    + """

def test_what_is_expected(fleet):
    near = {"type": "position", "node": 1, "north_m": 380, "east_m": 0, "within_m": 1}
    flight = fleet.fly(STILL, changes={"expectations": [near, near | {"north_m": 385}]})
    assert flight.link(0, 1).delivery() > 2.0
"""
)
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def run_pytest(file: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-o",
        "asyncio_mode=auto",
        "-rP",
    ]
    return subprocess.run(
        [*command, *options, "-c", "/dev/null", "--rootdir", str(file.parent), str(file)],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


@pytest.mark.long
@pytest.mark.slow
def test_the_example():
    done = run_pytest(EXAMPLE)
    assert done.returncode == 0, done.stdout[-3000:]


@pytest.mark.long
def test_several_at_once_repeat_and_say_what_went_wrong(tmp_path):
    file = tmp_path / "test_own.py"
    file.write_text(OWN, encoding="utf-8")
    done = run_pytest(file, "-n", "2")
    assert "3 failed, 4 passed" in done.stdout, done.stdout[-3000:]
    assert "was never within 5.0 m of Place(north_m=500" in done.stdout
    assert "the flight ended at 4.00 s, before 60.0 s: duration" in done.stdout
    assert "did you mean moon2020" in done.stdout
    digests = [line.split() for line in done.stdout.splitlines() if line.startswith("digest ")]
    assert len(digests) == 3
    assert len({digest for _, seed, digest in digests if seed == "1"}) == 1
    assert len({digest for _, _, digest in digests}) == 2


def test_a_test_that_fails_tells_where_its_flights_are_and_what_they_found(tmp_path):
    file = tmp_path / "test_failing.py"
    file.write_text(FAILING, encoding="utf-8")
    junit = tmp_path / "junit.xml"
    done = run_pytest(file, "--basetemp", str(tmp_path / "base"), f"--junit-xml={junit}")
    [run] = (tmp_path / "base").glob("*0/*-still")
    told = done.stdout.partition("- flights -")[2].splitlines()
    assert told[1].startswith(f"{run}: duration; fail: 1 of 2 expectations not met"), done.stdout[-3000:]
    near = "node 1 near 385 m N, 0 m E at the end"
    assert told[2].startswith(f"  FAILED: {near}: wanted within 1 m, found ")
    assert told[2].split()[-1] == "m"
    assert told[3] == f"  seed 1, digest {load_run(run).digest}"
    assert re.search(r"= <RecordedLink 0 -> 1: main \d+ of \d+ delivered>\.delivery", done.stdout)
    assert f"= <FleetFlight {run.name}: duration; fail: 1 of 2" in done.stdout
    properties = [(each.get("name"), each.get("value")) for each in ElementTree.parse(junit).iter("property")]
    told_by_name = [
        ("lostlink_run", str(run)),
        ("lostlink_ending", told[1].removeprefix(f"{run}: ")),
        ("lostlink_expectation", told[2].strip()),
        ("lostlink_seed", "1"),
        ("lostlink_digest", load_run(run).digest),
    ]
    assert properties == told_by_name
