"""A client of the exchange's JSON scheme in a few lines: motors at 60 % for two seconds.

First ``python -m fdm --index 0 --home 47.3977,8.5456,488,0 --speed max``, then
``python examples/flight_dynamics/json_client.py``.
"""

import argparse
import json
import socket
import struct
import sys

RATE_HZ = 400

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument(
    "--port", type=int, default=9002, help="UDP port of the UA: 9002 + 10 I (default: %(default)s)"
)
port = parser.parse_args().port

with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
    sock.settimeout(5.0)
    for frame_count in range(2 * RATE_HZ):
        pwm = [1600] * 4 + [0] * 12
        sock.sendto(struct.pack("<HHI16H", 18458, RATE_HZ, frame_count, *pwm), ("127.0.0.1", port))
        try:
            state = json.loads(sock.recv(2048))
        except TimeoutError:
            sys.exit(f"nobody answers on UDP port {port} within 5 s: start python -m fdm first (see --help)")
        if frame_count % RATE_HZ == RATE_HZ - 1:
            print(f"{state['timestamp']:.1f} s: {-state['position'][2]:.2f} m above home")
