"""A record played: ticks, seeking, and what was not written to the end."""

from __future__ import annotations

import tracemalloc
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.messages import encode
from bridge.radio.picture import Picture
from bridge.record.tables import reader
from bridge.record.tables.deliveries import DELIVERED, fates_message
from bridge.record.tables.reader import joined
from bridge.record.tables.schema import TableError
from bridge.record.tables.states import STATES
from lostlink.reading.rows import RUN_ENDED
from lostlink.replay.moment import Moment
from lostlink.replay.player import Player
from tests.unit.lostlink.replay.flown import TICK_NS, Router, Sent, flown, scenario_of, state_at, truths

NODES = ("0", "1", "gcs")
SCENARIO = scenario_of("moon2020", NODES)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("runs") / "made", SCENARIO, ticks=90)


def everything(moment: Moment) -> tuple[object, ...]:
    """All that a moment tells, as bytes: NaN equals itself there."""
    messages = [moment.truths(), moment.fates(), moment.links(), moment.communication(), *moment.statuses()]
    received = tuple(astuple(each) for each in moment.received())
    return (moment.sim_time_ns, moment.is_last, *map(encode, messages), received)


def test_a_record_is_played_to_its_end(run: Path) -> None:
    player = Player.open(run)
    played = [moment.sim_time_ns for moment in player.moments()]
    assert played == [i * TICK_NS for i in range(90)]
    assert player.now is not None
    assert player.now.is_last
    assert player.step() is None
    assert (player.begin_ns, player.end_ns) == (0, 89 * TICK_NS)


def test_truth_is_what_physics_said(run: Path) -> None:
    player = Player.open(run)
    moment = player.seek(70 * TICK_NS)
    assert list(moment.truths().truth) == truths(SCENARIO, 70)
    assert moment.truth()["gcs"] == truths(SCENARIO, 70)[2]


@pytest.mark.parametrize("way", [(3, 60, 20, 89, 88, 0, 45), (10, 11, 12, 11)])
def test_seeking_is_as_playing_up_to_there(run: Path, way: tuple[int, ...]) -> None:
    straight = [everything(moment) for moment in Player.open(run).moments()]
    player = Player.open(run)
    for tick in way:
        assert everything(player.seek(tick * TICK_NS)) == straight[tick]
        if tick < 89:
            following = player.step()
            assert following is not None
            assert everything(following) == straight[tick + 1]


def test_seeking_goes_to_the_tick_before_an_instant_and_to_the_ends(run: Path) -> None:
    player = Player.open(run)
    assert player.seek(10 * TICK_NS + 1).sim_time_ns == 10 * TICK_NS
    assert player.seek(-5).sim_time_ns == 0
    assert player.seek(1 << 60).sim_time_ns == 89 * TICK_NS


def test_it_is_read_some_rows_at_a_time_also_on_the_way_back(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    straight = [everything(moment) for moment in Player.open(run).moments()]
    monkeypatch.setattr(reader, "READ_ROWS", 7)
    monkeypatch.setattr("lostlink.replay.player.ROWS_AT_ONCE", 5)
    played = Player.open(run)
    assert [everything(moment) for moment in played.moments()] == straight
    assert [everything(played.seek(tick * TICK_NS)) for tick in (40, 41, 7, 80)] == [
        straight[tick] for tick in (40, 41, 7, 80)
    ]


def test_counts_of_links_are_those_of_the_table(run: Path) -> None:
    player = Player.open(run)
    links = player.seek(player.end_ns).links()
    assert list(links.sent) == [90] * 6
    columns = joined(list(player.record.decisions.parts()))
    for row, (tx, rx) in enumerate(zip(links.tx, links.rx, strict=True)):
        mine = (columns["tx"] == tx) & (columns["rx"] == rx)
        assert links.delivered[row] == np.count_nonzero(columns["fate"][mine] == 0)
    assert 0 < sum(links.delivered) < 540


def test_a_moment_is_over_when_another_is_played(run: Path) -> None:
    player = Player.open(run)
    before = player.seek(0)
    player.step()
    with pytest.raises(RuntimeError, match="is over"):
        before.links()


@pytest.mark.parametrize("ticks", [31, 40])
def test_links_and_fates_are_those_of_the_run_where_packets_take_time(tmp_path: Path, ticks: int) -> None:
    """Packets count when it is known what became of them; what the end cuts off is in the record alone."""
    tele = "networks: {tele: {preset: xbee-900hp}}\n"
    scenario = scenario_of("wifi-2.4", NODES, extra=tele)
    router = Router(tmp_path / "run", scenario)
    picture, told = Picture(scenario.transceiver_ids, scenario.network_names), []
    fates = np.zeros((2, 2, len(NODES), len(NODES)), dtype=np.int64)
    for number in range(ticks):
        sent = [Sent(node, radio=radio, length=60) for node in NODES for radio in ("main", "tele")]
        now_ns, here = number * TICK_NS, truths(scenario, number)
        settled = router.tick(now_ns, here, sent)
        picture.take(settled.columns)
        links = picture.links(
            now_ns, [air.settled for air in router.core.airs], router.core.radios_off(now_ns)
        )
        at = tuple(settled.columns[name] for name in ("radio", "tx", "rx"))
        np.add.at(
            fates, (slice(None), *at), np.stack([np.ones(len(at[0])), settled.columns["fate"] == DELIVERED])
        )
        assert links.network == ("main", "tele")
        rows = (np.asarray(links.radio), np.asarray(links.tx), np.asarray(links.rx))
        assert np.array_equal(fates[:, *rows], [links.sent, links.delivered])
        assert np.array_equal(fates.sum(axis=(1, 2, 3)), [sum(links.sent), sum(links.delivered)])
        told.append((fates_message(now_ns, NODES, settled.columns, ("main", "tele")), links))
    run = router.close()
    player = Player.open(run)
    assert any(np.any(part["fate"] == RUN_ENDED) for part in player.record.decisions.parts())
    played = [(moment.fates(), moment.links()) for moment in player.moments()]
    assert [[encode(each) for each in tick] for tick in played] == [
        [encode(each) for each in tick] for tick in told
    ]


def test_packets_arrive_with_what_they_carried(tmp_path: Path) -> None:
    scenario = scenario_of("perfect", NODES)
    router = Router(tmp_path / "run", scenario)
    router.tick(0, truths(scenario, 0), [Sent("0", length=7), Sent("1", to="gcs", length=9)])
    moment = Player.open(router.close()).step()
    assert moment is not None
    found = [(p.tx, p.rx, p.channel, len(p.payload), p.seq) for p in moment.received()]
    assert found == [("0", "1", "team", 7, 0), ("0", "gcs", "team", 7, 0), ("1", "gcs", "team", 9, 0)]
    assert [p.rx for p in moment.received(["1"])] == ["1"]


def test_packets_lost_before_the_channel_count_at_every_receiver(tmp_path: Path) -> None:
    scenario = scenario_of("perfect", NODES)
    router = Router(tmp_path / "run", scenario)
    router.tick(0, truths(scenario, 0), [Sent("0"), Sent("0", lost=4)])
    player = Player.open(router.close())
    moment = player.step()
    assert moment is not None
    links = moment.links()
    assert [(n, d) for n, d in zip(links.sent, links.delivered, strict=True)] == [(6, 2), (6, 2)]
    assert len(moment.fates().seq) == 4  # as in a run: what never came to the radio is in no message


def test_a_killed_run_plays_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = [everything(m) for m in Player.open(flown(tmp_path / "whole", SCENARIO, 30)).moments()]
    killed = flown(tmp_path / "killed", SCENARIO, 30, killed=True)
    journal = killed / "truth.journal"
    journal.write_bytes(journal.read_bytes()[:-300])
    stream = killed / "streams" / "packets" / "1.bin"
    stream.write_bytes(stream.read_bytes()[:-5])
    played = [everything(m) for m in Player.open(killed).moments()]
    assert played[:28] == whole[:28]


def test_link_reports_are_due_as_often_as_in_a_run(run: Path) -> None:
    moments = [m.links_are_due for m in Player.open(run).moments()]
    assert [i for i, due in enumerate(moments) if due] == [*range(0, 90, 4), 89]


@pytest.mark.parametrize("killed", [False, True])
def test_states_are_those_that_were_published_last(tmp_path: Path, killed: bool) -> None:
    run = flown(tmp_path / "made", SCENARIO, 30, killed=killed)
    player = Player.open(run)
    assert player.seek(0).states()
    for path in STATES.files(run):  # they are read once, whatever is sought
        path.unlink()
    for tick in (0, 1, 7, 28, 29, 3):  # 10 Hz of 20
        published_ns = tick // 2 * 2 * TICK_NS
        states = player.seek(tick * TICK_NS).states()
        expected = {node: encode(state_at(node, published_ns)) for node in NODES}
        assert {node: encode(state) for node, state in states.items()} == expected
    assert list(player.seek(0).states(["1"])) == ["1"]


def test_a_record_without_states_has_none_and_a_damaged_one_is_told(tmp_path: Path) -> None:
    run = flown(tmp_path / "made", SCENARIO, 5)
    STATES.parquet_path(run).write_bytes(b"PAR1")
    moment = Player.open(run).step()
    assert moment is not None
    with pytest.raises(TableError, match=r"made/states\.parquet: damaged"):
        moment.states()
    STATES.parquet_path(run).unlink()
    moment = Player.open(run).step()
    assert moment is not None
    assert moment.states() == {}


def test_what_is_no_run_is_said(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is not the directory of a run"):
        Player.open(tmp_path)
    router = Router(tmp_path / "empty", SCENARIO)
    router.close(killed=True)
    with pytest.raises(ValueError, match="before its first tick"):
        Player.open(tmp_path / "empty")


def test_when_rows_were_settled_is_found_part_by_part(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of as many rows as many UA leave: instants of all of them at once were 18 bytes a row."""
    record = Player.open(run).record
    parts, rows = 40, 50_000
    whole = {"received_ns": np.full(rows, 40 * TICK_NS), "fate": np.full(rows, DELIVERED)}
    cut = whole | {"fate": np.where(np.arange(rows) < 7, DELIVERED, RUN_ENDED)}
    monkeypatch.setattr(record.decisions, "parts", lambda: iter([whole] * parts + [cut, whole]))
    tracemalloc.start()
    until = record._rows_until()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert until.tolist() == [0] * 39 + [parts * rows + 7] * 51
    assert peak < parts * rows
