"""``python -m fdm``, started as a user does."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from click.testing import CliRunner

from fdm.__main__ import main
from fdm.model.airframe import AIRFRAMES_DIR
from fdm.wire.legacy import legacy_ports
from fdm.wire.sensor_frame import decode_sensor_frame
from fdm.wire.servo_packet import ServoPacket, encode_servo_packet
from tests.unit.fdm.wire.legacy_peer import servos, state_of

WAIT_S = 20.0


def command(*arguments):
    return [sys.executable, "-m", "fdm", "--home", "47,8,400,0", *arguments]


def run_here(*arguments):
    """In this process: what is asked for is refused before anything begins."""
    return CliRunner().invoke(main, ["--home", "47,8,400,0", *arguments])


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
        done = run_here("--port", str(port))
    assert done.exit_code == 2
    assert f"UDP port {port}" in done.stderr


def test_a_model_that_jsbsim_throws_out_of_is_a_mistake_and_no_crash(tmp_path):
    shipped = AIRFRAMES_DIR / "jsbsim" / "aircraft" / "f450" / "f450.xml"
    model = tmp_path / "aircraft" / "mine" / "mine.xml"
    model.parent.mkdir(parents=True)
    model.write_text(shipped.read_text().replace("aero/qbar-area", "aero/nope"))
    airframe = (AIRFRAMES_DIR / "f450.yaml").read_text()
    (tmp_path / "mine.yaml").write_text(
        airframe.replace("model: f450", "model: mine").replace("root: jsbsim", "root: .")
    )
    done = subprocess.run(
        command("--airframe", str(tmp_path / "mine.yaml")), capture_output=True, text=True, timeout=WAIT_S
    )
    says = r"error: airframe f450: JSBSim model mine does not run: .* The property aero/nope does not exist\n"
    assert re.fullmatch(says, done.stderr)
    assert done.returncode == 2


def test_the_help_says_how_to_start_ardupilot():
    done = run_here("--help")
    assert done.exit_code == 0
    assert "arducopter --model JSON:127.0.0.1 -I3" in done.stdout


def exchange_one_frame(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(WAIT_S)
        sock.sendto(encode_servo_packet(ServoPacket(400, 0, (1000,) * 16)), ("127.0.0.1", port))
        return decode_sensor_frame(sock.recv(4096))


@pytest.mark.parametrize("workers", [1, 2])
def test_the_command_hosts_several_ua_with_sensor_errors(workers, tmp_path):
    noise = tmp_path / "noise.yaml"
    noise.write_text("accel_bias_frd_mps2: [0.0, 3.0, 0.0]\n")
    options = ("--index", "5", "--count", "2", "--port", "0", "--speed", "max", "--noise", str(noise))
    with subprocess.Popen(
        command(*options, "--workers", str(workers)),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            lines = [process.stdout.readline() for _ in range(2)]
            found = [re.fullmatch(r"ready: UA (\d), f450, UDP 127\.0\.0\.1:(\d+)\n", line) for line in lines]
            assert [match.group(1) for match in found] == ["5", "6"]
            with ThreadPoolExecutor() as pool:
                frames = list(pool.map(exchange_one_frame, [int(match.group(2)) for match in found]))
            assert [frame.specific_force_frd_mps2[1] for frame in frames] == pytest.approx(
                [3.0, 3.0], abs=0.05
            )
            process.terminate()
            out, err = process.communicate(timeout=WAIT_S)
        finally:
            process.kill()
    assert process.returncode == 0
    assert out == "served: UA 5 boots 1, frames 0\nserved: UA 6 boots 1, frames 0\n"
    assert "Traceback" not in err


@pytest.mark.parametrize("speed", ["0", "nan", "fast", "1e300", "5e-324"])
def test_an_impossible_speed_is_refused(speed):
    done = run_here("--speed", speed)
    assert done.exit_code == 2
    assert f"'{speed}' is neither a real-time factor nor max: " in done.output


def bind_first_free_state_port(sock):
    """Bind `sock` to the legacy scheme's state port of some UA; gives that UA's index."""
    for index in range(1000, 5000):
        with contextlib.suppress(OSError):
            sock.bind(("127.0.0.1", legacy_ports(index)[0]))
            return index
    raise AssertionError("no port is free")


def test_the_command_serves_a_legacy_peer():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        index = bind_first_free_state_port(peer)
        peer.settimeout(WAIT_S)
        options = ("--index", str(index), "--port", "0", "--ports", "legacy", "--legacy-rate", "200")
        with subprocess.Popen(command(*options), stdout=subprocess.PIPE, text=True) as process:
            try:
                port = int(process.stdout.readline().rpartition(":")[2])
                for number in (1, 2):
                    peer.sendto(servos((1000,) * 11), ("127.0.0.1", port))
                    assert state_of(peer.recv(1024)).time_us == number * 5000
            finally:
                process.kill()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "accel_sigma_mps2: 1\ngyro_sigma: 2\n",
            ":2: gyro_sigma: unknown key; did you mean gyro_sigma_radps? (allowed here: gyro_sigma_radps, ",
        ),
        (
            "\naccel_sigma_mps2: -1\n",
            ":2: accel_sigma_mps2: has to be greater than or equal to 0 (got -1)",
        ),
    ],
)
def test_a_mistake_in_the_sensor_errors_is_explained(text, says, tmp_path):
    noise = tmp_path / "noise.yaml"
    noise.write_text(text)
    done = run_here("--noise", str(noise))
    assert done.exit_code == 2
    assert f"{noise}{says}" in done.stderr


def test_one_port_is_for_one_ua():
    done = run_here("--count", "2", "--port", "9100")
    assert done.exit_code == 2
    assert "--port is for one UA" in done.stderr


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--px4", "--ports", "legacy"), "--ports is for ArduPilot"),
        (("--px4", "--legacy-rate", "400"), "--legacy-rate is for ArduPilot"),
        (("--px4", "--coupling", "parallel"), "--coupling parallel is for ArduPilot"),
        (("--px4", "--imu-rate", "110"), "--imu-rate 110: must be a multiple of 50"),
        (("--imu-rate", "250"), "--imu-rate is for --px4"),
        (("--qnh", "nan"), "--qnh nan: must be a number"),
        (("--temperature-offset", "nan"), "--temperature-offset nan: must be a number"),
    ],
)
def test_options_that_do_not_fit_each_other_are_refused_in_a_line(options, text):
    done = run_here(*options)
    assert done.exit_code == 2
    assert text in done.stderr.splitlines()[-1]
