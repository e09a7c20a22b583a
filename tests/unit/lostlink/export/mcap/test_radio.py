"""What a file says of links is what the run published, tick by tick, also where the host lost packets."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.scenario.mcap import McapSettings
from lostlink.export.mcap.export import write_mcap
from lostlink.replay.player import Player
from tests.unit.lostlink.export.mcap.files import read_mcap
from tests.unit.lostlink.replay.flown import Sent, flown, scenario_of

NODES = ("0", "1", "gcs")


def some(tick: int) -> list[Sent]:
    """UA 0 loses two packets on its way to the radio now and then; gcs speaks to one node."""
    return [Sent("0", lost=2 * (tick % 5 == 3)), Sent("1"), Sent("gcs", to="1")]


@pytest.mark.parametrize("killed", [False, True])
def test_links_and_who_was_heard_are_those_of_the_run(tmp_path: Path, killed: bool) -> None:
    run = flown(tmp_path / "run", scenario_of("perfect", NODES), 40, some, killed=killed)
    write_mcap(run, tmp_path / "run.mcap", McapSettings(rates_hz={"links": 1000.0}))
    read = read_mcap(tmp_path / "run.mcap")
    moments = 0
    for moment, links, matrix in zip(
        Player.open(run).moments(), read.messages["/links"], read.messages["/communication"], strict=True
    ):
        expected = moment.links()
        for name in ("tx", "rx", "sent", "delivered"):
            assert list(getattr(links, name)) == list(getattr(expected, name)), (moment.sim_time_ns, name)
        assert links.snr_db == pytest.approx(list(expected.snr_db), abs=0.01, nan_ok=True)
        assert list(matrix.delivered) == list(moment.communication().delivered)
        moments += 1
    assert moments == 40
    assert sum(len(fates.seq) for fates in read.messages["/fates"]) == 40 * 5 + 8 * 2
