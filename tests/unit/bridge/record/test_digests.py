"""Digests tell runs apart, and nothing else does: they are those of the files."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from bridge.record.digests import digest_line, digest_now, digests, file_digest
from bridge.record.names import packets
from bridge.record.pack import pack_streams
from bridge.record.streams import StreamWriter
from tests.unit.bridge.record.runs import make_run


def run_at(path: Path, payload: bytes = b"x") -> Path:
    with StreamWriter(packets("0").path(path)) as writer:
        writer.write(1, payload)
    (path / "deliveries.parquet").write_bytes(b"rows")
    return path


def test_one_digest_per_stream_and_table(tmp_path: Path) -> None:
    run = run_at(tmp_path)
    found = digests(run)
    assert sorted(found) == ["deliveries", "packets/0"]
    assert found["deliveries"] == hashlib.sha256(b"rows").hexdigest()
    assert found["packets/0"] == hashlib.sha256(packets("0").path(run).read_bytes()).hexdigest()
    pack_streams(run)
    assert [path.name for path in (run / "streams" / "packets").iterdir()] == ["0.bin.zst"]
    assert digests(run) == found


def test_tables_of_equal_runs_have_equal_digests_and_others_do_not(tmp_path: Path) -> None:
    one, same = (digests(make_run(tmp_path / name)) for name in "ab")
    other = digests(make_run(tmp_path / "c", lambda run: run.change_truth(3, airspeed_mps=1e-9)))
    assert one == same
    assert {name for name in one if one[name] != other[name]} == {"truth"}


def test_equal_runs_have_equal_lines_and_others_do_not(tmp_path: Path) -> None:
    one, same, other = (digests(run_at(tmp_path / n, p)) for n, p in (("a", b"x"), ("b", b"x"), ("c", b"y")))
    assert digest_line(one) == digest_line(dict(reversed(same.items())))
    assert digest_line(one) != digest_line(other)
    assert digest_line(one) != digest_line({k: v for k, v in one.items() if k != "packets/0"})


def test_what_is_not_there_is_left_out(tmp_path: Path) -> None:
    assert digests(tmp_path) == {}


def test_a_file_is_looked_into_again_once_it_was_changed(tmp_path: Path) -> None:
    """Also where it has the length, and says that it has the age, that it had."""
    file = tmp_path / "laws.py"
    file.write_bytes(b"GAIN = 2")
    about = file.stat()
    assert digest_now(file) == file_digest(file)
    file.write_bytes(b"GAIN = 3")
    os.utime(file, ns=(about.st_atime_ns, about.st_mtime_ns))
    while file.stat().st_ctime_ns == about.st_ctime_ns:  # clocks of file systems are coarse
        os.utime(file, ns=(about.st_atime_ns, about.st_mtime_ns))
    assert digest_now(file) == file_digest(file)
