"""The first difference between two runs is found, whatever it is, and said in terms that a person knows."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bridge.record.ending import Extent, extent_of, last_whole_tick
from bridge.record.events import KILLED, Report
from bridge.record.names import from_autopilot, packets, to_autopilot
from bridge.record.packets import SentPacket, encode_packet
from bridge.record.streams import Entry, StreamError
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.schema import TableError
from bridge.record.tables.truth import TRUTH
from lostlink.compare.compare import NotARun, compare, examine
from lostlink.compare.difference import Difference, seconds
from tests.unit.bridge.record.runs import (
    TICK_NS,
    Change,
    Encoder,
    RunContent,
    Vector3,
    heartbeat,
    make_run,
    mavlink,
    replace,
    row_at,
)

AT_3 = 3 * TICK_NS


def difference(tmp_path: Path, change: Change, until_ns: int | None = None) -> Difference:
    """Between a run and a changed one; the other way round it is the same with sides changed."""
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b", change)
    found, back = compare(a, b, until_ns), compare(b, a, until_ns)
    assert found is not None
    assert back == replace(found, a=found.b, b=found.a)
    return found


def test_same_runs_are_identical_and_it_is_told_what_was_compared(tmp_path: Path) -> None:
    result = examine(make_run(tmp_path / "a"), make_run(tmp_path / "b"))
    assert result.difference is None
    assert set(result.streams) == {
        *(f"packets/{n}" for n in "01"),
        *(f"mavlink/{n}/{way}_autopilot" for way in ("from", "to") for n in "01"),
        "truth",
        "deliveries",
    }
    assert result.ticks == 20
    assert result.entries == 2 * (20 + 20 + 4 + 20) + 40


def test_what_is_sent_between_ticks_makes_no_more_of_them(tmp_path: Path) -> None:
    def between(run: RunContent) -> None:
        run.streams[packets("2")] = [Entry(at_ns, b"unit") for at_ns in range(0, 5 * TICK_NS, TICK_NS // 50)]

    a, b = make_run(tmp_path / "a", between), make_run(tmp_path / "b", between)
    assert examine(a, b).ticks == 20
    for run in (a, b):
        TRUTH.parquet_path(run).unlink()
    assert examine(a, b).ticks == 250


def test_truth_is_told_by_column(tmp_path: Path) -> None:
    found = difference(
        tmp_path, lambda run: run.change_truth(7, position_ned_m=Vector3(1.15, math.nan, -10.0))
    )
    assert found == Difference(AT_3, "1", "truth", "position_east_m in row 7", "0.0", "nan")


def test_truth_differs_by_its_last_bit_and_by_the_sign_of_zero(tmp_path: Path) -> None:
    for name, value in (("bit", 8.500000000000002), ("sign", None)):
        change = (
            (lambda run: run.change_truth(7, airspeed_mps=-0.0))
            if value is None
            else (lambda run, value=value: run.change_truth(7, longitude_deg=value))
        )
        found = difference(tmp_path / name, change)
        assert (found.a, found.b) == (("0.0", "-0.0") if value is None else ("8.5", repr(value)))


def test_mavlink_message_is_told_by_its_fields(tmp_path: Path) -> None:
    def change(run: RunContent) -> None:
        encoder = Encoder(1, 1)
        for i in range(20):
            run.change(from_autopilot("0"), i, heartbeat(encoder, 4 if i < 3 else 9))

    found = difference(tmp_path, change)
    assert found == Difference(
        AT_3, "0", "mavlink/0/from_autopilot", "HEARTBEAT", "custom_mode = 4", "custom_mode = 9"
    )


def test_mavlink_message_that_one_side_lacks(tmp_path: Path) -> None:
    def change(run: RunContent) -> None:
        run.streams[to_autopilot("1")][1] = Entry(
            5 * TICK_NS,
            run.streams[to_autopilot("1")][1].payload
            + Encoder(2, 191).encode(mavlink.MAVLink_set_mode_message(1, 1, 4)),
        )

    found = difference(tmp_path, change)
    assert (found.tick_ns, found.what, found.a) == (5 * TICK_NS, "SET_MODE", "nothing")
    assert found.b.startswith("SET_MODE: seq = 0, sysid = 2, compid = 191, target_system = 1")


def test_another_mavlink_message_in_its_place(tmp_path: Path) -> None:
    other = Encoder(1, 1).encode(mavlink.MAVLink_statustext_message(3, b"hi"))
    found = difference(tmp_path, lambda run: run.change(from_autopilot("0"), 3, other))
    assert found.what == "message"
    assert found.a.startswith("HEARTBEAT: seq = 3")
    assert found.b.startswith("STATUSTEXT: seq = 0, sysid = 1, compid = 1, severity = 3, text = 'hi'")


def test_frame_that_began_a_tick_before_is_decoded(tmp_path: Path) -> None:
    def cut(run: RunContent, mode: int = 4) -> None:
        frames = [heartbeat(Encoder(1, 1), 4), heartbeat(Encoder(1, 1), mode)]
        run.streams[from_autopilot("0")] = [Entry(0, frames[0] + frames[1][:10]), Entry(50, frames[1][10:])]

    a, b = make_run(tmp_path / "a", cut), make_run(tmp_path / "b", lambda run: cut(run, 7))
    found = compare(a, b)
    assert found is not None
    assert (found.tick_ns, found.what, found.a, found.b) == (
        50,
        "HEARTBEAT",
        "custom_mode = 4",
        "custom_mode = 7",
    )


def test_mavlink_bytes_that_are_no_frame_are_told_in_hex(tmp_path: Path) -> None:
    def change(run: RunContent) -> None:
        entry = run.streams[from_autopilot("0")][3]
        run.change(from_autopilot("0"), 3, entry.payload + b"\xfd\x09")

    found = difference(tmp_path, change)
    assert (found.what, found.a, found.b) == ("byte 21", "nothing (21 bytes)", "fd 09")


def test_same_mavlink_bytes_in_other_pieces_are_said_to_be_that(tmp_path: Path) -> None:
    def change(run: RunContent) -> None:
        entries = run.streams[from_autopilot("0")]
        tick_ns, payload = entries[3]
        entries[3:4] = [Entry(tick_ns, payload[:5]), Entry(tick_ns, payload[5:])]

    found = difference(tmp_path, change)
    assert (found.what, found.a, found.b) == ("the entries", "the same bytes, in 1", "the same bytes, in 2")


@pytest.mark.parametrize(
    ("packet", "what", "a", "b"),
    [
        (SentPacket(4, AT_3, "team", b"payload"), "seq", "3", "4"),
        (SentPacket(3, AT_3, "crew", b"payload"), "address", "team", "crew"),
        (SentPacket(3, AT_3, "team", b"payload", "text/plain"), "encoding", "", "text/plain"),
        (SentPacket(3, AT_3 + 1, "team", b"payload"), "sim_time_ns", "150000000", "150000001"),
        (
            SentPacket(3, AT_3, "team", b"paxload"),
            "packet 3 on channel team, byte 2",
            "79 6c 6f 61 64",
            "78 6c 6f 61 64",
        ),
        (
            SentPacket(3, AT_3, "team", b"pay"),
            "packet 3 on channel team, byte 3",
            "6c 6f 61 64 (of 7 bytes)",
            "nothing (3 bytes) (of 3 bytes)",
        ),
    ],
)
def test_packet_is_told_by_what_differs(
    tmp_path: Path, packet: SentPacket, what: str, a: str, b: str
) -> None:
    found = difference(tmp_path, lambda run: run.change(packets("0"), 3, encode_packet(packet)))
    assert found == Difference(AT_3, "0", "packets/0", what, a, b)


def test_delivery_is_told_by_column(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.change_row(7, fate="out_of_range"))
    assert found == Difference(AT_3, "1", "deliveries", "fate in row 7", "delivered", "out_of_range")
    found = difference(tmp_path / "b", lambda run: run.change_row(7, per=math.nan))
    assert (found.what, found.a, found.b) == ("per in row 7", "0.01", "nan")


def test_another_packet_is_told_by_its_row(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.change_row(7, seq=9))
    row = "sim_time_ns 150000000, tx 1, rx 0, seq {}, packets 1, length_bytes 40, distance_m 100.0, "
    row += "received_power_dbm -70.0, snr_db 20.0, per 0.01, fate delivered, radio main, channel team, "
    row += (
        "encoding , received_ns 200000000, entered_ns 150000000, started_ns 150000000, ended_ns 150000000, "
    )
    row += "arrived_ns 150000000, attempts 1"
    assert found == Difference(AT_3, "1", "deliveries", "row 7", row.format(3), row.format(9))


def test_row_that_one_side_lacks(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.truths.pop(7))
    assert (found.tick_ns, found.node, found.what) == (AT_3, "1", "row 7")
    assert found.a.startswith("tick_ns 150000000, node 1, ")
    assert found.b.startswith("tick_ns 200000000, node 0, ")


def test_table_that_ends_early(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.rows.pop())
    assert (found.tick_ns, found.what, found.b) == (19 * TICK_NS, "row 39", "nothing: the table ends")


def test_difference_far_into_long_tables_is_found(tmp_path: Path) -> None:
    ticks = 40_000  # more than one part of what is read at once
    rows = [row_at(i * TICK_NS, tx, rx) for i in range(ticks) for tx, rx in (("0", "1"), ("1", "0"))]

    def write(run: RunContent, at: int | None) -> None:
        run.streams.clear()
        run.rows = list(rows)
        if at is not None:
            run.change_row(at, snr_db=19.999)

    a = make_run(tmp_path / "a", lambda run: write(run, None), ticks=1)
    for at in (65_535, 65_536, 79_999):
        b = make_run(tmp_path / str(at), lambda run, at=at: write(run, at), ticks=1)
        found = compare(a, b)
        assert found is not None
        assert (found.what, found.a, found.b) == (f"snr_db in row {at}", "20.0", "19.999")
        later = compare(a, b, (at // 2 - 1) * TICK_NS)
        assert later is None


def test_entry_that_one_side_lacks_names_the_next(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.streams[packets("1")].pop(3))
    assert (found.tick_ns, found.what) == (AT_3, "the entry")
    assert found.a == "packet 3 on channel team, 7 bytes"
    assert found.b == "nothing: its next entry is at 0.20 s"


def test_stream_that_ends_early_has_its_own_words(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.streams[packets("0")].pop())
    assert (found.tick_ns, found.what) == (19 * TICK_NS, "the stream")
    assert found.b == "nothing: the stream ends with 0.90 s"


def test_stream_that_one_side_lacks_has_its_own_words(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.streams.pop(packets("0")))
    assert found == Difference(
        0, "0", "packets/0", "the stream", "a stream that begins at 0.00 s", "no such stream"
    )


def test_missing_table_is_a_difference(tmp_path: Path) -> None:
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b")
    DELIVERIES.parquet_path(b).unlink()
    assert compare(a, b) == Difference(0, "", "deliveries", "the table", "the table", "no deliveries")


def test_earliest_tick_comes_first_whatever_the_stream(tmp_path: Path) -> None:
    def change(run: RunContent) -> None:
        run.change_truth(16, airspeed_mps=1.0)
        run.change(packets("1"), 6, b"x")
        run.change(from_autopilot("1"), 7, b"x")
        run.change_row(15, fate="burst")

    assert difference(tmp_path, change).stream == "packets/1"


def test_within_a_tick_the_cause_comes_first(tmp_path: Path) -> None:
    changes = [
        lambda run: run.change_row(10, fate="burst"),
        lambda run: run.change(packets("0"), 5, b"x"),
        lambda run: run.change(to_autopilot("0"), 1, b"x"),
        lambda run: run.change(from_autopilot("1"), 5, b"x"),
        lambda run: run.change(from_autopilot("0"), 5, b"x"),
        lambda run: run.change_truth(11, airspeed_mps=1.0),
    ]
    order = ["deliveries", "packets/0", "mavlink/0/to_autopilot", "mavlink/1/from_autopilot"]
    order += ["mavlink/0/from_autopilot", "truth"]
    for count, name in enumerate(order, 1):

        def change(run: RunContent, count: int = count) -> None:
            for one in changes[:count]:
                one(run)

        assert difference(tmp_path / str(count), change).stream == name


def test_nothing_after_until_counts(tmp_path: Path) -> None:
    until_ns = 9 * TICK_NS
    a = make_run(tmp_path / "a", ticks=10)

    def change(run: RunContent) -> None:
        run.change_truth(20, airspeed_mps=1.0)
        run.streams[packets("2")] = [Entry(10 * TICK_NS, b"late")]

    longer = make_run(tmp_path / "b", change)
    assert compare(a, longer, until_ns) is None
    assert compare(longer, a, until_ns) is None
    assert compare(a, longer) is not None
    changed = make_run(tmp_path / "c", lambda run: run.change_truth(18, airspeed_mps=1.0))
    found = compare(a, changed, until_ns)
    assert found is not None
    assert found.tick_ns == until_ns


def test_packets_on_their_way_when_a_run_ended_are_no_difference_up_to_there(tmp_path: Path) -> None:
    """One run ended at tick 9, the other was interrupted after it: a packet of tick 9 has come there at tick 12."""
    until_ns = 9 * TICK_NS
    ended = make_run(tmp_path / "a", lambda run: run.change_row(18, fate="run_ended"), ticks=10)
    went_on = make_run(tmp_path / "b", lambda run: run.change_row(18, received_ns=12 * TICK_NS), ticks=11)
    assert compare(ended, went_on, until_ns) is None
    assert compare(went_on, ended, until_ns) is None
    other = make_run(tmp_path / "c", lambda run: run.change_row(17, fate="channel_erasure"), ticks=11)
    found = compare(ended, other, until_ns)
    assert found is not None
    assert found.tick_ns == 8 * TICK_NS


def test_what_came_at_once_when_a_run_ended_says_not_how_far_its_packets_came(tmp_path: Path) -> None:
    """At the end a packet of tick 10 came on one network, while one of tick 9 was on its way on another."""

    def end(run: RunContent) -> None:
        run.change_row(18, fate="run_ended")
        run.rows.append(row_at(10 * TICK_NS, "0", "1"))

    ended = make_run(tmp_path / "a", end, ticks=10)
    went_on = make_run(tmp_path / "b", lambda run: run.change_row(18, received_ns=11 * TICK_NS), ticks=12)
    assert compare(ended, went_on, 9 * TICK_NS) is None
    assert compare(went_on, ended, 9 * TICK_NS) is None


def test_killed_run_is_compared_as_far_as_its_files_go(tmp_path: Path) -> None:
    a, b = make_run(tmp_path / "a", is_finished=False), make_run(tmp_path / "b")
    assert compare(a, b) is None
    files = [TRUTH.journal_path(a), packets("1").path(a), DELIVERIES.journal_path(a)]
    for file, size in zip(files, (3000, 110, 2000), strict=True):
        file.write_bytes(file.read_bytes()[:size])
    from_autopilot("1").path(a).unlink()
    assert examine(a, b, 18 * TICK_NS, a_was_cut=True).difference is None
    assert examine(a, b, 18 * TICK_NS).difference is not None
    c = make_run(tmp_path / "c", lambda run: run.change(packets("1"), 1, b"x"))
    assert examine(a, c, 18 * TICK_NS, a_was_cut=True).difference is not None


def test_what_cannot_be_read_is_told(tmp_path: Path) -> None:
    a = make_run(tmp_path / "a")
    with pytest.raises(NotARun, match="no such directory"):
        compare(a, tmp_path / "b")
    (tmp_path / "b").mkdir()
    with pytest.raises(NotARun, match="neither deliveries"):
        compare(tmp_path / "b", a)
    b = make_run(tmp_path / "c")
    packets("1").path(b).write_bytes(b"garbage that is long enough")
    with pytest.raises(StreamError, match=r"1\.bin: offset 0"):
        compare(a, b)
    c = make_run(tmp_path / "d")
    TRUTH.parquet_path(c).write_bytes(b"garbage that is long enough")
    with pytest.raises(TableError, match=r"truth\.parquet: damaged"):
        compare(a, c)


def test_progress_is_told(tmp_path: Path) -> None:
    told: list[tuple[str, int]] = []
    a, b = make_run(tmp_path / "a", ticks=600), make_run(tmp_path / "b", ticks=600)
    examine(a, b, on_progress=lambda name, entries: told.append((name, entries)))
    assert told == [
        ("truth", 1200),
        ("mavlink/1/from_autopilot", 2000),
        ("packets/0", 3000),
        ("deliveries", 5040),
    ]


def test_extent_of_a_run(tmp_path: Path) -> None:
    run = make_run(tmp_path / "a", lambda run: run.truths.pop())
    assert last_whole_tick(run) == 18 * TICK_NS
    for summary, extent in (
        ('{"ending": "done"}', Extent(None, False, "done")),
        ('{"ending": "duration"}', Extent(None, False, "duration")),
        ('{"ending": "interrupted"}', Extent(18 * TICK_NS, False, "interrupted")),
        ('{"ending": "failed"}', Extent(18 * TICK_NS, True, "failed")),
        ("not JSON", Extent(18 * TICK_NS, True)),
        ("[]", Extent(18 * TICK_NS, True)),
    ):
        (run / "summary.json").write_text(summary)
        assert extent_of(run) == extent
    report = Report(run, "supervisor")
    report.event(9, "", KILLED, "host-0 did not end in time and was killed")
    report.close()
    for ending, stop_ns in (("done", None), ("duration", None), ("interrupted", 18 * TICK_NS)):
        (run / "summary.json").write_text(f'{{"ending": "{ending}"}}')
        assert extent_of(run) == Extent(stop_ns, True, ending)
    with pytest.raises(ValueError, match="before its first whole tick"):
        extent_of(make_run(tmp_path / "b", ticks=1))
    with pytest.raises(ValueError, match="in its first ticks, before sim time passed: nothing to fly again"):
        extent_of(make_run(tmp_path / "c", ticks=2))
    assert extent_of(make_run(tmp_path / "d", ticks=3)).stop_ns == TICK_NS


@pytest.mark.parametrize(
    ("tick_ns", "text"), [(0, "0.00 s"), (12_350_000_000, "12.35 s"), (1, "0.000000001 s"), (10**9, "1.00 s")]
)
def test_sim_time_is_exact_in_seconds(tick_ns: int, text: str) -> None:
    assert seconds(tick_ns) == text
