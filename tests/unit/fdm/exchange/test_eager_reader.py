"""The eager reader: looks without waiting first, less and less often while that is in vain."""

import socket

from fdm.exchange import eager_reader
from fdm.exchange.eager_reader import LOOKS, EagerReader, reader_of


class Socket:
    """Has a datagram after so many looks; counts the calls."""

    def __init__(self):
        self.looks_until_ready = 0
        self.looks = self.waits = 0

    def recvfrom(self, _size, flags):
        if not flags & socket.MSG_DONTWAIT:
            self.waits += 1
        elif self.looks_until_ready > 0:
            self.looks += 1
            self.looks_until_ready -= 1
            raise BlockingIOError
        return b"datagram", ("127.0.0.1", 1)


def test_what_comes_soon_is_read_without_waiting():
    sock = Socket()
    read = EagerReader(sock.recvfrom)
    for _ in range(3):
        sock.looks_until_ready = LOOKS - 1
        assert read(128, 0) == (b"datagram", ("127.0.0.1", 1))
    assert (sock.looks, sock.waits) == (3 * (LOOKS - 1), 0)


def test_looks_in_vain_grow_fewer_until_one_is_not():
    sock = Socket()
    read = EagerReader(sock.recvfrom)
    looks = []
    for _ in range(7):
        sock.looks, sock.looks_until_ready = 0, 10**6
        read(128, 0)
        looks.append(sock.looks)
    assert looks == [50, 25, 12, 6, 3, 1, 1]
    assert sock.waits == 7
    sock.looks_until_ready = 0
    read(128, 0)
    sock.looks, sock.looks_until_ready = 0, 10**6
    read(128, 0)
    assert sock.looks == LOOKS


def test_there_is_none_where_nothing_is_due_or_there_is_no_core_to_spare(monkeypatch):
    receive = Socket().recvfrom
    monkeypatch.setattr(eager_reader, "core_count", lambda: 2)
    assert isinstance(reader_of(receive, due_any_moment=True), EagerReader)
    assert reader_of(receive, due_any_moment=False) == receive
    monkeypatch.setattr(eager_reader, "core_count", lambda: 1)
    assert reader_of(receive, due_any_moment=True) == receive
