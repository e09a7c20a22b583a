"""Load, use, waits and delays of hand-made rows, against sums written out; capacities against arithmetic of frames."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.record.tables.deliveries import FATES
from channel.access.settings.sik import _carried_bps
from lostlink.reading.air.account import AirAccount, AirTally
from lostlink.reading.air.capacity import Capacity, rate_text
from lostlink.reading.air.too_long import TooLong, remark_of, warnings_of
from lostlink.reading.air.use import (
    BUSY_NS,
    NEEDED,
    delays_of,
    edges_of,
    frames_of,
    offered_of,
    payloads_of,
    quantiles,
    received_of,
)
from lostlink.reading.rows import LINK, DeliveryRows, link_rows
from tests.unit.lostlink.replay.flown import Sent, flown, scenario_of

MS, S = 1_000_000, 1_000_000_000
NODES = ("0", "1", "2")
"""On telemetry-915, which adds 8 bytes to a payload and has 64 kb/s."""
MOON_BPS = 20e6
IDEAL = "{preset: telemetry-915, medium: {model: ideal}}"
TDMA = "{preset: telemetry-915, medium: {model: tdma, slot_s: 0.1, guard_s: 0.01}}"
AIRTIME = "{preset: telemetry-915, medium: {model: airtime, preamble_s: 0.002, header_bytes: 12}}"
CSMA = "{preset: telemetry-915, medium: {model: csma, channels: {}}}"
SIK = "{preset: telemetry-915}"
ELRS = "{preset: elrs-2.4-333full}"
DELAY = "{preset: telemetry-915, medium: {model: delay, least_s: 0, median_s: 0, most_s: 0, rate_bps: 1000}}"


def capacity(radio: str) -> Capacity:
    return Capacity.of(scenario_of(radio, NODES))


def account_of(given: DeliveryRows, of: Capacity, end_ns: int, on_air_ns: int | None = None) -> AirAccount:
    tally = AirTally(of)
    tally.add(given)
    return tally.account(end_ns, on_air_ns)


def rows(*given: dict[str, Any]) -> DeliveryRows:
    """A row of each, all at once, one packet of 92 bytes from 0 to 1 that is delivered unless it says otherwise."""
    plain = {
        "tx": 0,
        "rx": 1,
        "packets": 1,
        "fate": "delivered",
        "length_bytes": 100,
        "seq": 0,
        "attempts": 1,
        "radio": "main",
    }
    found = []
    for row in given:
        at_ns = row.get("sim_time_ns", 0)
        instants = dict.fromkeys(("sim_time_ns", "entered_ns", "started_ns", "ended_ns", "arrived_ns"), at_ns)
        found.append(plain | instants | row)
    columns = {name: np.array([row[name] for row in found]) for name in (*LINK, *NEEDED) if name != "fate"}
    return DeliveryRows(NODES, columns | {"fate": np.array([FATES.index(row["fate"]) for row in found])})


def test_periods_are_whole_and_the_last_has_what_is_left() -> None:
    assert edges_of(25 * S, 10 * S).tolist() == [0, 10 * S, 25 * S]
    assert edges_of(3 * S, 10 * S).tolist() == [0, 3 * S]
    assert edges_of(0, 10 * S).tolist() == [0, 1]


def test_a_packet_counts_once_whoever_it_is_for_and_what_the_host_lost_not_at_all() -> None:
    given = rows(
        {"rx": 1},
        {"rx": 2, "fate": "queue_full"},
        {"tx": 1, "rx": 0},
        {"seq": 1, "sim_time_ns": 3 * S, "length_bytes": 48},
        {"tx": 2, "rx": 1, "packets": 50, "fate": "transport"},
    )
    offered = offered_of(given, capacity(IDEAL))
    edges = np.array([0, 2 * S, 4 * S])
    assert offered.payload_bytes.tolist() == [92, 40, 92]
    assert offered.bits_per_s(edges).tolist() == [8 * (92 + 92) / 2, 8 * 40 / 2]
    assert offered.shares(edges) == pytest.approx([8 * 200 / 2 / 64e3, 8 * 48 / 2 / 64e3])


def test_a_line_of_each_sender_is_as_full_as_the_fullest() -> None:
    given = rows({}, {"seq": 1}, {"tx": 1, "rx": 0})
    offered = offered_of(given, capacity(DELAY))
    assert capacity(DELAY).shared_by == "sender"
    assert offered.shares(np.array([0, S])) == pytest.approx([2 * 8 * 92 / 1000])


def test_a_transmitter_of_expresslrs_has_half_of_what_its_receiver_has() -> None:
    """62 bytes in 7 frames: up one in four slots of 3003 us beside a remote control, down one in two; 2 has no peer."""
    given = rows(*({"tx": tx, "rx": 1 - tx % 2, "seq": seq} for tx in (0, 1, 2) for seq in range(10)))
    account = account_of(given, capacity(ELRS), S)
    up_bytes_per_s = 62 / (7 * 4 * 0.003003)
    payload_bytes = payloads_of(given, capacity(ELRS)).tolist()[0]
    assert account.capacity_bps == pytest.approx(8 * up_bytes_per_s)
    assert account.share == pytest.approx(10 * payload_bytes / up_bytes_per_s)
    assert [capacity(ELRS).packet_s(node, 92) for node in ("0", "1")] == pytest.approx(
        [92 / up_bytes_per_s, 92 / 2 / up_bytes_per_s], rel=0.01
    )


def test_each_pair_of_sik_radios_has_its_own_time() -> None:
    """Packets of 92 bytes: 10 of each of the one pair, 5 of each of the other, which have another NETID."""
    one, two = (Capacity.of(scenario_of(SIK, nodes)) for nodes in (NODES[:2], (*NODES, "3")))
    given = rows(
        *({"tx": tx, "rx": tx ^ 1, "seq": seq} for tx in range(4) for seq in range(10 if tx < 2 else 5))
    )
    given = replace(given, nodes=(*NODES, "3"))
    share = 20 * one.packet_s("0", 92)
    account = account_of(given, two, S)
    assert (one.shared_by, two.shared_by, account.is_shared) == ("all", "group", False)
    assert account.share == pytest.approx(share)
    assert account.capacity_bps == pytest.approx(8 * 92 / one.packet_s("0", 92))


def test_one_alone_of_a_pair_of_sik_radios_cannot_use_all_of_its_time() -> None:
    """Packets of 92 bytes fill half of a window: what two carry together is more than one can alone."""
    pair = Capacity.of(scenario_of(SIK, NODES[:2]))
    alone = rows(*({"seq": seq, "fate": "queue_full"} for seq in range(40)))
    account, own_s = account_of(alone, pair, S), pair.own_s("0", 92)
    both = account_of(
        rows(*({"tx": tx, "rx": 1 - tx, "seq": seq} for tx in (0, 1) for seq in range(20))), pair, S
    )
    assert own_s / pair.packet_s("0", 92) == pytest.approx(1.6, rel=0.05)
    assert (account.shared_by, account.share) == ("sender", pytest.approx(40 * own_s))
    assert account.busiest_share == pytest.approx(account.share)
    assert account.capacity_bps == pytest.approx(8 * 92 / own_s)
    assert "of one sender" in "".join(account.warnings)
    assert (both.shared_by, both.share) == ("all", pytest.approx(40 * pair.packet_s("0", 92)))


def test_of_many_lengths_some_are_tried_on_sik_radios(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes a tenth of a second, and a run may have hundreds; what is too long still needs nothing."""
    monkeypatch.setattr("lostlink.reading.air.use.TRIED_MAX", 4)
    pair = Capacity.of(
        scenario_of("{preset: telemetry-915, medium: {model: sik, max_window_ms: 20}}", NODES[:2])
    )
    lengths = [*range(50, 290, 30), 5000]
    many = rows(*({"seq": seq, "length_bytes": 8 + length} for seq, length in enumerate(lengths)))
    _carried_bps.cache_clear()
    need_s, own_s = offered_of(many, pair).need_s
    assert _carried_bps.cache_info().misses == 2 * 4
    assert (need_s[-1], own_s[-1]) == (0.0, 0.0)
    exact_s = np.array([pair.packet_s("0", length) for length in lengths])
    assert need_s.sum() == pytest.approx(exact_s.sum(), rel=0.1)
    assert (need_s == exact_s).sum() == 4 + 1


def test_each_sender_has_its_own_slots() -> None:
    """7 packets fit into each third slot of 0.1 s; node 0 offers 40 in a second, which all slots would carry."""
    account = account_of(rows(*({"seq": seq, "fate": "queue_full"} for seq in range(40))), capacity(TDMA), S)
    assert (account.shared_by, account.share) == ("sender", pytest.approx(40 / (7 / 0.3)))
    assert "40 receptions were lost for want of time on the air" in "".join(account.warnings)


def test_packets_that_newer_ones_replaced_are_told_apart() -> None:
    """An agent that sends its newest state with a key wants these lost."""
    fates = ["replaced"] * 30 + ["queue_full"] * 10
    account = account_of(
        rows(*({"seq": seq, "fate": fate} for seq, fate in enumerate(fates))), capacity(TDMA), S
    )
    assert (account.lost_waiting, account.replaced) == (40, 30)
    (warning,) = account.warnings
    assert warning.endswith(
        "40 receptions were lost for want of time on the air, 30 of them to newer packets with their key"
    )


@pytest.mark.parametrize("medium", ["airtime", "csma"])
def test_each_channel_has_its_own_time(medium: str) -> None:
    """Nodes 0 and 1 offer 10 packets each, node 2 on another channel 15."""
    alone, apart = (
        capacity(f"{{preset: telemetry-915, medium: {{model: {medium}, channels: {channels}}}}}")
        for channels in ("{}", "{'2': 5}")
    )
    given = rows(*({"tx": tx, "seq": seq} for tx in range(3) for seq in range(15 if tx == 2 else 10)))
    shares = [account_of(given, each, S).share / alone.packet_s("0", 92) for each in (alone, apart)]
    assert (alone.shared_by, apart.shared_by) == ("all", "group")
    assert shares == pytest.approx([35, 20])


def test_use_is_the_sum_of_frames_each_once_with_its_attempts() -> None:
    """300 ms across an edge, heard by two; one of another sender at once; one of 50 ms that was tried twice."""
    given = rows(
        {"rx": 1, "started_ns": 900 * MS, "ended_ns": 1200 * MS},
        {"rx": 2, "started_ns": 900 * MS, "ended_ns": 1200 * MS, "fate": "collided"},
        {"tx": 1, "rx": 2, "started_ns": 900 * MS, "ended_ns": 1000 * MS},
        {"tx": 2, "rx": 0, "started_ns": 1500 * MS, "ended_ns": 1550 * MS, "attempts": 2},
        {"seq": 9, "started_ns": -1, "ended_ns": -1, "fate": "queue_full", "attempts": 0},
    )
    use = frames_of(given).use(np.array([0, S, 2 * S]))
    assert use == pytest.approx([0.1 + 0.1, 0.2 + 2 * 0.05])
    assert frames_of(rows({}, {"seq": 1})).use(np.array([0, S])).tolist() == [0.0]  # nothing takes time


def test_quantiles_are_values_that_a_share_does_not_exceed() -> None:
    place = np.array([2] * 20 + [0])
    values = np.array([*range(20, 0, -1), 7.0])
    found = quantiles(place, values, 3)
    assert found[:, 2].tolist() == [10.0, 19.0]  # of 1 to 20: ten are at most 10, nineteen at most 19
    assert found[:, 0].tolist() == [7.0, 7.0]
    assert np.isnan(found[:, 1]).all()


def test_waits_and_delays_are_differences_of_instants() -> None:
    first = {"entered_ns": 20 * MS, "started_ns": 50 * MS, "ended_ns": 60 * MS}
    given = rows(
        first | {"rx": 1, "arrived_ns": 61 * MS},
        first | {"rx": 2, "arrived_ns": 65 * MS, "fate": "channel_erasure"},
        {
            "seq": 1,
            "sim_time_ns": S,
            "entered_ns": S,
            "started_ns": S,
            "ended_ns": S + MS,
            "arrived_ns": S + 2 * MS,
        },
    )
    edges = np.array([0, S, 2 * S])
    assert frames_of(given).waits(edges)[0] == pytest.approx([0.03, 0.0])
    delays = delays_of(given)
    assert delays.delay_s == pytest.approx([0.061, 0.002])
    assert delays.over_time(edges)[1] == pytest.approx([0.061, 0.002])


def test_what_a_node_receives_is_payload() -> None:
    given = rows({}, {"seq": 1, "sim_time_ns": 3 * S}, {"seq": 2, "fate": "collided"})
    assert received_of(given, capacity(IDEAL)).most_per_s(3, 2 * S).tolist() == [0, 8 * 92 / 2, 0]
    assert received_of(given, capacity(IDEAL)).most_per_s(3, 4 * S).tolist() == [0, 2 * 8 * 92 / 4, 0]


def test_what_waits_is_received_when_it_arrives() -> None:
    """Sent at once, one comes after 1 s and one after 12: never both within 10 s."""
    given = rows({"arrived_ns": S}, {"seq": 1, "arrived_ns": 12 * S})
    assert received_of(given, capacity(IDEAL)).most_per_s(3, 20 * S).tolist() == [0, 8 * 92 / 10, 0]


@pytest.mark.parametrize(
    ("radio", "payload", "packet_s"),
    [
        (IDEAL, 92, 8 * 100 / 64e3),
        ("moon2020", 400, 8 * 400 / MOON_BPS),  # all packets count as 40 bytes, but longer ones are longer
        (AIRTIME, 92, 0.002 + 8 * 104 / 64e3),
        # DIFS, back-off, 20 us, 132 symbols of 4 us for 328 + 36 + 28 bytes, 6 us
        ("wifi-2.4", 328, 28e-6 + 7.5 * 9e-6 + 554e-6),
        (TDMA, 92, 0.3 / 7),  # 90 ms of each third slot have room for 7 frames of 11.5 ms
        (TDMA, 721, 0.0),  # 90.125 ms: for none
        (DELAY, 92, 8 * 92 / 1000),
    ],
)
def test_what_a_packet_needs(radio: str, payload: int, packet_s: float) -> None:
    assert capacity(radio).packet_s("0", payload) == pytest.approx(packet_s)


@pytest.mark.parametrize(
    ("medium", "longest"),
    [
        ("airtime, max_length_bytes: 100", 100),
        ("tdma, slot_s: 0.5, max_length_bytes: 100", 100),
        ("delay, least_s: 0, median_s: 0, most_s: 0, rate_bps: 1000, max_length_bytes: 100", 100),
        ("elrs, buffer_bytes: 100", 100),
        ("csma, standard: 11g", 2296),
        ("csma, standard: 11g, header_bytes: 28", 2268),
        ("sik", 1850),
    ],
)
def test_a_packet_that_is_too_long_for_the_medium_needs_none_of_its_time(medium: str, longest: int) -> None:
    """A package of 328 bytes on `max_length_bytes: 100` was told to take its share, and no word that none arrives."""
    found = capacity(f"{{preset: telemetry-915, medium: {{model: {medium}}}}}")
    assert found.packet_s("0", longest) > 0.0
    assert found.packet_s("0", longest + 1) == 0.0


def test_a_packet_needs_the_time_that_it_takes_at_its_senders_bit_rate() -> None:
    """92 bytes and 12 of header at 64 kb/s, and at 250 kb/s from node 2."""
    scenario = scenario_of(AIRTIME, NODES)
    medium = {"model": "airtime", "preamble_s": 0.002, "header_bytes": 12}
    fast = {"preset": "telemetry-915", "bit_rate_bps": 250e3, "medium": medium}
    nodes = tuple(n.model_copy(update={"radio": fast}) if n.node == "2" else n for n in scenario.nodes)
    found = Capacity.of(scenario.model_copy(update={"nodes": nodes}))
    rates_bps = [250e3 if node == "2" else 64e3 for node in NODES]
    expected_s = [0.002 + 8 * 104 / rate_bps for rate_bps in rates_bps]
    assert [found.packet_s(node, 92) for node in NODES] == pytest.approx(expected_s)


def test_an_account_of_too_much_for_a_bit_rate_warns_and_says_it_in_numbers() -> None:
    """1400 B and 8 of header, 10 from each of two in a second: 225280 bits where 64 kb/s carry 64000."""
    given = rows(
        *({"tx": tx, "rx": 2, "seq": seq, "length_bytes": 1408} for tx in (0, 1) for seq in range(10))
    )
    account = account_of(given, capacity(IDEAL), S)
    assert account.offered_bps == account.received_most_bps == 20 * 8 * 1400
    assert account.share == account.busiest_share == pytest.approx(20 * 8 * 1408 / 64e3)
    assert account.capacity_bps == pytest.approx(64e3 * 1400 / 1408)
    assert (account.received_most_node, account.received_most_share) == ("2", pytest.approx(3.5))
    assert (account.use_share, account.delay_p95_s) == (None, None)
    assert account.warnings == [
        "the medium is ideal, where packets take no time: node 2 received 224 kbit/s over a radio of 64 kbit/s, and "
        "the nodes offered 3.52 times what the radio's bit rate carries; give it a medium: radio.medium"
    ]
    assert account.remark == "medium ideal, offered 3.52 times what it could carry"
    json.dumps(account.plain, allow_nan=False)


def test_too_much_in_the_busiest_ten_seconds_counts_also_in_a_long_run() -> None:
    burst = [{"seq": seq, "length_bytes": 8008, "sim_time_ns": 15 * S, "fate": "burst"} for seq in range(15)]
    account = account_of(rows(*burst), capacity(IDEAL), 100 * S)
    assert account.busiest_share == pytest.approx(10 * account.share) == pytest.approx(15 * 8 * 8008 / 64e4)
    assert "the nodes offered 9.6 kbit/s, 1.5 times" in account.warnings[0]
    assert BUSY_NS == 10 * S


@pytest.mark.parametrize("end_s", [19, 20, 40])
@pytest.mark.parametrize("begin_s", [0, 3, 9])
def test_the_busiest_ten_seconds_may_begin_at_any_time(begin_s: int, end_s: int) -> None:
    """A packet a second for ten, wherever the run's tens of seconds begin."""
    burst = [
        {"seq": at, "length_bytes": 8008, "sim_time_ns": (begin_s + at) * S, "fate": "burst"}
        for at in range(10)
    ]
    account = account_of(rows(*burst), capacity(IDEAL), end_s * S)
    assert account.busiest_share == pytest.approx(8 * 8008 / 64e3)


def test_what_a_medium_has_no_room_for_is_not_among_what_it_carries() -> None:
    """7 packets of 92 bytes fit into a slot, none of 4000."""
    too_long = {"fate": "too_long_for_a_slot", "length_bytes": 4008, "started_ns": -1, "ended_ns": -1}
    given = rows(*({"seq": seq} for seq in range(10)), *(too_long | {"seq": seq} for seq in range(10, 20)))
    account = account_of(given, capacity(TDMA), S)
    assert account.share == pytest.approx(10 * 0.3 / 7)
    assert account.capacity_bps == pytest.approx(8 * 92 * 7 / 0.3)
    assert account.offered_bps == pytest.approx(10 * 8 * (92 + 4000))


@pytest.mark.parametrize(
    ("fate", "warns"), [("queue_full", True), ("delivered", False), ("run_ended", False)]
)
def test_on_a_medium_too_much_is_warned_of_if_it_shows(fate: str, warns: bool) -> None:
    given = rows(*({"seq": seq, "fate": fate, "ended_ns": 11_500_000} for seq in range(100)))
    account = account_of(given, capacity(TDMA), S)
    assert account.busiest_share == pytest.approx(100 * 0.3 / 7)
    assert account.capacity_bps == pytest.approx(8 * 92 * 7 / 0.3)
    assert account.lost_waiting == (0 if fate == "delivered" else 100)
    assert account.waiting_at_end == (100 if fate == "run_ended" else 0)
    assert ("4.29 times the 17.2 kbit/s of one sender that it carries" in "".join(account.warnings)) is warns
    assert account.remark.startswith("medium tdma, offered" if warns else "medium tdma")


@pytest.mark.parametrize(
    ("fate", "period_ns", "warns"),
    [("collided", S, True), ("half_duplex", S, True), ("delivered", S, False), ("collided", 50 * MS, False)],
)
def test_nodes_that_transmit_at_the_same_tick_are_warned_of(fate: str, period_ns: int, warns: bool) -> None:
    """Ten packets a second of 92 bytes, at one tick of 20 or each at a tick of its own."""
    tally = AirTally(capacity(AIRTIME), 50 * MS)
    given = [{"tx": n % 2, "rx": 2, "seq": n, "fate": fate} for n in range(100)]
    at = [n // 10 * S + n % 10 * period_ns % S for n in range(100)]
    tally.add(rows(*(row | {"sim_time_ns": ns} for row, ns in zip(given, at, strict=True))))
    account = tally.account(10 * S)
    assert account.share == account.busiest_share < 1.0
    assert account.ticks_share == pytest.approx(account.share * (20 if period_ns == S else 0))
    assert any("transmitted at the same ticks" in line for line in account.warnings) is warns


@pytest.mark.parametrize(("fate", "warns"), [("collided", True), ("half_duplex", True), ("delivered", False)])
def test_where_no_node_waits_too_much_shows_by_frames_that_overlap(fate: str, warns: bool) -> None:
    """Nothing waits on `airtime`, so that 4.6 times too much went untold."""
    account = account_of(
        rows(*({"tx": seq % 2, "rx": 2, "seq": seq, "fate": fate} for seq in range(200))),
        capacity(AIRTIME),
        S,
    )
    assert account.busiest_share > 1.0
    assert account.lost_overlapping == (200 if warns else 0)
    told = "no node waits for others there, and 200 receptions were lost as frames were on the air at once"
    assert (told in "".join(account.warnings)) is warns
    assert account.remark.startswith("medium airtime, offered" if warns else "medium airtime")
    waits = account_of(rows(*({"seq": seq, "fate": "collided"} for seq in range(200))), capacity(TDMA), S)
    assert (waits.lost_overlapping, waits.warnings) == (0, [])


@pytest.mark.parametrize(
    ("fate", "on_air_s", "radio", "warns"),
    [
        ("queue_full", 1.35, CSMA, True),
        ("queue_full", 0.99, CSMA, False),
        ("delivered", 1.35, CSMA, False),
        ("run_ended", 1.35, CSMA, False),
        ("queue_full", 1.35, CSMA.replace("{}", "{'2': 5}"), False),
    ],
)
def test_hops_that_fill_the_air_are_warned_of_if_it_shows(
    fate: str, on_air_s: float, radio: str, warns: bool
) -> None:
    """A few packets, which others hand on: what was offered was far below what the medium carries."""
    account = account_of(rows({}, {"seq": 1, "fate": fate}), capacity(radio), S, round(on_air_s * S))
    assert account.is_routed
    assert account.busiest_share < 0.2
    assert account.warnings == (
        [
            "nodes hand packets on (routing), and frames of all hops were on the air of the medium csma for 1.35 times "
            "as long as the run lasted: 1 receptions were lost for want of time on the air"
        ]
        if warns
        else []
    )
    told = ", frames of all hops on the air for 1.35 times the run" if warns else ""
    assert account.remark == f"medium csma{told}"
    assert not account_of(rows({}), capacity(radio), S).is_routed


def test_packets_that_are_too_long_are_warned_of_with_what_to_do() -> None:
    """The radio takes 200 bytes; 100 bytes and 8 of header have no room in a slot of another's."""
    given = rows(
        *({"rx": rx, "seq": seq, "fate": "too_long", "length_bytes": 300} for seq in (0, 1) for rx in (1, 2)),
        *({"tx": 1, "rx": 0, "seq": seq} for seq in range(3)),
        {"tx": 1, "rx": 0, "seq": 3, "fate": "too_long_for_a_slot", "length_bytes": 108},
        {"tx": 1, "rx": 2, "seq": 4, "packets": 9, "fate": "transport"},
    )
    account = account_of(given, capacity(TDMA.replace("{", "{mtu_bytes: 200, ", 1)), S)
    assert account.warnings == [
        "node 0: all 2 packets that it transmitted were longer than the 200 bytes that its radio takes (mtu_bytes), "
        "and were lost (too_long; the longest has 300 bytes): transmit less in a packet, or raise mtu_bytes",
        "node 1: 1 of 4 packets that it transmitted fit into no slot that it has, and were lost (too_long_for_a_slot; "
        "the longest has 100 bytes): transmit less in a packet, or give it a slot with the room",
    ]
    assert account.remark == "medium tdma, 3 of 6 packets of 2 nodes too long"
    json.dumps(account.plain)


def test_of_many_nodes_with_packets_too_long_five_are_named() -> None:
    found = [TooLong(f"ua-{number}", 10, 20, 2000, 1472) for number in range(500)]
    *named, rest = warnings_of(found, "csma")
    assert [text[:9] for text in named] == [f"node ua-{number}" for number in range(5)]
    assert rest == "so were packets of 495 more nodes (air[].too_long of the summary has them all)"
    assert remark_of(found) == "5000 of 10000 packets of 500 nodes too long"
    assert remark_of(found[:1]) == "10 of 20 packets of node ua-0 too long"


def test_a_network_without_packets_has_an_account() -> None:
    account = account_of(rows({"fate": "transport", "packets": 3}), capacity(TDMA), S)
    assert (account.packets, account.offered_bps, account.capacity_bps, account.warnings) == (
        0,
        0.0,
        None,
        [],
    )
    assert (account.wait_p50_s, account.use_share) == (None, 0.0)


@pytest.mark.parametrize(
    ("bits_per_s", "text"),
    [(10.94e6, "10.9 Mbit/s"), (64e3, "64 kbit/s"), (12.0, "12 bit/s"), (2e9, "2 Gbit/s")],
)
def test_bit_rates_in_words(bits_per_s: float, text: str) -> None:
    assert rate_text(bits_per_s) == text


def test_a_node_without_a_slot_takes_none_of_the_time() -> None:
    of_two = capacity('{preset: telemetry-915, medium: {model: tdma, slot_s: 0.05, slots: ["0", "1"]}}')
    assert of_two.packet_s("0", 100) > 0.0
    assert of_two.packet_s("2", 100) == 0.0


@pytest.mark.parametrize("radio", [IDEAL, TDMA, CSMA, SIK, AIRTIME])
@pytest.mark.parametrize("size", [1, 7, 100])
def test_an_account_of_rows_that_come_some_at_a_time_is_that_of_all(
    tmp_path: Path, radio: str, size: int
) -> None:
    def send(number: int) -> list[Sent]:
        lost = 3 if number == 5 else 0
        lengths = (40, 120, 5000 if number % 9 == 0 else 60)
        return [Sent(node, length=length, lost=lost) for node in NODES for length in lengths]

    scenario = scenario_of(radio, NODES)
    run = flown(tmp_path / "run", scenario, 40, send, scale=0.1)
    given = link_rows(run, NODES, NEEDED)
    tally = AirTally(capacity(radio))
    for begin in range(0, len(given), size):
        tally.add(given.at(slice(begin, begin + size)))
    account = account_of(given, capacity(radio), 2 * S)
    assert tally.account(2 * S) == account
    assert account.packets > 200
    assert account.received_most_bps > 0.0
    assert account.takes_time == (account.wait_p95_s is not None)
