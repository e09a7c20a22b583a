"""Plays PX4's side of its simulator interface, by pymavlink: ``python -m tests.px4_played PORT SILENT ANSWERS [HOW]``.

It connects, reads SILENT frames without a word, as PX4 does before its modules run, and answers the next ANSWERS with
motors at 0.01 of their number; then it reads on in silence. As in PX4, a thread named sim_rcv connects and reads, and
another one waits. HOW, words with commas between:

    relayed     its reader has no name: it is no PX4
    unlocked    its flags lack the bit that says lockstep
    naps        the first answer is given by a thread that sleeps 10 ms before, as when PX4 boots
    keeps       what it reads is kept in the file ``hil.bin`` of the folder that it is in
    real-time   its threads are real-time ones; one of them, named as what keeps PX4's missions, waits
"""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from contextlib import nullcontext
from pathlib import Path

from pymavlink.dialects.v20 import common

NAP_S = 0.01
PRIORITY = 50
KEPT = Path("hil.bin")


def build(folder: Path, script: str) -> Path:
    """What is taken for PX4's build: a script in the place of its program."""
    binary = folder / "bin" / "px4"
    binary.parent.mkdir(parents=True)
    (folder / "etc" / "init.d-posix").mkdir(parents=True)
    binary.write_text(f"#!/bin/sh\n{script}\n", encoding="ascii")
    binary.chmod(0o755)
    return folder


class Player:
    """One PX4."""

    def __init__(self, port: int, silent: int, answers: int, how: str) -> None:
        self._port, self._silent, self._answers = port, silent, answers
        self._how = how.split(",")
        self._mav = common.MAVLink(None, srcSystem=1, srcComponent=1)

    def read(self) -> None:
        """The reader: until the simulator closes."""
        if "relayed" not in self._how:
            Path("/proc/thread-self/comm").write_text("sim_rcv", encoding="ascii")
        if "real-time" in self._how:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
            threading.Thread(target=wait_for_ever, daemon=True).start()
        frames = 0
        keeps = KEPT.open("wb", buffering=0) if "keeps" in self._how else nullcontext()
        with socket.create_connection(("127.0.0.1", self._port)) as connection, keeps as kept:
            connection.sendall(common.MAVLink_heartbeat_message(0, 12, 0, 0, 0, 3).pack(self._mav))
            while data := connection.recv(65536):
                if kept is not None:
                    kept.write(data)
                for message in self._mav.parse_buffer(data) or ():
                    if message.get_type() == "HIL_SENSOR":
                        frames += 1
                        self._read_frame(connection, frames - self._silent, message.time_usec)

    def _read_frame(self, connection: socket.socket, number: int, time_us: int) -> None:
        if not 0 < number <= self._answers:
            return
        controls = [0.01 * (number % 10)] * 4 + [0.0] * 12
        flags = 0 if "unlocked" in self._how else 1
        answer = common.MAVLink_hil_actuator_controls_message(time_us, controls, 0x81, flags).pack(self._mav)
        if number == 1 and "naps" in self._how:
            threading.Thread(target=send_later, args=(connection, answer)).start()
        else:
            connection.sendall(answer)


def wait_for_ever() -> None:
    """Do nothing, as PX4's dataman without missions."""
    Path("/proc/thread-self/comm").write_text("dataman", encoding="ascii")
    threading.Event().wait()


def send_later(connection: socket.socket, data: bytes) -> None:
    """Send after a nap."""
    time.sleep(NAP_S)
    connection.sendall(data)


if __name__ == "__main__":
    player = Player(*map(int, sys.argv[1:4]), *sys.argv[4:] or [""])
    reader = threading.Thread(target=player.read)
    reader.start()
    reader.join()
