import os
import select

import pytest

from fdm.clock.board import Board, create_board
from fdm.clock.pace import NEVER_NS


@pytest.fixture
def boards():
    """The views of two processes, and the reading ends of their wake pipes."""
    fd = create_board(2)
    pipes = [os.pipe() for _ in range(2)]
    wake_fds = tuple(write for _, write in pipes)
    for write in wake_fds:
        os.set_blocking(write, False)
    views = [Board(fd, index, wake_fds) for index in range(2)]
    yield views, [read for read, _ in pipes]
    for view in views:
        view.close()
    for ends in pipes:
        for end in ends:
            os.close(end)
    os.close(fd)


def woken(read_fd):
    return bool(select.select([read_fd], [], [], 0)[0])


def test_all_see_the_slowest_and_the_longest_step(boards):
    (first, second), _ = boards
    assert first.slowest_ns() == 0
    first.publish(500, 10)
    assert second.slowest_ns() == 0  # the second has not started
    second.publish(NEVER_NS, 30)
    assert (first.slowest_ns(), first.largest_step_ns(), first.slowest_of(1)) == (500, 30, NEVER_NS)
    second.publish(400, 30)
    assert (first.slowest_ns(), second.slowest_ns()) == (400, 400)


def test_a_process_is_woken_once_when_it_asked_and_the_slowest_moved(boards):
    (first, second), (first_wakes, second_wakes) = boards
    first.publish(100, 10)
    second.publish(200, 10)
    assert not woken(first_wakes)
    second.ask_for_wake()
    first.publish(100, 10)
    assert not woken(second_wakes)  # nothing has moved
    first.publish(150, 10)
    assert woken(second_wakes)
    os.read(second_wakes, 10)
    first.publish(160, 10)
    assert not woken(second_wakes)
    second.ask_for_wake()
    second.publish(300, 10)
    assert not woken(second_wakes)


def test_a_full_wake_pipe_is_no_error(boards):
    (first, second), (_, second_wakes) = boards
    for slowest in range(1, 100_000):
        second.ask_for_wake()
        first.publish(slowest, 10)
        second.publish(slowest, 10)
    assert woken(second_wakes)
