"""Plays PX4's side of its simulator interface, by pymavlink: ``python -m tests.px4_played PORT SILENT ANSWERS``.

It connects, reads SILENT frames without a word, as PX4 does before its modules run, and answers the next ANSWERS with
motors at 0.01 of their number; then it reads on in silence.
"""

from __future__ import annotations

import socket
import sys

from pymavlink.dialects.v20 import common


def main(port: int, silent: int, answers: int) -> None:
    """Play."""
    mav = common.MAVLink(None, srcSystem=1, srcComponent=1)
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(common.MAVLink_heartbeat_message(0, 12, 0, 0, 0, 3).pack(mav))
        frames = 0
        while data := connection.recv(65536):
            for message in mav.parse_buffer(data) or ():
                if message.get_type() != "HIL_SENSOR":
                    continue
                frames += 1
                if silent < frames <= silent + answers:
                    controls = [0.01 * ((frames - silent) % 10)] * 4 + [0.0] * 12
                    answer = common.MAVLink_hil_actuator_controls_message(
                        message.time_usec, controls, 0x81, 1
                    )
                    connection.sendall(answer.pack(mav))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:4]))
