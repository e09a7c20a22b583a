"""Takes datagrams until none comes for 2 s; prints how many bytes came after the first, and in how many seconds."""

import socket
import time

server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
server.bind(("", 7001))
print("listens", flush=True)
server.settimeout(20.0)
server.recv(65536)
first_s = last_s = time.monotonic()
total = 0
server.settimeout(2.0)
while True:
    try:
        total += len(server.recv(65536))
    except TimeoutError:
        break
    last_s = time.monotonic()
print(total, last_s - first_s, flush=True)
