"""The pytest plugin: the fixtures `fleet` and `modem_link`. It loads with every session: nothing is imported early."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from lostlink.testing.flight import Flights
    from lostlink.testing.modem_link import ModemLinks


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option for real autopilots."""
    group = parser.getgroup("lostlink")
    group.addoption(
        "--ardupilot-dir", default=None, help="Where real ArduPilot binaries are; else ARDUPILOT_HOME, PATH."
    )


@pytest.fixture
def fleet(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Flights]:
    """Starts flights of whole fleets; where nothing is awaited, by its method `fly`.

    Each has ports of its own, also under pytest-xdist, and its run below ``tmp_path``. They end with the test.
    """
    from lostlink.testing.flight import Flights

    ardupilot_dir = request.config.getoption("--ardupilot-dir")
    flights = Flights(tmp_path, Path(ardupilot_dir) if ardupilot_dir else None)
    yield flights
    flights.stop()


@pytest.fixture
def modem_link() -> ModemLinks:
    """Makes lossy radio links between a ground station and an autopilot; they need no flight, and no simulation."""
    from lostlink.testing.modem_link import ModemLinks

    return ModemLinks()
