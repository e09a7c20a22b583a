"""``python -m fdm``, started as a user does."""

import os
import re
import signal
import socket
import subprocess
import sys

from fdm.sensor_frame import decode_sensor_frame
from fdm.servo_packet import ServoPacket, encode_servo_packet

WAIT_S = 20.0


def command(*arguments):
    return [sys.executable, "-m", "fdm", "--home", "47,8,400,0", *arguments]


def test_the_command_serves_until_it_is_ended():
    process = subprocess.Popen(
        command("--port", "0", "--speed", "max"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        ready = process.stdout.readline()
        port = int(re.fullmatch(r"ready: UA 0, f450, UDP 127\.0\.0\.1:(\d+)\n", ready).group(1))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.settimeout(WAIT_S)
            for count in range(10):
                packet = ServoPacket(400, count, (1000,) * 16)
                sock.sendto(encode_servo_packet(packet), ("127.0.0.1", port))
                assert decode_sensor_frame(sock.recv(4096)) is not None
        os.kill(process.pid, signal.SIGTERM)
        out, err = process.communicate(timeout=WAIT_S)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 0
    assert out == "served: boots 1, frames 9\n"
    assert "Traceback" not in err


def test_the_command_explains_a_port_in_use():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        done = subprocess.run(command("--port", str(port)), capture_output=True, text=True, timeout=WAIT_S)
    assert done.returncode == 2
    assert f"UDP port {port}" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_help_says_how_to_start_ardupilot():
    done = subprocess.run(
        [sys.executable, "-m", "fdm", "--help"], capture_output=True, text=True, timeout=WAIT_S
    )
    assert done.returncode == 0
    assert "arducopter --model JSON:127.0.0.1 -I3" in done.stdout
