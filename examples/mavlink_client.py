"""Print the state of UA 1 of a run, from its APS daemon, with pymavlink. Ctrl-C ends it."""

import sys

from pymavlink import mavutil

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp:127.0.0.1:6770"
connection = mavutil.mavlink_connection(endpoint, source_system=255)
connection.wait_heartbeat()
print(f"system {connection.target_system} is there", flush=True)
while True:
    message = connection.recv_match(type=["HEARTBEAT", "GLOBAL_POSITION_INT"], blocking=True)
    if message.get_srcSystem() == connection.target_system:
        print(message, flush=True)
