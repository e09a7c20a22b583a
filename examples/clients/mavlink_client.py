"""Print the state of UA 1 of a run, from its APS daemon, with pymavlink. Ctrl-C or the end of the run ends it."""

import contextlib
import sys

from pymavlink import mavutil

VEHICLES = {1, 2, 13, 14}  # MAV_TYPE: fixed wing, quadrotor, hexarotor, octorotor

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp:127.0.0.1:6770"
connection = mavutil.mavlink_connection(endpoint, source_system=255)
connection.handle_eof = lambda: sys.exit(
    "the run is over"
)  # pymavlink would go on reading a closed connection
with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
    system = None
    while True:
        message = connection.recv_match(type=["HEARTBEAT", "GLOBAL_POSITION_INT"], blocking=True)
        if system is None and message.get_type() == "HEARTBEAT" and message.type in VEHICLES:
            system = message.get_srcSystem()
            print(f"system {system} is there", flush=True)
        elif message.get_srcSystem() == system:
            print(message, flush=True)
