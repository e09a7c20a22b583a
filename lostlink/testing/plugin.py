"""The pytest plugin: the fixtures `fleet` and `modem_link`. It loads with every session: nothing is imported early."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    import pluggy

    from lostlink.testing.flight import Flights
    from lostlink.testing.modem_link import ModemLinks

FLIGHTS = pytest.StashKey["Flights"]()
"""Of a test: its flights."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the options for real autopilots."""
    group = parser.getgroup("lostlink")
    group.addoption(
        "--ardupilot-dir", default=None, help="Where real ArduPilot binaries are; else ARDUPILOT_HOME, PATH."
    )
    group.addoption(
        "--px4-dir",
        default=None,
        help="Where a real PX4 is (its checkout or build folder); else PX4_HOME, PATH.",
    )


@pytest.fixture
def fleet(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Flights]:
    """Starts flights of whole fleets; where nothing is awaited, by its method `fly`.

    Each has ports of its own, also under pytest-xdist, and its run below ``tmp_path``. They end with the test.
    """
    from bridge.fleet.autopilots.dirs import AutopilotDirs
    from lostlink.testing.flight import Flights

    said = (request.config.getoption(name) for name in ("--ardupilot-dir", "--px4-dir"))
    flights = Flights(tmp_path, AutopilotDirs(*(Path(place) if place else None for place in said)))
    request.node.stash[FLIGHTS] = flights
    yield flights
    flights.stop()


@pytest.hookimpl(hookwrapper=True)  # pytest 7 has no wrapper=True
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pluggy.Result[pytest.TestReport], None]:
    """Tells of the flights of a test that failed; once they have ended, of all in the properties that JUnit XML has."""
    flights = item.stash.get(FLIGHTS, None)
    if call.when == "teardown" and flights is not None:
        item.user_properties += flights.properties()
    report = (yield).get_result()
    if report.failed and flights is not None and (lines := list(flights.lines())):
        report.sections.append(("flights", "\n".join(lines)))


@pytest.fixture
def modem_link() -> ModemLinks:
    """Makes lossy radio links between a ground station and an autopilot; they need no flight, and no simulation."""
    from lostlink.testing.modem_link import ModemLinks

    return ModemLinks()
