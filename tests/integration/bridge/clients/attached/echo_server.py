"""Answers each datagram with itself, until it is ended."""

import socket

server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
server.bind(("", 7000))
print("listens", flush=True)
while True:
    data, address = server.recvfrom(65536)
    server.sendto(data, address)
