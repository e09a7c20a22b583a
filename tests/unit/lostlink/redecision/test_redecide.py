"""The same radio and seed give the same fates, all of them; another radio those that a run with it has."""

from __future__ import annotations

import io
import json
import shutil
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from rich.console import Console

from bridge.bus.messages import CommandGoal
from bridge.bus.radio_command import radio_goal
from bridge.radio.ledger_file import LEDGER, write_ledger
from bridge.record.tables.deliveries import DELIVERIES, FATES, FIGURES, SAID
from bridge.record.tables.every import finish_tables
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import RadioOutage
from channel.presets import preset_names
from lostlink.reading.rows import LINK, DeliveryRows, link_rows
from lostlink.redecision.comparison import compare_decisions
from lostlink.redecision.output import sentence, tables
from lostlink.redecision.redecide import Redecision, redecide
from lostlink.redecision.rewrite import write_deliveries
from tests.unit.bridge.scenario.test_named_files import GAINS
from tests.unit.lostlink.replay.flown import TICK_NS, Router, Sent, everybody, flown, scenario_of, truths

NODES = ("0", "1", "2", "gcs")
SCALES = {
    "gz-rfcomms": 0.1,
    "gazebo-classic": 0.03,
    "telemetry-915": 150.0,
    "lte-like": 20.0,
    "wifi-2.4": 3.0,
    "wifi-5.8": 2.0,
    "sik-433": 150.0,
    "sik-868": 150.0,
    "rfd900x": 150.0,
    "xbee-900hp": 150.0,
    "elrs-2.4-333full": 150.0,
    "elrs-900-200": 150.0,
}


def without_time(preset: str) -> str:
    """A preset's physics, where packets take no time: as the router of these runs has it, which has no network."""
    return f"{{preset: {preset}, medium: {{model: ideal}}}}"


RADIOS = {
    "doppler": "{preset: corrected, fading: {model: rician, k_db: 3.0, coherence: doppler}}",
    "blocks": "{preset: corrected, fading: {model: rayleigh, coherence: block}}",
    "packet": "{preset: corrected, fading: {model: nakagami, m: 2.0}}",
    "shadowed": "{preset: corrected, shadowing: "
    "{model: gudmundson, sigma_db: 8, decorrelation_m: 30, shared_ends: 0.3}}",
    "bursts": "{preset: moon2020, bursts: "
    "{model: gilbert-elliott, mean_good_s: 0.3, mean_bad_s: 0.2, loss_good: 0.1, loss_bad: 0.9}}",
    "interfered": "{preset: corrected, interference: {interferers: "
    "[{position_ned_m: [300, 0, 0], power_dbm: 10, duty: 0.5, slot_s: 0.1}]}}",
    "sight": "{preset: lte-like}",
    "antennas": "{preset: corrected, antenna: {model: dipole}, polarisation: {}}",
    "lossy": "{preset: disk, base_loss: 0.2}",
}


def is_byte_for_byte(result: Redecision, tmp_path: Path) -> bool:
    """Whether the table is the very file that the run left."""
    write_deliveries(result, tmp_path / "again")
    mine, theirs = (DELIVERIES.parquet_path(path) for path in (tmp_path / "again", result.run))
    return mine.read_bytes() == theirs.read_bytes()


def fates(result: Redecision) -> set[str]:
    return {FATES[fate] for fate in result.after.columns["fate"].tolist()}


LIKE_OTHERS = {
    "elrs-900-200",
    "moon2020-table3",
    "rfd900x",
    "sik-433",
    "sik-868",
    "wifi-5.8",
    "xbee-900hp",
}
"""Presets that have the models of another one here, with other numbers."""


@pytest.mark.parametrize(
    "preset",
    [pytest.param(name, marks=[pytest.mark.long] if name in LIKE_OTHERS else []) for name in preset_names()],
)
def test_every_preset_decides_the_same_again(preset: str, tmp_path: Path) -> None:
    run = flown(
        tmp_path / "run", scenario_of(without_time(preset), NODES, seed=11), 70, scale=SCALES.get(preset, 1.0)
    )
    result = redecide(run)
    assert result.comparison.is_same
    assert result.comparison.fates == 70 * 4 * 3
    assert is_byte_for_byte(result, tmp_path)
    assert "delivered" in fates(result)
    assert len(fates(result)) > 1 or preset in ("perfect", "rf-sensor", "lte-uav", "satellite")


@pytest.mark.parametrize("radio", RADIOS.values(), ids=RADIOS)
def test_whatever_lasts_over_time_or_place_is_the_same_again(radio: str, tmp_path: Path) -> None:
    scale = 20.0 if "lte" in radio else 1.5
    run = flown(tmp_path / "run", scenario_of(radio, NODES, seed=5), 200, scale=scale)
    result = redecide(run)
    assert is_byte_for_byte(result, tmp_path)
    assert len(fates(result)) > 1
    other = redecide(run, seed=6).comparison
    assert other.changed
    assert not other.is_same


def test_each_nodes_own_radio_counts(tmp_path: Path) -> None:
    scenario = scenario_of("corrected", NODES)
    strong = {"preset": "corrected", "transmit_power_dbm": 40.0, "antenna": {"model": "dipole"}}
    nodes = tuple(n.model_copy(update={"radio": strong}) if n.node == "gcs" else n for n in scenario.nodes)
    run = flown(tmp_path / "run", scenario.model_copy(update={"nodes": nodes}), 100)
    assert is_byte_for_byte(redecide(run), tmp_path)
    counts = counts_of(redecide(run).after)[..., 0]
    assert counts[3].sum() > counts[:3].sum() / 3


def counts_of(rows: DeliveryRows) -> NDArray[np.int64]:
    """Packets by sender, receiver and fate."""
    each, nodes = rows.each(), len(rows.nodes)
    return each.cells(each.link, nodes**2).reshape(nodes, nodes, -1)


def some(number: int) -> list[Sent]:
    """Packets to all and to one, of many lengths, none, several; some that never came, some that are too long."""
    found = [Sent("0", length=10 * number), Sent("1", to="gcs", length=7)]
    found += [Sent("gcs", to="2"), Sent("0", to="1", length=300)] if number % 3 == 0 else []
    found += [Sent("1", lost=2)] if number % 17 == 5 else []
    return found


def test_packets_to_one_and_of_all_lengths_and_gaps_are_the_same_again(tmp_path: Path) -> None:
    radio = "{preset: corrected, mtu_bytes: 250}"
    run = flown(tmp_path / "run", scenario_of(radio, NODES), 60, some)
    result = redecide(run)
    assert result.comparison.is_same
    assert is_byte_for_byte(result, tmp_path)
    assert {"too_long", "transport"} <= fates(result)


def test_nodes_that_come_late_are_unknown_as_long_as_they_were(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("moon2020", NODES), 70, late=["2"])
    result = redecide(run)
    assert is_byte_for_byte(result, tmp_path)
    unknown = counts_of(result.after)[..., FATES.index("no_position")]
    assert unknown[2, 0] > 10
    assert unknown[0, 1] == 0


def test_a_node_that_was_let_go_stands_until_it_is_back(tmp_path: Path) -> None:
    """Its truth stops for two seconds: after one, the others' packets are settled as if it stood."""
    router = Router(tmp_path / "run", scenario_of("moon2020", NODES))
    for number in range(100):
        gone = ["1"] if 30 <= number < 70 else []
        router.tick(
            number * TICK_NS, truths(scenario_of("moon2020", NODES), number, gone), everybody(NODES)(0)
        )
    assert is_byte_for_byte(redecide(router.close()), tmp_path)


def test_packets_of_a_free_program_may_come_early_or_late(tmp_path: Path) -> None:
    def send(number: int) -> list[Sent]:
        at_ns = number * TICK_NS
        early, late = at_ns + 3 * TICK_NS + 7_000_000, max(0, at_ns - 11_000_000)
        return [Sent("0", sim_time_ns=early), Sent("1", sim_time_ns=late), Sent("2")]

    run = flown(tmp_path / "run", scenario_of("corrected", NODES), 80, send)
    assert is_byte_for_byte(redecide(run), tmp_path)


TDMA = "{preset: corrected, mtu_bytes: 280, medium: {model: tdma, slot_s: 0.06, guard_s: 0.001}}"
"""Packets of one tick arrive in several, later ones of other nodes before them."""
OTHERS = [
    pytest.param(without_time("wifi-2.4"), marks=pytest.mark.slow),
    "disk",
    pytest.param("lte-like", marks=pytest.mark.slow),
    "{preset: corrected, mtu_bytes: 100}",
    pytest.param(without_time("telemetry-915"), marks=pytest.mark.long),
    TDMA,
    "{preset: corrected, mtu_bytes: 100, medium: {model: airtime}}",
]


@pytest.mark.parametrize("radio", OTHERS)
@pytest.mark.parametrize(
    "send", [pytest.param(None, id="states", marks=pytest.mark.slow), pytest.param(some, id="some")]
)
def test_another_radio_is_as_a_run_with_it(
    radio: str, send: Callable[[int], Sequence[Sent]] | None, tmp_path: Path
) -> None:
    was = "{preset: moon2020, mtu_bytes: 250}"
    run = flown(tmp_path / "run", scenario_of(was, NODES, seed=2), 60, send)
    fresh = flown(tmp_path / "fresh", scenario_of(radio, NODES, seed=9), 60, send)
    asked = scenario_of(radio, NODES).radio
    result = redecide(run, radio=asked, seed=9)
    write_deliveries(result, tmp_path / "anew")
    mine, theirs = (DELIVERIES.parquet_path(tmp_path / name) for name in ("anew", "fresh"))
    assert mine.read_bytes() == theirs.read_bytes()
    assert not result.comparison.is_same
    for flown_so, name in ((run, "delay_mean_before_s"), (fresh, "delay_mean_after_s")):
        assert delays_of(flown_so) == {
            (link.tx, link.rx): pytest.approx(getattr(link, name))
            for link in result.comparison.links
            if getattr(link, name) is not None
        }


def delays_of(run: Path) -> dict[tuple[str, str], float]:
    """Mean delay of what arrived, by link, by pandas."""
    rows = pq.read_table(DELIVERIES.parquet_path(run)).to_pandas()
    rows = rows[rows["fate"] == "delivered"]
    delay_s = (rows["arrived_ns"] - rows["sim_time_ns"]) / 1e9
    means: dict[tuple[str, str], float] = (
        delay_s.groupby([rows["tx"].astype(str), rows["rx"].astype(str)]).mean().to_dict()
    )
    return means


@pytest.mark.slow
@pytest.mark.parametrize("mtu_bytes", [250, 280], ids=["other rows", "the same rows"])
def test_another_radio_beside_a_second_network_is_as_a_run_with_it(mtu_bytes: int, tmp_path: Path) -> None:
    def send(number: int) -> list[Sent]:
        return [*some(number), Sent("gcs", radio="mesh"), Sent("0", radio="mesh"), Sent("0")]

    mesh = "networks: {mesh: {preset: perfect}}\n"
    run = flown(
        tmp_path / "run", scenario_of(f"{{preset: disk, mtu_bytes: {mtu_bytes}}}", NODES, 2, mesh), 40, send
    )
    flown(tmp_path / "fresh", scenario_of(TDMA, NODES, 2, mesh), 40, send)
    result = redecide(run, radio=scenario_of(TDMA, NODES).radio)
    write_deliveries(result, tmp_path / "anew")
    mine, theirs = (DELIVERIES.parquet_path(tmp_path / name) for name in ("anew", "fresh"))
    assert mine.read_bytes() == theirs.read_bytes()


def test_what_only_arrives_later_is_not_the_same(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("moon2020", NODES), 20)
    names = tuple(column.name for column in DELIVERIES.columns if column.name not in (*SAID, *LINK))
    before = link_rows(run, NODES, names)
    arrived_ns = before.columns["arrived_ns"]
    later = DeliveryRows(
        before.nodes, before.columns | {"arrived_ns": np.where(arrived_ns < 0, arrived_ns, arrived_ns + 1000)}
    )
    same, other = (compare_decisions(before, after, {}) for after in (before, later))
    assert (same.is_same, other.is_same, other.changed) == (True, False, 0)
    assert sentence(same).endswith("with their powers and error rates, at the same instants")
    assert sentence(other).endswith("but not all powers, error rates and instants of arrival")


def test_a_killed_run_is_decided_as_far_as_it_goes(tmp_path: Path) -> None:
    scenario = scenario_of("moon2020", NODES)
    run = flown(tmp_path / "killed", scenario, 60, killed=True)
    truth, deliveries = run / "truth.journal", run / "deliveries.journal"
    truth.write_bytes(truth.read_bytes()[:-1000])
    deliveries.write_bytes(deliveries.read_bytes()[:-2000])
    comparison = redecide(run).comparison
    assert comparison.changed == 0
    assert comparison.fates > 600
    assert 0 < comparison.not_compared < 60
    assert not comparison.differs
    assert not comparison.is_same
    finish_tables(run)
    assert redecide(run).comparison.changed == 0


def test_the_table_is_that_of_the_file(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("moon2020", NODES), 20)
    table = redecide(run).table
    theirs = pq.read_table(run / "deliveries.parquet")
    assert table.schema == theirs.schema
    for name in theirs.column_names:
        assert table[name].to_pylist() == pytest.approx(theirs[name].to_pylist(), abs=0.0, nan_ok=True)


def test_what_changed_is_told_by_link_cause_and_distance(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("disk", NODES), 40)
    comparison = redecide(run, radio="perfect").comparison
    columns = redecide(run).before.columns
    beyond = int(np.count_nonzero(columns["distance_m"] > 400.0))
    assert comparison.changes == ({"before": "out_of_range", "after": "delivered", "packets": beyond},)
    assert comparison.changed == beyond > 0
    assert sum(link.delivered_after for link in comparison.links) == 480
    assert sum(link.delivered_before for link in comparison.links) == 480 - beyond
    far = [b for b in comparison.bins if b.distance_min_m >= 400.0]
    assert far
    assert all((b.delivered_before, b.delivered_after, b.predicted_after) == (0, b.sent, 1.0) for b in far)
    assert sum(b.sent for b in comparison.bins) == 480


@pytest.mark.parametrize("radio", [pytest.param("telemetry-915", marks=pytest.mark.long), "wifi-2.4"])
def test_by_distance_is_told_what_arrived_also_where_packets_take_time(radio: str, tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("perfect", NODES), 40)
    result = redecide(run, radio=radio)
    bins, links = result.comparison.bins, result.comparison.links
    assert sum(b.sent for b in bins) == sum(link.sent for link in links) == 480
    assert sum(b.delivered_before for b in bins) == 480
    assert sum(b.delivered_after for b in bins) == sum(link.delivered_after for link in links) < 480
    assert {b.predicted_after for b in bins} == {None}
    write_ledger(tmp_path / LEDGER, result.books, {})
    assert {b["of"] for b in json.loads((tmp_path / LEDGER).read_text())["bins"]} == {"transmissions"}
    assert {b["of"] for b in json.loads((run / LEDGER).read_text())["bins"]} == {"packets"}


def test_what_cannot_be_decided_is_said(tmp_path: Path) -> None:
    scenario: Scenario = scenario_of("moon2020", NODES)
    run = flown(tmp_path / "run", scenario, 5)
    with pytest.raises(ValueError, match="no-such-radio"):
        redecide(run, radio="no-such-radio")
    (run / "truth.parquet").unlink()
    with pytest.raises(ValueError, match=r"truth\.parquet"):
        redecide(run)
    with pytest.raises(ValueError, match="is not the directory of a run"):
        redecide(tmp_path)


OFF_TICKS = {"1": [(20, 35), (50, 60)], "gcs": [(10, 30)]}
"""By node, the ticks in which its radio is off: from, and up to."""


def with_outages(path: Path, radio: str) -> Path:
    """An operator switches node 1's radio, the scenario that of the ground node; one command says neither."""
    scenario = scenario_of(radio, NODES, seed=4)
    off = RadioOutage(from_s=10 * TICK_NS / 1e9, to_s=30 * TICK_NS / 1e9)
    nodes = tuple(
        n.model_copy(update={"radio_off": (off,)}) if n.node == "gcs" else n for n in scenario.nodes
    )
    router = Router(path, scenario.model_copy(update={"nodes": nodes}))
    said = {20: radio_goal(on=False), 35: radio_goal(on=True), 50: radio_goal(on=False), 55: CommandGoal()}
    said[60] = radio_goal(on=True)
    for number in range(80):
        if number in said:
            router.command("1", number * TICK_NS, "radio", said[number])
        if number == 40:
            router.command("1", number * TICK_NS, "rtl", CommandGoal())
        router.tick(number * TICK_NS, truths(scenario, number, (), 0.5), everybody(NODES)(number))
    return router.close()


def lost_by_outage(result: Redecision, side: str) -> set[tuple[str, str, int]]:
    columns = getattr(result, side).columns
    rows = np.flatnonzero(columns["fate"] == FATES.index("radio_off"))
    ends = ([NODES[i] for i in columns[name][rows]] for name in ("tx", "rx"))
    return set(zip(*ends, (columns["sim_time_ns"][rows] // TICK_NS).tolist(), strict=True))


@pytest.mark.parametrize("radio", [None, without_time("wifi-2.4"), "perfect"])
def test_radios_that_were_off_stay_off_whatever_the_radio(radio: str | None, tmp_path: Path) -> None:
    run = with_outages(tmp_path / "run", "moon2020")
    result = redecide(run, radio=None if radio is None else scenario_of(radio, NODES).radio)
    expected = {
        (tx, rx, tick)
        for tx in NODES
        for rx in NODES
        for tick in range(80)
        if tx != rx
        and any(first <= tick < last for end in (tx, rx) for first, last in OFF_TICKS.get(end, ()))
    }
    assert lost_by_outage(result, "before") == lost_by_outage(result, "after") == expected
    assert sum(link.lost_after.get("radio_off", 0) for link in result.comparison.links) == len(expected)
    assert sum(b.sent for b in result.comparison.bins) == 80 * 12 - len(expected)
    assert result.comparison.is_same is (radio is None)
    if radio is None:
        assert is_byte_for_byte(result, tmp_path)


def test_packets_stamped_beyond_the_last_tick_end_with_the_run(tmp_path: Path) -> None:
    """Node 0 stamps three ticks ahead: three packets are due when the run is over, at each of three receivers."""

    def send(number: int) -> list[Sent]:
        return [Sent("0", sim_time_ns=(number + 3) * TICK_NS), Sent("1")]

    radio = "{preset: corrected, medium: {model: airtime}}"
    result = redecide(flown(tmp_path / "run", scenario_of(radio, NODES), 20, send))
    assert is_byte_for_byte(result, tmp_path)
    assert counts_of(result.after)[0, :, FATES.index("run_ended")].tolist() == [0, 3, 3, 3]


def test_a_run_is_decided_anew_without_any_file_of_its_radio(tmp_path: Path) -> None:
    """The folder with the scenario's radio and its map is gone, and the run lies elsewhere."""
    work = tmp_path / "work"
    work.mkdir()
    (work / "gains.csv").write_text(GAINS)
    (work / "lab.yaml").write_text(
        "preset: corrected\npropagation: {model: gain-map, file: gains.csv, outside: fallback}\n"
    )
    run = flown(work / "run", scenario_of(str(work / "lab.yaml"), NODES)).rename(tmp_path / "run")
    shutil.rmtree(work)
    assert redecide(run).comparison.is_same
    assert redecide(run, radio="wifi-2.4").comparison.changed > 0


def test_packets_that_cannot_be_told_apart_are_not_decided(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("moon2020", NODES), 20)
    path = DELIVERIES.parquet_path(run)
    pq.write_table(pq.read_table(path).take([0, 0, 1]), path)
    with pytest.raises(ValueError, match=f"{path.name}: a packet has two rows"):
        redecide(run)


def test_what_a_network_does_is_not_told_of_packets_of_another(tmp_path: Path) -> None:
    """Of `mesh`, where packets take time and far nodes hear nothing, nothing is predicted."""
    mesh = "networks: {mesh: {preset: wifi-2.4, transmit_power_dbm: -60}}\n"
    scenario = scenario_of("perfect", NODES, extra=mesh)
    run = flown(tmp_path / "run", scenario, 40, lambda number: [*some(number), Sent("0", radio="mesh")])
    result = redecide(run)
    comparison, books = result.comparison, result.books
    assert {(b.radio, b.predicted_after) for b in comparison.bins} == {("main", 1.0), ("mesh", None)}
    assert {b.delivered_after for b in comparison.bins if b.radio == "mesh"} == {0}
    counts = {(link.radio, link.tx, link.rx): (link.sent, link.delivered_after) for link in comparison.links}
    assert counts == {
        (each.radio, *ends): (account.sent, account.delivered)
        for each in books
        for ends, account in each.ledger.links.items()
    }
    assert counts["mesh", "0", "gcs"] == (40, 0)
    alone = replace(
        comparison,
        links=[link for link in comparison.links if link.radio == "mesh"],
        bins=[row for row in comparison.bins if row.radio == "mesh"],
    )
    for each in (comparison, alone):
        shown = Console(width=200, record=True, file=io.StringIO())
        shown.print(*tables(each))
        text = " ".join(shown.export_text().split())
        assert "mesh: 0 -> 1" in text
        assert "all links of mesh" in text


def test_rows_in_one_order_are_compared_without_a_copy_of_them() -> None:
    rows = 50_000
    number = np.arange(rows)
    columns = {
        "sim_time_ns": number * 1000,
        "tx": number % 2,
        "rx": 1 - number % 2,
        "seq": number // 2,
        "packets": np.ones(rows, dtype=np.int32),
        "fate": np.zeros(rows, dtype=np.intp),
        "arrived_ns": number * 1000,
        "radio": np.full(rows, "main", dtype=object),
        **dict.fromkeys(FIGURES, np.full(rows, 20.0)),
    }
    before, after = (DeliveryRows(("0", "1"), dict(columns)) for _ in range(2))
    compare_decisions(before, after, {})
    tracemalloc.start()
    found = compare_decisions(before, after, {})
    peak = tracemalloc.get_traced_memory()[1] / rows
    tracemalloc.stop()
    assert found.is_same
    assert peak < 120.0  # bytes a row: 240 with copies in the order of their keys
    shuffled = after.at(np.random.default_rng(1).permutation(rows))
    assert compare_decisions(before, shuffled, {}).links == found.links
