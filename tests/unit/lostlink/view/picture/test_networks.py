"""What is known of several radio networks is known of each."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from lostlink.replay.player import Player
from lostlink.view.page.tables import fleet_rows, link_words, loss_rows, losses_words
from lostlink.view.picture.fleet_view import FleetView, view_of
from lostlink.view.picture.frames import PictureFrames
from lostlink.view.picture.link_history import FIGURES
from tests.unit.lostlink.replay.flown import Sent, flown, scenario_of
from tests.unit.lostlink.view.fleet import fates, links

NODES = ("0", "1", "gcs")
TELE = "networks: {tele: {preset: perfect, base_loss: 0.5}}\n"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All talk on a `main` that loses nothing, and on a network that loses half."""
    lengths = {"main": 60, "tele": 90}
    sent = [Sent(node, radio=radio, length=length) for node in NODES for radio, length in lengths.items()]
    path = tmp_path_factory.mktemp("runs") / "made"
    return flown(path, scenario_of("perfect", NODES, extra=TELE), 100, lambda _tick: sent)


@pytest.fixture(scope="module")
def view(run: Path) -> FleetView:
    player = Player.open(run)
    view = view_of(player.record.scenario)
    for moment in player.moments():
        view.take(moment.fates())
        view.take(moment.links())
    return view


def test_counts_are_those_of_the_table_network_by_network(run: Path, view: FleetView) -> None:
    table = pq.read_table(run / "deliveries.parquet", columns=["radio", "tx", "rx", "fate"]).to_pylist()
    for name in ("main", "tele"):
        rows = [row for row in table if row["radio"] == name]
        assert view.losses[name].total == Counter(row["fate"] for row in rows)
        sent = view.links[name].latest("sent")
        found = {(NODES[tx], NODES[rx]): sent[tx, rx] for tx, rx in zip(*view.pairs(), strict=True)}
        assert found == Counter((row["tx"], row["rx"]) for row in rows)
    assert set(view.losses["main"].total) == {"delivered"}
    assert view.losses["tele"].total["base_loss"] == pytest.approx(300, abs=60)
    assert [set(view.losses[name].lengths) for name in view.networks] == [{60}, {90}]


def test_words_and_tables_are_of_one_network(view: FleetView) -> None:
    assert "100 of 100 packets delivered" in link_words(view, "main", 0, 1)
    assert "of 100 packets delivered" in link_words(view, "tele", 0, 1)
    assert "100 of 100" not in link_words(view, "tele", 0, 1)
    assert [row["cause"] for row in loss_rows(view.losses["main"])] == ["delivered"]
    assert [row["hears"] for row in fleet_rows(view, "main")] == ["2/2"] * 3
    assert [row["hears"] for row in fleet_rows(view, "tele")] != ["2/2"] * 3


def test_the_map_has_of_each_link_the_network_on_which_most_arrives(view: FleetView) -> None:
    assert json.loads(PictureFrames(view).snapshot())["quality"] == [100] * 6
    main, tele = (view.links[name].probability for name in ("main", "tele"))
    main[0, 1], tele[0, 1] = np.nan, 0.25
    main[1, 0], tele[1, 0] = 0.75, 0.5
    assert json.loads(PictureFrames(view).snapshot())["quality"] == [25, 100, 75, 100, 100, 100]


def test_a_network_by_which_nothing_has_gone_yet_says_so() -> None:
    view = view_of(scenario_of("perfect", ("0", "gcs"), extra=TELE))
    view.take(replace(fates(0.1, [(0, 1, 0)]), network=("main", "tele")))
    words = [losses_words(view.losses[name]) for name in view.networks]
    assert words == ["", "no packet yet since this page is open"]


def test_a_node_that_is_not_on_a_network_is_told_as_such() -> None:
    scenario = scenario_of("perfect", NODES, extra=TELE)
    off = ("1", "gcs")
    changed = [
        node.model_copy(update={"networks": ("main",)}) if node.node in off else node
        for node in scenario.nodes
    ]
    view = view_of(scenario.model_copy(update={"nodes": tuple(changed)}))
    words = [link_words(view, "tele", 0, rx) for rx in (1, 2)]
    assert words == ["UA 0 to UA 1: UA 1 is not on tele", "UA 0 to node gcs: node gcs is not on tele"]
    assert link_words(view, "tele", 1, 2).endswith("UA 1 and node gcs are not on tele")
    assert link_words(view, "main", 0, 1) == "UA 0 to UA 1: no packet yet"


class Reported:
    """The colour of a link on the map, report by report."""

    def __init__(self) -> None:
        self.view = view_of(scenario_of("perfect", ("0", "gcs"), extra=TELE))

    def report(self, second: float, main: tuple[float, int], tele: tuple[float, int]) -> int:
        """Of each network's newest packet the PER, and how many were sent by now."""
        both = [links(second, 100.0, per, sent, sent) for per, sent in (main, tele)]
        columns = {
            name: (*getattr(both[0], name), *getattr(both[1], name)) for name in ("tx", "rx", *FIGURES)
        }
        self.view.take(replace(both[0], **columns, network=("main", "tele"), radio=(0, 1)))
        quality: int = json.loads(PictureFrames(self.view).snapshot())["quality"][0]
        return quality


def test_a_network_by_which_nothing_goes_any_more_has_no_colour_on_the_map() -> None:
    report = Reported().report
    assert report(1.0, (1.0, 10), (0.0, 1)) == 100
    assert report(4.0, (1.0, 40), (0.0, 1)) == 100
    assert report(7.0, (1.0, 70), (0.0, 1)) == 0
    assert report(60.0, (1.0, 70), (0.0, 1)) == 0
    assert report(61.0, (1.0, 71), (0.0, 2)) == 100


def test_nor_has_it_where_one_begins_to_look_long_after() -> None:
    report = Reported().report
    report(60.0, (1.0, 600), (0.0, 10))
    assert report(60.2, (1.0, 602), (0.0, 10)) == 0
    assert report(61.0, (1.0, 610), (0.0, 11)) == 100
