import pytest

from aps.links.outbox import Outbox


class Transport:
    def __init__(self):
        self.written = []

    def set_write_buffer_limits(self, high):
        self.high = high

    def get_extra_info(self, name):
        return None

    def write(self, data):
        self.written.append(data)


def test_outbox_joins_frames_into_one_write():
    outbox, transport = Outbox(), Transport()
    outbox.open(transport)
    for frame in (b"one", b"two"):
        outbox.put(frame)
    assert transport.written == []
    outbox.flush()
    assert transport.written == [b"onetwo"]
    assert (outbox.counters.written_frames, outbox.counters.written_bytes) == (2, 6)


def test_full_outbox_drops_the_oldest_and_counts_them():
    outbox, transport = Outbox(1024), Transport()
    outbox.open(transport)
    outbox.pause()
    frames = [bytes([number]) * 100 for number in range(30)]
    for frame in frames:
        outbox.put(frame)
        outbox.flush()
    assert transport.written == []
    outbox.resume()
    assert transport.written == [b"".join(frames[-10:])]
    counters = outbox.counters
    assert (counters.queued_frames, counters.written_frames, counters.dropped_full) == (30, 10, 20)


def test_closed_outbox_counts_what_it_cannot_send():
    outbox = Outbox()
    outbox.put(b"nobody there")
    outbox.open(Transport())
    outbox.put(b"waiting")
    outbox.close()
    outbox.flush()
    assert (outbox.counters.dropped_closed, len(outbox.waiting)) == (2, 0)


def test_outbox_limit_is_checked():
    with pytest.raises(ValueError, match="at least 1024 bytes, not 10"):
        Outbox(10)
