"""Sends datagrams of ``LENGTH`` bytes to ``HOST`` for ``SECONDS``, one every ``PERIOD`` s; then prints how many."""

import socket
import sys
import time

host, length, seconds, period = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4])
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
began_s, sent = time.monotonic(), 0
while time.monotonic() - began_s < seconds:
    sender.sendto(bytes(length), (host, 7001))
    sent += 1
    time.sleep(max(0.0, began_s + sent * period - time.monotonic()))
print(sent, flush=True)
