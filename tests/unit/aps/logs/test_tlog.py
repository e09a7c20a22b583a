import resource

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.logs.tlog import TlogWriter

START_US = 1_700_000_000_000_000


def attitudes(count):
    mav = mavlink.MAVLink(None, srcSystem=5, srcComponent=1)
    for number in range(count):
        mav.seq = number % 256
        yield bytes(mavlink.MAVLink_attitude_message(number, 0.5, 0, 0, 0, 0, 0).pack(mav))


class Clock:
    def __init__(self):
        self.now_us = START_US

    def __call__(self):
        self.now_us += 100_000
        return self.now_us


def test_pymavlink_reads_what_was_written_without_its_being_closed(tmp_path):
    writer = TlogWriter(tmp_path / "logs", "ua-5", Clock())
    for raw in attitudes(30):
        writer.write(raw)
    (path,) = writer.paths
    assert path.name == "ua-5-20231114T221320Z.tlog"
    log = mavutil.mavlink_connection(str(path))
    read = [log.recv_msg() for _ in range(30)]
    assert [message.time_boot_ms for message in read] == list(range(30))
    assert read[0]._timestamp == pytest.approx(START_US / 1e6 + 0.1)
    assert read[29]._timestamp == pytest.approx(START_US / 1e6 + 3.0)
    assert log.recv_msg() is None
    log.close()
    writer.close()


def test_files_are_bounded_in_size_and_number(tmp_path):
    writer = TlogWriter(tmp_path, "x", lambda: START_US, max_file_bytes=1000, max_files=3)
    for raw in attitudes(200):
        writer.write(raw)
    writer.close()
    assert sorted(tmp_path.iterdir()) == sorted(writer.paths)
    assert len(writer.paths) == 3
    assert all(900 < path.stat().st_size <= 1000 for path in writer.paths[:2])
    counters = writer.counters
    assert (counters.frames, counters.deleted_files) == (200, counters.files - 3)


def test_a_disk_that_refuses_is_counted_and_tried_again(tmp_path, caplog):
    directory = tmp_path / "logs"
    writer = TlogWriter(directory, "x", Clock())
    directory.rmdir()
    first, second, third = attitudes(3)
    writer.write(first)
    writer.write(second)
    directory.mkdir()
    writer.write(third)
    writer.close()
    assert (writer.counters.lost_frames, writer.counters.frames) == (2, 1)
    assert caplog.text.count("cannot write the tlog") == 1


def test_a_disk_that_takes_a_part_of_a_record_has_nothing_of_it(tmp_path):
    writer = TlogWriter(tmp_path, "x", Clock())
    frames = list(attitudes(6))
    for raw in frames[:2]:
        writer.write(raw)
    (path,) = writer.paths
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 20, hard))
    try:
        for raw in frames[2:4]:
            writer.write(raw)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    for raw in frames[4:]:
        writer.write(raw)
    writer.close()
    assert (writer.counters.lost_frames, writer.counters.frames) == (2, 4)
    log = mavutil.mavlink_connection(str(path))
    assert [log.recv_msg().time_boot_ms for _ in range(4)] == [0, 1, 4, 5]
    assert log.recv_msg() is None
    log.close()


def test_limits_are_checked(tmp_path):
    with pytest.raises(ValueError, match="at least one file of 1000 bytes, not 1 of 10"):
        TlogWriter(tmp_path, "x", Clock(), max_file_bytes=10, max_files=1)


def test_gathered_frames_are_written_together_whole_and_in_order(tmp_path):
    frames = list(attitudes(100))
    at_once = TlogWriter(tmp_path / "a", "x", Clock(), max_file_bytes=1000)
    gathering = TlogWriter(tmp_path / "b", "x", Clock(), max_file_bytes=1000, gather_bytes=100)
    for raw in frames:
        at_once.write(raw)
        gathering.write(raw)
    (*full, latest) = gathering.paths
    assert len(full) > 1
    assert latest.stat().st_size < at_once.paths[-1].stat().st_size, "some wait"
    gathering.flush()
    assert [path.name for path in gathering.paths] == [path.name for path in at_once.paths]
    assert [path.read_bytes() for path in gathering.paths] == [path.read_bytes() for path in at_once.paths]
    assert gathering.counters == at_once.counters
    at_once.close()
    gathering.close()


def test_a_disk_that_refuses_gathered_frames_has_none_of_them(tmp_path):
    directory = tmp_path / "logs"
    writer = TlogWriter(directory, "x", Clock(), gather_bytes=1000)
    directory.rmdir()
    first, second, third = attitudes(3)
    writer.write(first)
    writer.write(second)
    writer.flush()
    directory.mkdir()
    writer.write(third)
    writer.close()
    assert (writer.counters.lost_frames, writer.counters.frames) == (2, 1)
