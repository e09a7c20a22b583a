"""Digests tell runs apart, and nothing else does: they are those of the files."""

from __future__ import annotations

import hashlib
from pathlib import Path

from bridge.record.digests import digest_line, digests
from bridge.record.names import RECORD_FILE, packets, truth
from bridge.record.streams import StreamWriter


def run_at(path: Path, payload: bytes = b"x") -> Path:
    for stream in (truth("0"), packets("0")):
        with StreamWriter(stream.path(path)) as writer:
            writer.write(1, payload)
    (path / RECORD_FILE).write_text("sim_time_ns\n1\n")
    return path


def test_one_digest_per_stream_and_one_of_the_record(tmp_path: Path) -> None:
    run = run_at(tmp_path)
    found = digests(run)
    assert sorted(found) == ["packets/0", "record", "truth/0"]
    assert found["record"] == hashlib.sha256(b"sim_time_ns\n1\n").hexdigest()
    assert found["truth/0"] == hashlib.sha256(truth("0").path(run).read_bytes()).hexdigest()


def test_equal_runs_have_equal_lines_and_others_do_not(tmp_path: Path) -> None:
    one, same, other = (digests(run_at(tmp_path / n, p)) for n, p in (("a", b"x"), ("b", b"x"), ("c", b"y")))
    assert digest_line(one) == digest_line(dict(reversed(same.items())))
    assert digest_line(one) != digest_line(other)
    assert digest_line(one) != digest_line({k: v for k, v in one.items() if k != "packets/0"})


def test_what_is_not_there_is_left_out(tmp_path: Path) -> None:
    assert digests(tmp_path) == {}
