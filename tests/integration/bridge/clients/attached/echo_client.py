"""Sends datagrams to ``HOST`` one by one, ``COUNT`` of ``LENGTH`` bytes, and prints how long each answer took, s."""

import socket
import sys
import time

host, count, length = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
client.settimeout(5.0)
for number in range(count):
    data = number.to_bytes(2, "big") * (length // 2)
    began_s = time.monotonic()
    client.sendto(data, (host, 7000))
    assert client.recv(65536) == data
    print(number, time.monotonic() - began_s, flush=True)
