"""Reads the next packet without going to sleep, where it is due any moment."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any

from fdm.exchange.settings import core_count

LOOKS = 50
"""How often to look before waiting: about 0.1 ms."""

Receive = Callable[[int, int], tuple[bytes, Any]]
"""``recvfrom`` of a socket."""


class EagerReader:
    """In the place of a socket's ``recvfrom``: looks a while before it waits, half as often after each time in vain.

    A lone UA in parallel coupling at full speed sends its next packet sooner than this process would fall asleep and be
    woken, which on virtual machines takes tens of microseconds.

    Args:
        receive: ``recvfrom`` of a UDP socket.
    """

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self._looks = LOOKS

    def __call__(self, size: int, flags: int) -> tuple[bytes, Any]:
        """A datagram and its sender.

        Raises:
            BlockingIOError: the socket's time-out passed.
        """
        receive = self._receive
        for _ in range(self._looks):
            try:
                got = receive(size, flags | socket.MSG_DONTWAIT)
            except BlockingIOError:
                continue
            self._looks = LOOKS
            return got
        self._looks = max(1, self._looks // 2)
        return receive(size, flags)


def reader_of(receive: Receive, *, due_any_moment: bool) -> Receive:
    """`receive`, or an eager one if packets are due any moment and there is a core to spare for it."""
    return EagerReader(receive) if due_any_moment and core_count() > 1 else receive
