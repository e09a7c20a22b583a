"""What agents logged, tick by tick of a record: forward, back, and over ticks that are passed over."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.bus.messages import AgentStatus, Header
from bridge.record import names
from bridge.record.logged import LoggedValue
from lostlink.replay.moment import Moment
from lostlink.replay.player import Player
from tests.unit.lostlink.replay.flown import TICK_NS, Said, flown, scenario_of

SCENARIO = scenario_of("moon2020", ("0", "1", "gcs"))


def log(tick: int) -> list[Said]:
    said: list[Said] = [("1", LoggedValue("gap_m", 0.5 * tick))]
    if tick % 10 == 3:
        said += [
            ("0", LoggedValue("plan", {"leg": tick})),
            ("0", AgentStatus(Header.at(0, "0"), f"leg {tick}")),
        ]
    return said


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("runs") / "made", SCENARIO, ticks=40, log=log)


def is_as_logged(moment: Moment) -> bool:
    tick = moment.sim_time_ns // TICK_NS
    wanted = sorted((node, moment.sim_time_ns, str(item)) for node, item in log(tick))
    return sorted((node, time_ns, str(item)) for node, time_ns, item in moment.logged()) == wanted


def test_a_record_has_what_agents_logged_at_each_tick(run: Path) -> None:
    found = [is_as_logged(moment) for moment in Player.open(run).moments()]
    assert found == [True] * 40


@pytest.mark.parametrize("way", [(13, 3, 33), (39, 0), (5, 6, 6, 5)])
def test_it_has_so_wherever_one_goes(run: Path, way: tuple[int, ...]) -> None:
    player = Player.open(run)
    for tick in way:
        moment = player.seek(tick * TICK_NS)
        assert is_as_logged(moment)
        assert is_as_logged(moment)


def test_what_is_damaged_is_told(tmp_path: Path) -> None:
    run = flown(tmp_path / "made", SCENARIO, ticks=3, log=log)
    names.logged("1").path(run).write_bytes(b"not a stream of ours")
    moment = Player.open(run).step()
    assert moment is not None
    with pytest.raises(ValueError, match="not a stream file"):
        moment.logged()
