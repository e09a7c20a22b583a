import struct
from time import process_time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.logs.dataflash import DataflashError, read_messages
from aps.logs.flight_log import AutopilotLogError, LoggedPlace, read_link, read_tlog

HOME = LoggedPlace(47.0, 8.0, 500.0)
METRES_PER_DEGREE = np.pi / 180.0 * 6_371_008.8
BOOT_AT_RECEIVER_S = 1_700_000_000.0
RATE_HZ = 20.0


class Sender:
    """An autopilot that sends a position and an attitude in turn, and moves north of home."""

    def __init__(self, sysid, packets, speed_mps=5.0, start_m=10.0):
        self.mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
        self.boot_s = 100.0 + np.arange(packets) / RATE_HZ
        self.distance_m = start_m + speed_mps * np.arange(packets) / RATE_HZ
        self.frames = [self._frame(k) for k in range(packets)]

    def _frame(self, k):
        boot_ms = round(self.boot_s[k] * 1e3)
        lat = round((HOME.lat_deg + self.distance_m[k] / METRES_PER_DEGREE) * 1e7)
        if k % 2:
            message = mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0, 0, 0)
        else:
            fields = lat, round(HOME.lon_deg * 1e7), round(HOME.alt_amsl_m * 1e3), 0, 0, 0, 0, 0
            message = mavlink.MAVLink_global_position_int_message(boot_ms, *fields)
        packed = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        return bytes(packed)

    def tlog(self, clock_s, kept=None):
        """Bytes by a recorder's clock that reads `clock_s` when the autopilot boots."""
        chosen = range(len(self.frames)) if kept is None else np.flatnonzero(kept)
        return [(clock_s + self.boot_s[k], self.frames[k]) for k in chosen]


def radio_status(rssi):
    radio = mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
    return bytes(mavlink.MAVLink_radio_status_message(rssi, 90, 100, 40, 41, 0, 0).pack(radio))


def write_tlog(file, entries):
    ordered = sorted(entries, key=lambda each: each[0])
    file.write_bytes(b"".join(struct.pack(">Q", round(t * 1e6)) + frame for t, frame in ordered))
    return file


def pattern(packets, seed=1):
    """What arrives: most of it, with one outage of more than two rounds of the sequence counter."""
    kept = np.random.Generator(np.random.PCG64(seed)).uniform(size=packets) > 0.2
    kept[[0, -1]] = True
    kept[700:1300] = False
    return kept


def test_gaps_distances_and_rssi_come_out_as_they_went_in(tmp_path):
    sender = Sender(7, 2000)
    kept = pattern(2000)
    status = [(BOOT_AT_RECEIVER_S + 105.01 + k, radio_status(120 + k)) for k in range(3)]
    received = write_tlog(tmp_path / "ground.tlog", sender.tlog(BOOT_AT_RECEIVER_S, kept) + status)
    sent = write_tlog(tmp_path / "ua.tlog", sender.tlog(5e8))  # a clock that is years off
    link = read_link(received, sent, receiver_at=HOME)
    assert link.delivered.tolist() == kept.tolist()
    assert link.distance_m == pytest.approx(sender.distance_m, abs=0.4)
    arrived = np.flatnonzero(kept)[:-1]  # the last frame has no position after it
    assert link.distance_m[arrived] == pytest.approx(sender.distance_m[arrived], abs=0.05)
    seen = np.flatnonzero(np.isfinite(link.rssi_dbm))
    assert link.rssi_dbm[seen] == pytest.approx([(120 + k) / 1.9 - 127.0 for k in range(3)])
    assert link.time_s[seen] == pytest.approx(BOOT_AT_RECEIVER_S + 105.0 + np.arange(3), abs=0.1)
    assert set(link.length_bytes[link.delivered]) == {float(len(each)) for each in sender.frames}


def test_distances_over_the_180th_meridian_are_as_anywhere(tmp_path):
    class Eastward(Sender):
        def _frame(self, k):
            east_deg = self.distance_m[k] / METRES_PER_DEGREE / np.cos(np.radians(HOME.lat_deg))
            lon_deg = (179.9995 + east_deg + 180.0) % 360.0 - 180.0  # beyond it after 38 m
            fields = round(HOME.lat_deg * 1e7), round(lon_deg * 1e7), round(HOME.alt_amsl_m * 1e3)
            message = mavlink.MAVLink_global_position_int_message(
                round(self.boot_s[k] * 1e3), *fields, 0, 0, 0, 0, 0
            )
            packed = message.pack(self.mav)
            self.mav.seq = (self.mav.seq + 1) % 256
            return bytes(packed)

    sender = Eastward(7, 400)
    received, sent = (write_tlog(tmp_path / name, sender.tlog(5e8)) for name in ("ground.tlog", "ua.tlog"))
    link = read_link(received, sent, receiver_at=LoggedPlace(HOME.lat_deg, 179.9995, HOME.alt_amsl_m))
    assert link.distance_m[:-1] == pytest.approx(sender.distance_m[:-1], abs=0.05)


def test_a_receiver_that_flies_is_where_its_own_autopilot_says(tmp_path):
    sender, receiver = Sender(1, 400), Sender(2, 400, speed_mps=-2.0)
    entries = sender.tlog(BOOT_AT_RECEIVER_S) + receiver.tlog(BOOT_AT_RECEIVER_S)
    received = write_tlog(tmp_path / "ua2.tlog", entries)
    sent = write_tlog(tmp_path / "ua1.tlog", sender.tlog(BOOT_AT_RECEIVER_S))
    link = read_link(received, sent)
    assert link.delivered.all()
    expected = (sender.distance_m - receiver.distance_m)[
        1:
    ]  # they start from one place: the first is left out
    assert link.distance_m == pytest.approx(expected, abs=0.4)
    assert link.distance_m[:-1] == pytest.approx(expected[:-1], abs=0.05)


def test_silence_at_the_end_counts_as_lost_while_the_sender_goes_on(tmp_path):
    sender = Sender(1, 1000)
    kept = np.arange(1000) < 600
    ground = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    beat = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(ground))
    entries = [*sender.tlog(BOOT_AT_RECEIVER_S, kept), (BOOT_AT_RECEIVER_S + 500.0, beat)]
    received = write_tlog(tmp_path / "ground.tlog", entries)
    sent = write_tlog(tmp_path / "ua.tlog", sender.tlog(0.0))
    link = read_link(received, sent, receiver_at=HOME)
    assert np.count_nonzero(link.delivered) == 600
    assert np.count_nonzero(~link.delivered) == pytest.approx(400, abs=2)
    assert link.distance_m[-1] == pytest.approx(sender.distance_m[-1], abs=1.0)


def test_copies_and_late_frames_are_not_counted_as_rounds(tmp_path):
    sender = Sender(1, 300)
    entries = sender.tlog(BOOT_AT_RECEIVER_S)
    late = [(t + 0.11, frame) for t, frame in entries[50:60]]
    received = write_tlog(tmp_path / "ground.tlog", entries + late)
    sent = write_tlog(tmp_path / "ua.tlog", sender.tlog(0.0))
    link = read_link(received, sent, receiver_at=HOME)
    assert link.delivered.all()
    assert link.delivered.size == 300


def dataflash(messages):
    """Bytes of a .bin with a format of POS and RAD, as ArduPilot writes them."""

    def described(kind, length, name, letters, columns):
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, name, letters, columns)

    out = described(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    out += described(200, 31, b"POS", b"QLLfff", b"TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt")
    out += described(201, 19, b"NOTE", b"QQ", b"TimeUS,Value")
    for time_us, lat, lon, alt in messages:
        place = round(lat * 1e7), round(lon * 1e7)
        out += b"\xa3\x95\xc8" + struct.pack("<Qiifff", time_us, *place, alt, 0.0, 0.0)
        out += b"\xa3\x95\xc9" + struct.pack("<QQ", time_us, 0xC895A3)
    return out


def test_the_sender_may_have_a_bin(tmp_path):
    sender = Sender(3, 500)
    received = write_tlog(tmp_path / "ground.tlog", sender.tlog(BOOT_AT_RECEIVER_S, pattern(500)))
    rows = [
        (round(boot * 1e6), HOME.lat_deg + metres / METRES_PER_DEGREE, HOME.lon_deg, HOME.alt_amsl_m + 30.0)
        for boot, metres in zip(sender.boot_s[::4], sender.distance_m[::4], strict=True)
    ]
    sent = tmp_path / "ua.bin"
    sent.write_bytes(dataflash(rows))
    link = read_link(received, sent, receiver_at=HOME)
    assert link.delivered.tolist() == pattern(500).tolist()
    assert link.distance_m == pytest.approx(np.hypot(sender.distance_m, 30.0), abs=1.2)


def test_data_flash_reads_as_pymavlink_reads_it(tmp_path):
    file = tmp_path / "log.bin"
    rows = [(k * 10_000 + 1, 47.0 + 1e-5 * k, -8.0, 400.0 + k) for k in range(50)]
    file.write_bytes(dataflash(rows))
    theirs = DFReader.DFReader_binary(str(file))
    ours = read_messages(file.read_bytes(), "POS")
    for mine in ours:
        message = theirs.recv_match(type="POS")
        assert mine["Lat"] == pytest.approx(message.Lat, abs=1e-9)
        assert mine["Alt"] == message.Alt
        assert mine["TimeUS"] == message.TimeUS
    assert len(ours) == 50
    theirs.filehandle.close()


@pytest.mark.parametrize(
    ("received", "sent", "words"),
    [
        (b"", b"", "ground.tlog: no MAVLink frames"),
        (b"hello" * 100, b"", "ground.tlog: no MAVLink frames"),
        (None, b"\xff" * 500, "ua.tlog: no MAVLink frames"),
        (None, b"ULog\x01\x12\x35\x01" + b"\xff" * 500, "ua.tlog: a ULog, which is not read"),
    ],
)
def test_files_that_are_no_logs_are_named(tmp_path, received, sent, words):
    ground, ua = tmp_path / "ground.tlog", tmp_path / "ua.tlog"
    good = Sender(1, 50)
    write_tlog(ground, good.tlog(0.0)) if received is None else ground.write_bytes(received)
    ua.write_bytes(sent)
    with pytest.raises(AutopilotLogError, match=words):
        read_link(ground, ua, receiver_at=HOME)


def test_what_is_missing_is_said(tmp_path):
    sender = Sender(1, 50)
    ground = write_tlog(tmp_path / "ground.tlog", sender.tlog(0.0))
    sent = write_tlog(tmp_path / "ua.tlog", sender.tlog(0.0))
    with pytest.raises(AutopilotLogError, match="where the receiver stood"):
        read_link(ground, sent)
    other = write_tlog(tmp_path / "other.tlog", Sender(9, 50).tlog(0.0))
    with pytest.raises(AutopilotLogError, match="no stream of frames from system 9"):
        read_link(ground, other, receiver_at=HOME)
    with pytest.raises(AutopilotLogError, match=r"cannot read .*nothing\.tlog"):
        read_link(ground, tmp_path / "nothing.tlog")
    with pytest.raises(AutopilotLogError, match=r"cannot read .*nothing\.bin"):
        read_link(ground, tmp_path / "nothing.bin")
    with pytest.raises(AutopilotLogError, match="does not show what arrived"):
        read_link(tmp_path / "ground.bin", sent)
    (tmp_path / "ua.bin").write_bytes(b"nothing")
    with pytest.raises(AutopilotLogError, match=r"ua\.bin: no format messages"):
        read_link(ground, tmp_path / "ua.bin", receiver_at=HOME)
    rebooted = Sender(1, 50)
    both = [(t + 100.0, frame) for t, frame in rebooted.tlog(0.0)] + sender.tlog(0.0)
    with pytest.raises(AutopilotLogError, match="booted anew"):
        read_link(ground, write_tlog(tmp_path / "twice.tlog", both), receiver_at=HOME)


def test_a_reboot_in_the_log_of_the_receiver_is_said(tmp_path):
    """The sender's own log may have one boot alone: a .bin always has."""
    sender = Sender(1, 200)
    later = [(t + 100.0, frame) for t, frame in Sender(1, 200).tlog(BOOT_AT_RECEIVER_S)]
    received = write_tlog(tmp_path / "ground.tlog", sender.tlog(BOOT_AT_RECEIVER_S) + later)
    sent = write_tlog(tmp_path / "ua.tlog", sender.tlog(0.0))
    with pytest.raises(
        AutopilotLogError, match=r"ground\.tlog: the clock of system 1 went back: it was booted anew"
    ):
        read_link(received, sent, receiver_at=HOME)


def test_frames_without_times_are_no_tlog(tmp_path):
    """As MAVProxy writes them in its .tlog.raw: bytes of frames would be taken for times."""
    raw = tmp_path / "raw.tlog"
    raw.write_bytes(b"".join(Sender(1, 400).frames))
    with pytest.raises(
        AutopilotLogError, match=r"raw\.tlog: its frames have no times before them: not a \.tlog"
    ):
        read_tlog(raw)


def test_a_log_cut_off_or_damaged_in_the_middle_keeps_the_rest(tmp_path):
    file = write_tlog(tmp_path / "ua.tlog", Sender(1, 100).tlog(0.0))
    data = bytearray(file.read_bytes()[:-5])
    data[1000:1003] = b"\x00\xfd\xfe"
    file.write_bytes(data)
    assert 96 <= len(read_tlog(file)) <= 98


def test_a_damaged_time_makes_no_losses(tmp_path):
    sender = Sender(1, 1000)
    entries = [[round(t * 1e6), frame] for t, frame in sender.tlog(BOOT_AT_RECEIVER_S)]
    for k, bit in ((300, 24), (500, 27), (700, 25), (900, 33)):  # between 17 s and 2 h off, either way
        entries[k][0] ^= 1 << bit
    received, sent = tmp_path / "ground.tlog", write_tlog(tmp_path / "ua.tlog", sender.tlog(0.0))
    received.write_bytes(b"".join(struct.pack(">Q", time_us) + frame for time_us, frame in entries))
    link = read_link(received, sent, receiver_at=HOME)
    assert link.delivered.all()
    assert link.distance_m == pytest.approx(sender.distance_m, abs=0.4)


def test_a_stream_that_comes_in_bursts_is_not_taken_for_a_fast_one(tmp_path):
    """All packets of three seconds at once: gaps say nothing of the rate, windows do."""
    sender = Sender(1, 2400)
    kept = pattern(2400)
    entries = [
        (BOOT_AT_RECEIVER_S + 3.0 * np.ceil(sender.boot_s[k] / 3.0) + 1e-5 * k, sender.frames[k])
        for k in np.flatnonzero(kept)
    ]
    received = write_tlog(tmp_path / "ground.tlog", entries)
    sent = write_tlog(tmp_path / "ua.tlog", sender.tlog(0.0))
    link = read_link(received, sent, receiver_at=HOME)
    assert np.count_nonzero(link.delivered) == np.count_nonzero(kept)
    assert np.count_nonzero(~link.delivered) == pytest.approx(np.count_nonzero(~kept), abs=70)


def test_positions_that_cannot_be_are_left_out_of_a_bin(tmp_path):
    sender = Sender(3, 400)
    received = write_tlog(tmp_path / "ground.tlog", sender.tlog(BOOT_AT_RECEIVER_S))
    rows = [
        [round(boot * 1e6), HOME.lat_deg + metres / METRES_PER_DEGREE, HOME.lon_deg, HOME.alt_amsl_m]
        for boot, metres in zip(sender.boot_s, sender.distance_m, strict=True)
    ]
    rows[50][1], rows[100][2], rows[150][3], rows[200][3], rows[250][0] = -83.0, 171.0, 3e38, np.nan, 2**60
    sent = tmp_path / "ua.bin"
    sent.write_bytes(dataflash(rows))
    link = read_link(received, sent, receiver_at=HOME)
    assert link.distance_m == pytest.approx(sender.distance_m, abs=0.4)
    sent.write_bytes(sent.read_bytes().replace(b"TimeUS,Lat,", b"TimeUS,Lax,"))
    with pytest.raises(AutopilotLogError, match=r"ua\.bin: POS without numbers TimeUS, Lat"):
        read_link(received, sent, receiver_at=HOME)


def test_garbage_between_frames_costs_little(tmp_path):
    file = tmp_path / "ua.tlog"
    file.write_bytes(b"\xfd" * 150_000 + LOG + b"\xfe" * 20_000 + LOG)
    start = process_time()
    assert len(read_tlog(file)) == 60
    assert process_time() - start < 5.0  # 34 s if each byte is tried as the beginning of all that follows


LOG = b"".join(struct.pack(">Q", round(t * 1e6)) + frame for t, frame in Sender(1, 30).tlog(0.0))
BIN = dataflash([(k, 47.0, 8.0, 1.0) for k in range(10)])


@given(
    cut=st.integers(0, len(LOG)),
    edits=st.lists(st.tuples(st.integers(0, len(LOG) - 1), st.integers(0, 255)), max_size=20),
)
def test_no_bytes_lead_to_another_error(tmp_path_factory, cut, edits):
    folder = tmp_path_factory.mktemp("logs")
    data, flash = bytearray(LOG), bytearray(BIN)
    for place, value in edits:
        data[place] = value
        flash[place % len(flash)] = value
    (folder / "a.tlog").write_bytes(data[:cut])
    (folder / "b.tlog").write_bytes(LOG)
    (folder / "b.bin").write_bytes(flash[: max(cut, 1)])
    for received, sent in (("a.tlog", "b.tlog"), ("b.tlog", "a.tlog"), ("b.tlog", "b.bin")):
        link, problem = None, ""
        try:
            link = read_link(folder / received, folder / sent, receiver_at=HOME)
        except AutopilotLogError as error:
            problem = str(error)
        assert (received in problem or sent in problem) if link is None else np.all(link.distance_m > 0.0)


@given(st.binary(max_size=400))
def test_any_bytes_as_data_flash(data):
    try:
        assert isinstance(read_messages(b"\xa3\x95\x80" + data, "POS"), list)
    except DataflashError:
        pass
    else:
        assert len(data) >= 86
