"""What two flight logs say of the radio between them: each packet's distance, whether it arrived, and RSSI.

One log was recorded at the receiving end (.tlog), the other is the sender's own (.tlog, or .bin of its data flash).

- arrived: the sender's MAVLink frames in the first log. Lost: gaps in the sequence numbers of its autopilot, a counter
  of 256; longer silences are filled at the rate of the stream. Lost packets are put evenly between their neighbours.
- where the sender was: GLOBAL_POSITION_INT, POS or GPS of its own log, by its clock since boot. Its positions that
  arrived tie that to the receiver's clock, so that the clocks of the two computers do not matter.
- where the receiver was: GLOBAL_POSITION_INT of another system in the first log, or a place that is given.
- RSSI: RADIO_STATUS (or RADIO) in the first log. Each reading goes to the packet nearest in time, and to no other.

Packets that the sender's router dropped look like those that the radio lost, and what was sent before the first
arrival is unknown. Packets without a position of both ends within `MAX_POSITION_AGE_S` are left out.
"""

from __future__ import annotations

import math
import struct
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aps.logs.dataflash import DataflashError, read_messages
from aps.wire.dialect import AUTOPILOT_COMPID, mavlink
from aps.wire.framer import (
    CRC_BYTES,
    HEADER_V1_BYTES,
    HEADER_V2_BYTES,
    INCOMPAT_SIGNED,
    MAGIC_V1,
    MAGIC_V2,
    SIGNATURE_BYTES,
    Frame,
    Framer,
)

FloatArray = NDArray[np.float64]
TIMESTAMP: Final = struct.Struct(">Q")
ULOG: Final = b"ULog"
"""What PX4's own logs begin with."""
POSITION: Final = struct.Struct("<Iiii")
RADIO: Final = {int(mavlink.MAVLINK_MSG_ID_RADIO_STATUS), int(mavlink.MAVLINK_MSG_ID_RADIO)}
RADIO_RSSI_OFFSET: Final = 4
"""Behind rxerrors and fixed, in wire order."""
NO_RSSI: Final = 255
GLOBAL_POSITION_INT: Final = int(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
SEQUENCE: Final = 256
MAX_POSITION_AGE_S: Final = 2.0
MAX_RSSI_AGE_S: Final = 1.0
LATE: Final = 16
"""So many steps back, and a frame is a late one or a copy, not one of the next round."""
LONGEST_LOG_S: Final = 86_400.0
"""A time farther off from the others is a damaged one."""
LONGEST_WAY_M: Final = 1_000_000.0
"""A position farther off from the others is a damaged one: a .bin has no checksums."""
RATE_WINDOW_S: Final = 30.0
EARTH_RADIUS_M: Final = 6_371_008.8

RSSI_SCALES: Final[dict[str, Callable[[int], float]]] = {
    "sik": lambda raw: raw / 1.9 - 127.0,
    "dbm": lambda raw: float(raw - 256 if raw > 127 else raw),
}
"""What the unit of RADIO_STATUS.rssi may be: SiK's half decibels, or dBm as a signed byte."""


class AutopilotLogError(ValueError):
    """Logs from which no link can be read; the message names the file."""


@dataclass(frozen=True, slots=True)
class LoggedPlace:
    """A place on Earth: degrees and metres above sea level."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True)
class LinkRecord:
    """One row per packet, in order of time; arrays of one length.

    Attributes:
        time_s: by the receiver's clock.
        distance_m: between the two ends.
        delivered: whether it arrived.
        length_bytes: of the frame; of a lost one, the median of those that arrived.
        rssi_dbm: where a reading fell to it, else NaN.
    """

    time_s: FloatArray
    distance_m: FloatArray
    delivered: NDArray[np.bool_]
    length_bytes: FloatArray
    rssi_dbm: FloatArray


@dataclass(frozen=True, slots=True)
class _Track:
    """Positions over time: seconds, degrees, degrees, metres."""

    time_s: FloatArray
    columns: FloatArray

    @classmethod
    def of(cls, rows: Iterable[tuple[float, float, float, float]]) -> _Track:
        table = np.array(sorted(rows), dtype=np.float64).reshape(-1, 4)
        table[:, 2] = np.unwrap(table[:, 2], period=360.0)  # 179.99 and -179.99 are neighbours
        return cls(table[:, 0], table[:, 1:].T)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return positions at instants, shape (3, instants); NaN where none is near enough in time."""
        out = np.array([np.interp(time_s, self.time_s, column) for column in self.columns])
        after = np.clip(np.searchsorted(self.time_s, time_s), 0, self.time_s.size - 1)
        before = np.maximum(after - 1, 0)
        age = np.minimum(np.abs(self.time_s[after] - time_s), np.abs(time_s - self.time_s[before]))
        out[:, age > MAX_POSITION_AGE_S] = np.nan
        return out


Timed = list[tuple[float, Frame]]


def read_tlog(file: Path) -> Timed:
    """Return the frames of a .tlog with their times in s: 8 bytes of microseconds, big endian, before each frame.

    What is cut off or damaged is left out. A frame whose time alone is damaged, which no checksum shows, gets one
    between those of its neighbours.

    Raises:
        FlightLogError: no such file, or no frame in it.
    """
    data = _bytes_of(file)
    if data.startswith(ULOG):
        raise AutopilotLogError(f"{file}: a ULog, which is not read: give a .tlog of the same flight")
    out: Timed = []
    position = 0
    while position + TIMESTAMP.size < len(data):
        frame = _frame_at(data, position + TIMESTAMP.size)
        if frame is None:
            position += 1
            continue
        out.append((TIMESTAMP.unpack_from(data, position)[0] * 1e-6, frame))
        position += TIMESTAMP.size + len(frame.raw)
    if not out:
        raise AutopilotLogError(f"{file}: no MAVLink frames with times: not a .tlog")
    times_s = _in_order([time_s for time_s, _ in out])
    if not times_s:
        raise AutopilotLogError(f"{file}: its frames have no times before them: not a .tlog")
    middle_s = float(np.median(times_s))
    return [
        (time_s, frame)
        for time_s, (_, frame) in zip(times_s, out, strict=True)
        if abs(time_s - middle_s) < LONGEST_LOG_S
    ]


def _frame_at(data: bytes, start: int) -> Frame | None:
    """Return the frame that begins at this byte, if one does."""
    magic, length, flags = data[start : start + 3].ljust(3, b"\xff")
    if magic not in (MAGIC_V1, MAGIC_V2) or (magic == MAGIC_V2 and flags > INCOMPAT_SIGNED):
        return None
    header = HEADER_V1_BYTES if magic == MAGIC_V1 else HEADER_V2_BYTES
    signature = SIGNATURE_BYTES if magic == MAGIC_V2 and flags else 0
    size = header + length + CRC_BYTES + signature
    frames = Framer(trusting=True).receive(data[start : start + size])
    return frames[0] if frames and len(frames[0].raw) == size else None


def _in_order(times_s: list[float]) -> list[float]:
    """Return times that never fall: the fewest that stand in the way are put between their neighbours.

    None at all if these are more than half: then there are no times, but other bytes in their place.
    """
    last: list[float] = []
    """Of each length, the lowest end of a run that never falls."""
    ends: list[int] = []
    before = []
    for index, time_s in enumerate(times_s):
        length = bisect_right(last, time_s)
        before.append(ends[length - 1] if length else -1)
        last[length : length + 1] = [time_s]
        ends[length : length + 1] = [index]
    kept = [ends[-1]]
    while before[kept[-1]] >= 0:
        kept.append(before[kept[-1]])
    good = kept[::-1]
    if 2 * len(good) < len(times_s):
        return []
    ordered: list[float] = np.interp(np.arange(len(times_s)), good, np.array(times_s)[good]).tolist()
    return ordered


def read_link(
    received: Path,
    sent: Path,
    *,
    sender_sysid: int | None = None,
    receiver_at: LoggedPlace | None = None,
    rssi_scale: str = "sik",
) -> LinkRecord:
    """Read the radio link from a sender to a receiver out of their logs.

    Args:
        received: .tlog recorded at the receiving end.
        sent: the sender's own .tlog or .bin.
        sender_sysid: MAVLink system of the sender, if the logs have several.
        receiver_at: where the receiver stood, if its log has no positions of its own.
        rssi_scale: a name of `RSSI_SCALES`.

    Raises:
        FlightLogError: a file that cannot be read, or lacks what is needed; the message says what.
    """
    if received.suffix.lower() == ".bin":
        raise AutopilotLogError(
            f"{received}: a .bin does not show what arrived: give the receiver's .tlog first"
        )
    frames = read_tlog(received)
    track, sysid = _senders(sent, frames, received, sender_sysid)
    stream = [
        (time, frame) for time, frame in frames if (frame.sysid, frame.compid) == (sysid, AUTOPILOT_COMPID)
    ]
    if len(stream) < 2:
        raise AutopilotLogError(f"{received}: no stream of frames from system {sysid}")
    track = _Track(track.time_s + _clock_offset_s(stream, received), track.columns)
    end_s = min(frames[-1][0], float(track.time_s[-1]))
    time_s, length, delivered = _packets(stream, end_s)
    distance_m = _distance_m(track.at(time_s), _receivers(frames, received, sysid, receiver_at, time_s))
    rssi_dbm = _rssi_dbm(frames, sysid, time_s, delivered, RSSI_SCALES[rssi_scale])
    good = np.isfinite(distance_m) & (distance_m > 0.0)
    if not good.any():
        raise AutopilotLogError(f"{sent}: its positions and those of {received} have no time in common")
    return LinkRecord(time_s[good], distance_m[good], delivered[good], length[good], rssi_dbm[good])


def _bytes_of(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise AutopilotLogError(f"cannot read {file}: {error.strerror}") from error


def _senders(sent: Path, frames: Timed, received: Path, sysid: int | None) -> tuple[_Track, int]:
    """Return where the sender was by its clock since boot, and its system number."""
    if sent.suffix.lower() == ".bin":
        heard = _systems_with_positions(frames)
        if sysid is None and len(heard) != 1:
            names = ", ".join(map(str, sorted(heard))) or "none"
            raise AutopilotLogError(f"{received}: which system is the sender's? It has positions of: {names}")
        return _track_of_bin(sent), next(iter(heard)) if sysid is None else sysid
    own = read_tlog(sent)
    counts = _systems_with_positions(own)
    if sysid is None:
        if not counts:
            raise AutopilotLogError(f"{sent}: no GLOBAL_POSITION_INT")
        sysid = counts.most_common(1)[0][0]
    rows = [(boot_s, *place) for _, boot_s, place in _positions(own, sysid)]
    if not rows:
        raise AutopilotLogError(f"{sent}: no GLOBAL_POSITION_INT of system {sysid}")
    _check_one_boot(sent, sysid, [boot_s for boot_s, *_ in rows])
    return _Track.of(rows), sysid


def _check_one_boot(file: Path, sysid: int, boot_s: Sequence[float]) -> None:
    """Refuse a log in which a system's time since boot begins again.

    Raises:
        AutopilotLogError: it does.
    """
    if any(later < earlier - 1.0 for earlier, later in pairwise(boot_s)):
        raise AutopilotLogError(
            f"{file}: the clock of system {sysid} went back: it was booted anew, or frames came late; cut the log there"
        )


def _systems_with_positions(frames: Timed) -> Counter[int]:
    return Counter(
        frame.sysid
        for _, frame in frames
        if frame.msg_id == GLOBAL_POSITION_INT and frame.compid == AUTOPILOT_COMPID
    )


def _positions(frames: Timed, sysid: int) -> list[tuple[float, float, tuple[float, float, float]]]:
    """Return log time in s, time since boot in s, and degrees, degrees, metres of each position of a system."""
    out = []
    for time_s, frame in frames:
        if frame.msg_id == GLOBAL_POSITION_INT and frame.sysid == sysid and frame.compid == AUTOPILOT_COMPID:
            boot_ms, lat, lon, alt_mm = POSITION.unpack_from(frame.payload.ljust(POSITION.size, b"\0"))
            if lat or lon:
                out.append((time_s, boot_ms * 1e-3, (lat * 1e-7, lon * 1e-7, alt_mm * 1e-3)))
    return out


def _track_of_bin(file: Path) -> _Track:
    """Return the positions of a data flash log: POS (the estimator's), or GPS if it has none."""
    data = _bytes_of(file)
    for name in ("POS", "GPS"):
        try:
            messages = read_messages(data, name)
            rows = [
                tuple(float(message[key]) for key in ("TimeUS", "Lat", "Lng", "Alt")) for message in messages
            ]
        except DataflashError as error:
            raise AutopilotLogError(f"{file}: {error}") from error
        except (KeyError, ValueError) as error:
            raise AutopilotLogError(f"{file}: {name} without numbers TimeUS, Lat, Lng, Alt") from error
        good = _plausible([(us * 1e-6, lat, lon, alt) for us, lat, lon, alt in rows if lat or lon])
        if good:
            return _Track.of(good)
    raise AutopilotLogError(f"{file}: neither POS nor GPS with a position")


def _plausible(rows: list[tuple[float, float, float, float]]) -> list[tuple[float, float, float, float]]:
    """Return the positions with times and places near those of most others."""
    if not rows:
        return []
    table = np.array(rows).T
    middle = np.nanmedian(table, axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        near = _distance_m(table[1:], middle[1:, np.newaxis]) < LONGEST_WAY_M
        near &= np.abs(table[0] - middle[0]) < LONGEST_LOG_S
    return [row for row, good in zip(rows, near, strict=True) if good]


def _clock_offset_s(stream: Timed, received: Path) -> float:
    """Return the receiver's time less the sender's time since boot, the median over what arrived."""
    sysid = stream[0][1].sysid
    times = [(time_s, boot_s) for time_s, boot_s, _ in _positions(stream, sysid)]
    if not times:
        raise AutopilotLogError(
            f"{received}: no GLOBAL_POSITION_INT of system {sysid}: nothing ties its clock to the sender's"
        )
    _check_one_boot(received, sysid, [boot_s for _, boot_s in times])
    return float(np.median([time_s - boot_s for time_s, boot_s in times]))


def _packets(stream: Timed, end_s: float) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return times, lengths and whether they arrived, of all packets of a stream up to an instant."""
    rate_hz = _rate_hz(stream)
    rows = [(stream[0][0], float(len(stream[0][1].raw)), True)]
    last_s, last_seq = stream[0][0], stream[0][1].seq
    for time_s, frame in stream[1:]:
        step, gap_s = (frame.seq - last_seq) % SEQUENCE, time_s - last_s
        expected = rate_hz * gap_s
        if (step == 0 or step > SEQUENCE - LATE) and expected < SEQUENCE // 2:
            continue
        step += SEQUENCE * max(round((expected - step) / SEQUENCE), 0)
        rows += [(last_s + gap_s * k / step, math.nan, False) for k in range(1, step)]
        rows.append((time_s, float(len(frame.raw)), True))
        last_s, last_seq = time_s, frame.seq
    silent = int(max(end_s - last_s, 0.0) * rate_hz)
    rows += [(last_s + k / rate_hz, math.nan, False) for k in range(1, silent + 1)]
    time, length, delivered = (np.array(column) for column in zip(*rows, strict=True))
    return time, np.where(np.isfinite(length), length, np.nanmedian(length)), delivered


def _rate_hz(stream: Timed) -> float:
    """Return how many packets a second were sent, lost ones included: the median over windows of 30 s.

    Over windows, because packets may come in bursts with all the silence between them; not over those with a long
    silence, from which rounds of the counter may be missing.
    """
    times, counts = [stream[0][0]], [0]
    last_seq = stream[0][1].seq
    for time_s, frame in stream[1:]:
        step = (frame.seq - last_seq) % SEQUENCE
        if 0 < step <= SEQUENCE - LATE:
            times.append(time_s)
            counts.append(counts[-1] + step)
            last_seq = frame.seq
    time, count = np.array(times), np.array(counts)
    end = np.minimum(np.searchsorted(time, time + RATE_WINDOW_S), time.size - 1)
    seconds = time[end] - time
    silences = np.cumsum(np.diff(time, prepend=time[0]) > RATE_WINDOW_S / 3.0)
    whole = (seconds > 0.0) & (seconds >= min(RATE_WINDOW_S, time[-1] - time[0]))
    unbroken = whole & (silences[end] == silences)
    chosen = unbroken if unbroken.any() else whole
    return float(np.median((count[end] - count)[chosen] / seconds[chosen])) if chosen.any() else 0.0


def _receivers(
    frames: Timed, received: Path, sender: int, given: LoggedPlace | None, time_s: FloatArray
) -> FloatArray:
    """Return where the receiver was at instants, shape (3, instants)."""
    if given is not None:
        place = np.array([[given.lat_deg], [given.lon_deg], [given.alt_amsl_m]])
        return np.broadcast_to(place, (3, time_s.size))
    others = [(sysid, n) for sysid, n in _systems_with_positions(frames).most_common() if sysid != sender]
    if not others:
        raise AutopilotLogError(
            f"{received}: no GLOBAL_POSITION_INT but the sender's: say where the receiver stood (LAT,LON,ALT)"
        )
    return _Track.of((time_s, *place) for time_s, _, place in _positions(frames, others[0][0])).at(time_s)


def _distance_m(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the distance between places on a sphere, good to 0.5 % over the ranges of a radio."""
    north = np.radians(second[0] - first[0]) * EARTH_RADIUS_M
    east_deg = (second[1] - first[1] + 180.0) % 360.0 - 180.0
    east = np.radians(east_deg) * EARTH_RADIUS_M * np.cos(np.radians(0.5 * (first[0] + second[0])))
    return np.asarray(np.sqrt(north**2 + east**2 + (second[2] - first[2]) ** 2))


def _rssi_dbm(
    frames: Timed,
    sender: int,
    time_s: FloatArray,
    delivered: NDArray[np.bool_],
    scale: Callable[[int], float],
) -> FloatArray:
    """Return the readings of the receiver's radio, each at the packet that arrived nearest to it in time."""
    out = np.full(time_s.size, np.nan)
    arrived = np.flatnonzero(delivered)
    for at_s, frame in frames:
        if frame.msg_id not in RADIO or frame.sysid == sender:
            continue
        raw = frame.payload.ljust(RADIO_RSSI_OFFSET + 1, b"\0")[RADIO_RSSI_OFFSET]
        nearest = arrived[np.argmin(np.abs(time_s[arrived] - at_s))]
        if raw not in (0, NO_RSSI) and abs(time_s[nearest] - at_s) <= MAX_RSSI_AGE_S:
            out[nearest] = scale(raw)
    return out
