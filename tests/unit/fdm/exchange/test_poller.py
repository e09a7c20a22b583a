import contextlib
import socket
import time

import pytest

from fdm.exchange.poller import Poller


@pytest.fixture
def ends():
    """A poller that waits for one end of a pair of sockets, and both ends."""
    poller = Poller()
    with contextlib.ExitStack() as stack:
        stack.callback(poller.close)
        ours, theirs = (stack.enter_context(sock) for sock in socket.socketpair())
        poller.register(ours.fileno())
        yield poller, ours, theirs


def test_what_can_be_read_is_told_at_once(ends):
    poller, ours, theirs = ends
    assert list(poller.wait(0)) == []
    theirs.send(b"x")
    for timeout_ns in (-1, 0, 10**9, 1 << 62):
        assert [fd for fd, _ in poller.wait(timeout_ns)] == [ours.fileno()]


def test_a_wait_in_vain_takes_the_time_out_and_no_less(ends):
    poller, _, _ = ends
    begin_ns = time.monotonic_ns()
    assert list(poller.wait(5_000_001)) == []
    assert time.monotonic_ns() - begin_ns >= 5_000_000
