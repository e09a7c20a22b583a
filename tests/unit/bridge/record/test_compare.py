"""The first difference between two runs is found, whatever it is, and said in terms that a person knows."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bridge.bus.messages import encode
from bridge.record.compare import NotARun, compare, examine
from bridge.record.difference import Difference, seconds
from bridge.record.ending import Extent, extent_of, last_whole_tick
from bridge.record.events import KILLED, Report
from bridge.record.names import RECORD_FILE, from_autopilot, packets, to_autopilot, truth
from bridge.record.packets import SentPacket, encode_packet
from bridge.record.streams import Entry, StreamError
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
    truth_at,
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
        *(f"{kind}/{n}" for kind in ("truth", "packets") for n in "01"),
        *(f"mavlink/{n}/{way}_autopilot" for way in ("from", "to") for n in "01"),
        "record",
    }
    assert result.ticks == 20
    assert result.entries == 2 * (20 + 20 + 4 + 20) + 41


def test_truth_is_told_by_field(tmp_path: Path) -> None:
    other = replace(truth_at("1", AT_3), position_ned_m=Vector3(1.15, math.nan, -10.0))
    found = difference(tmp_path, lambda run: run.change(truth("1"), 3, encode(other)))
    assert found == Difference(AT_3, "1", "truth/1", "position_ned_m.y", "0.0", "nan")


def test_truth_that_cannot_be_decoded_is_told_by_byte(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.change(truth("1"), 3, b"\0\1"))
    assert (found.what, found.b) == ("byte 2", "nothing (2 bytes)")


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
        (SentPacket(3, AT_3, "crew", b"payload"), "channel", "team", "crew"),
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


def test_record_is_told_by_its_line(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.change_row(7, fate="out_of_range"))
    line = "150000000,1,0,3,40,100.000,-70.000,20.000,0.01"
    assert found == Difference(AT_3, "1", "record", "line 9", f"{line},delivered", f"{line},out_of_range")


def test_record_that_ends_early(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.rows.pop())
    assert (found.tick_ns, found.what, found.b) == (19 * TICK_NS, "line 41", "nothing: the record ends")


def test_entry_that_one_side_lacks_names_the_next(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.streams[packets("1")].pop(3))
    assert (found.tick_ns, found.what) == (AT_3, "the entry")
    assert found.a == "packet 3 on channel team, 7 bytes"
    assert found.b == "nothing: its next entry is at 0.20 s"


def test_stream_that_ends_early_has_its_own_words(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.streams[truth("0")].pop())
    assert (found.tick_ns, found.what) == (19 * TICK_NS, "the stream")
    assert found.b == "nothing: the stream ends with 0.90 s"


def test_stream_that_one_side_lacks_has_its_own_words(tmp_path: Path) -> None:
    found = difference(tmp_path, lambda run: run.streams.pop(truth("0")))
    assert found == Difference(
        0, "0", "truth/0", "the stream", "a stream that begins at 0.00 s", "no such stream"
    )


def test_missing_record_is_a_difference(tmp_path: Path) -> None:
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b")
    (b / RECORD_FILE).unlink()
    assert compare(a, b) == Difference(0, "", "record", "the stream", "the record", "no deliveries.csv")


def test_earliest_tick_comes_first_whatever_the_stream(tmp_path: Path) -> None:
    def change(run: RunContent) -> None:
        run.change(truth("0"), 8, b"x")
        run.change(packets("1"), 6, b"x")
        run.change(from_autopilot("1"), 7, b"x")
        run.change_row(15, fate="x")

    assert difference(tmp_path, change).stream == "packets/1"


def test_within_a_tick_the_cause_comes_first(tmp_path: Path) -> None:
    changes = [
        lambda run: run.change_row(10, fate="x"),
        lambda run: run.change(packets("0"), 5, b"x"),
        lambda run: run.change(to_autopilot("0"), 1, b"x"),
        lambda run: run.change(from_autopilot("1"), 5, b"x"),
        lambda run: run.change(from_autopilot("0"), 5, b"x"),
        lambda run: run.change(truth("1"), 5, b"x"),
    ]
    order = ["record", "packets/0", "mavlink/0/to_autopilot", "mavlink/1/from_autopilot"]
    order += ["mavlink/0/from_autopilot", "truth/1"]
    for count, name in enumerate(order, 1):

        def change(run: RunContent, count: int = count) -> None:
            for one in changes[:count]:
                one(run)

        assert difference(tmp_path / str(count), change).stream == name


def test_nothing_after_until_counts(tmp_path: Path) -> None:
    until_ns = 9 * TICK_NS
    a = make_run(tmp_path / "a", ticks=10)

    def change(run: RunContent) -> None:
        run.change(truth("0"), 10, b"x")
        run.streams[packets("2")] = [Entry(10 * TICK_NS, b"late")]

    longer = make_run(tmp_path / "b", change)
    assert compare(a, longer, until_ns) is None
    assert compare(longer, a, until_ns) is None
    assert compare(a, longer) is not None
    changed = make_run(tmp_path / "c", lambda run: run.change(truth("0"), 9, b"x"))
    found = compare(a, changed, until_ns)
    assert found is not None
    assert found.tick_ns == until_ns


def test_killed_run_is_compared_as_far_as_its_files_go(tmp_path: Path) -> None:
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b")
    for file, size in ((truth("0").path(a), 3000), (packets("1").path(a), 100), (a / RECORD_FILE, 333)):
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
    truth("1").path(b).write_bytes(b"garbage that is long enough")
    with pytest.raises(StreamError, match=r"1\.bin: offset 0"):
        compare(a, b)


def test_progress_is_told(tmp_path: Path) -> None:
    told: list[tuple[str, int]] = []
    a, b = make_run(tmp_path / "a", ticks=600), make_run(tmp_path / "b", ticks=600)
    examine(a, b, on_progress=lambda name, entries: told.append((name, entries)))
    assert told[0] == ("truth/1", 1000)
    assert len(told) == (2 * (600 * 3 + 120) + 1201) // 1000


def test_extent_of_a_run(tmp_path: Path) -> None:
    run = make_run(tmp_path / "a", lambda run: run.streams[truth("1")].pop())
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
