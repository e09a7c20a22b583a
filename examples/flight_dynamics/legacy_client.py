"""A client of the exchange's legacy scheme: hosts one UA on it, and flies it for two seconds.

The state comes in at UDP 5501, the servo outputs go out to 5502; the layout is in ``fdm/wire/legacy.py``.
Run it as ``python examples/flight_dynamics/legacy_client.py``.
"""

import math
import socket
import struct
import threading

from fdm.exchange.exchange import AircraftSpec, Exchange, LegacyPeer
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home

RATE_HZ = 400
HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0), 0.0)

spec = AircraftSpec(
    0, load_airframe("f450"), HOME, port=5502, legacy=LegacyPeer(state_port=5501, rate_hz=RATE_HZ)
)
exchange = Exchange([spec], speed=math.inf)
thread = threading.Thread(target=exchange.run)
thread.start()
try:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 5501))
        sock.settimeout(5.0)
        for frame in range(2 * RATE_HZ):
            sock.sendto(struct.pack("<14H", *(1600,) * 4, *(0,) * 10), ("127.0.0.1", 5502))
            time_us, *numbers, magic = struct.unpack("<Q17dI", sock.recv(256))
            if frame % RATE_HZ == RATE_HZ - 1:
                print(f"{time_us / 1e6:.1f} s: {numbers[2] - HOME.position.alt_amsl_m:.2f} m above home")
finally:
    exchange.stop()
    thread.join()
    exchange.close()
