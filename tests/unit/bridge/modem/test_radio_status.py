"""RADIO_STATUS, read by pymavlink; its fields by the arithmetic of the firmware, written out."""

from __future__ import annotations

import pytest

from bridge.modem.heard import RadioMeter, register_of
from bridge.modem.radio_status import Buffer, ElrsStatus, SikStatus
from bridge.modem.units import Unit
from tests.unit.bridge.modem.frames import decoded

LOOK_NS = 513_600_000


def heard_at(at_ns: int) -> RadioMeter:
    return RadioMeter(rssi=118, noise=34, remote=(117, 35), errors=7, heard_ns=at_ns)


@pytest.mark.parametrize("version", [1, 2])
def test_sik(version: int) -> None:
    frame = SikStatus().frame(version, 258, heard_at(0), Buffer(925, 1850), LOOK_NS)
    (message,) = decoded(frame)
    assert frame[0] == {1: 0xFE, 2: 0xFD}[version]
    assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (51, 68, 2)
    # 925 of 1850 bytes are free: 100 * (925 / 8 = 115) / (1850 / 8 = 231) = 49
    told = {name: getattr(message, name) for name in message.fieldnames}
    assert told == {
        "rssi": 118,
        "remrssi": 117,
        "txbuf": 49,
        "noise": 34,
        "remnoise": 35,
        "rxerrors": 7,
        "fixed": 0,
    }


@pytest.mark.parametrize(("used", "percent"), [(0, 100), (8, 99), (1850, 0), (1843, 0), (370, 80)])
def test_sik_free_buffer(used: int, percent: int) -> None:
    (message,) = decoded(SikStatus().frame(2, 0, heard_at(0), Buffer(used, 1850), 0))
    assert message.txbuf == percent


def test_sik_forgets_its_peer_after_six_looks() -> None:
    for at_ns, remote in ((6 * LOOK_NS - 1, (117, 35)), (6 * LOOK_NS, (0, 0))):
        (message,) = decoded(SikStatus().frame(2, 0, heard_at(0), Buffer(0, 1850), at_ns))
        assert (message.remrssi, message.remnoise, message.rssi) == (*remote, 118)


def test_sik_answers_heartbeats_only() -> None:
    assert SikStatus().answers(Unit(b"", 2, True))
    assert not SikStatus().answers(Unit(b"", 2, False))


def test_registers() -> None:
    # dBm = register / 1.9 - 127
    assert [register_of(dbm) for dbm in (-127.0, -108.0, -70.0, -200.0, 50.0)] == [0, 36, 108, 0, 255]


def test_averages_as_in_the_firmware() -> None:
    heard = RadioMeter(noise=36)
    heard.takes(-70.0, 38.0, 5)
    assert (heard.rssi, heard.noise) == (108 // 8, (36 + 3 * 36) // 4)
    heard.takes(-70.0, 38.0, 6)
    assert heard.rssi == (108 + 7 * (108 // 8)) // 8


def test_elrs() -> None:
    heard = RadioMeter(power_dbm=-81.4, snr_db=-3.0, heard_ns=1)
    heard.quality.extend([True] * 75 + [False] * 25)
    frame = ElrsStatus().frame(1, 3, heard, Buffer(256, 1024), 0)
    (message,) = decoded(frame)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (255, 68)
    assert frame[0] == 0xFD
    # link quality 75 % times 2.55; powers without sign; 768 of 1024 bytes are free; the SNR as an unsigned byte
    assert (message.rssi, message.remrssi, message.txbuf, message.noise) == (191, 81, 75, 253)
    assert (message.remnoise, message.rxerrors, message.fixed) == (0, 0, 0)


def test_elrs_before_it_heard_anything() -> None:
    (message,) = decoded(ElrsStatus().frame(2, 0, RadioMeter(), Buffer(0, 1024), 0))
    assert (message.rssi, message.remrssi, message.txbuf) == (0, 0, 100)
