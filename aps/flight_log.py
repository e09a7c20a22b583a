"""What two flight logs say of the radio between them: each packet's distance, whether it arrived, and RSSI.

One log was recorded at the receiving end (.tlog), the other is the sender's own (.tlog, or .bin of its data flash).

- arrived: the sender's MAVLink frames in the first log. Lost: gaps in the sequence numbers of its autopilot, a counter
  of 256; longer silences are filled at the rate of the stream. Lost packets are put evenly between their neighbours.
- where the sender was: GLOBAL_POSITION_INT, POS or GPS of its own log, by its clock since boot. Its positions that
  arrived tie that to the receiver's clock, so that the clocks of the two computers do not matter.
- where the receiver was: GLOBAL_POSITION_INT of another system in the first log, or a place that is given.
- RSSI: RADIO_STATUS (or RADIO) in the first log. Each reading goes to the packet nearest in time, and to no other.

It cannot tell a packet that the sender's router dropped from one that the radio lost, nor what was sent before the
first arrival. Packets without a position of both ends within `MAX_POSITION_AGE_S` are left out.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aps.dataflash import DataflashError, read_messages
from aps.dialect import AUTOPILOT_COMPID, mavlink
from aps.framer import Frame, Framer

__all__ = ["RSSI_SCALES", "FlightLogError", "LinkRecord", "Place", "read_link", "read_tlog"]

FloatArray = NDArray[np.float64]
TIMESTAMP: Final = struct.Struct(">Q")
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
EARTH_RADIUS_M: Final = 6_371_008.8

RSSI_SCALES: Final[dict[str, Callable[[int], float]]] = {
    "sik": lambda raw: raw / 1.9 - 127.0,
    "dbm": lambda raw: float(raw - 256 if raw > 127 else raw),
}
"""What the unit of RADIO_STATUS.rssi may be: SiK's half decibels, or dBm as a signed byte."""


class FlightLogError(ValueError):
    """Logs from which no link can be read; the message names the file."""


@dataclass(frozen=True, slots=True)
class Place:
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

    What is cut off or damaged is left out.

    Raises:
        FlightLogError: no such file, or no frame in it.
    """
    data = _bytes_of(file)
    out: Timed = []
    position = 0
    while position + TIMESTAMP.size < len(data):
        frames = Framer().receive(data[position + TIMESTAMP.size : position + TIMESTAMP.size + 280])
        whole = frames and data.startswith(frames[0].raw, position + TIMESTAMP.size)
        if not whole:
            position += 1
            continue
        out.append((TIMESTAMP.unpack_from(data, position)[0] * 1e-6, frames[0]))
        position += TIMESTAMP.size + len(frames[0].raw)
    if not out:
        raise FlightLogError(f"{file}: no MAVLink frames with times: not a .tlog")
    middle_s = float(np.median([time_s for time_s, _ in out]))
    return [each for each in out if abs(each[0] - middle_s) < LONGEST_LOG_S]


def read_link(
    received: Path,
    sent: Path,
    *,
    sender_sysid: int | None = None,
    receiver_at: Place | None = None,
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
        raise FlightLogError(
            f"{received}: a .bin does not tell what arrived: give the receiver's .tlog first"
        )
    frames = read_tlog(received)
    track, sysid = _senders(sent, frames, received, sender_sysid)
    stream = [
        (time, frame) for time, frame in frames if (frame.sysid, frame.compid) == (sysid, AUTOPILOT_COMPID)
    ]
    if len(stream) < 2:
        raise FlightLogError(f"{received}: no stream of frames from system {sysid}")
    track = _Track(track.time_s + _clock_offset_s(stream, received), track.columns)
    end_s = min(frames[-1][0], float(track.time_s[-1]))
    time_s, length, delivered = _packets(stream, end_s)
    distance_m = _distance_m(track.at(time_s), _receivers(frames, received, sysid, receiver_at, time_s))
    rssi_dbm = _rssi_dbm(frames, sysid, time_s, delivered, RSSI_SCALES[rssi_scale])
    good = np.isfinite(distance_m) & (distance_m > 0.0)
    if not good.any():
        raise FlightLogError(f"{sent}: its positions and those of {received} have no time in common")
    return LinkRecord(time_s[good], distance_m[good], delivered[good], length[good], rssi_dbm[good])


def _bytes_of(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise FlightLogError(f"cannot read {file}: {error.strerror}") from error


def _senders(sent: Path, frames: Timed, received: Path, sysid: int | None) -> tuple[_Track, int]:
    """Return where the sender was by its clock since boot, and its system number."""
    if sent.suffix.lower() == ".bin":
        heard = _systems_with_positions(frames)
        if sysid is None and len(heard) != 1:
            names = ", ".join(map(str, sorted(heard))) or "none"
            raise FlightLogError(f"{received}: which system is the sender's? It has positions of: {names}")
        return _track_of_bin(sent), next(iter(heard)) if sysid is None else sysid
    own = read_tlog(sent)
    counts = _systems_with_positions(own)
    if sysid is None:
        if not counts:
            raise FlightLogError(f"{sent}: no GLOBAL_POSITION_INT")
        sysid = counts.most_common(1)[0][0]
    rows = [(boot_s, *place) for _, boot_s, place in _positions(own, sysid)]
    if not rows:
        raise FlightLogError(f"{sent}: no GLOBAL_POSITION_INT of system {sysid}")
    if any(later[0] < earlier[0] - 1.0 for earlier, later in pairwise(rows)):
        raise FlightLogError(
            f"{sent}: the clock of system {sysid} went back: it was booted anew; cut the log there"
        )
    return _Track.of(rows), sysid


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
    try:
        for name in ("POS", "GPS"):
            rows = [
                tuple(float(message[key]) for key in ("TimeUS", "Lat", "Lng", "Alt"))
                for message in read_messages(_bytes_of(file), name)
            ]
            good = [(us * 1e-6, lat, lon, alt) for us, lat, lon, alt in rows if lat or lon]
            if good:
                return _Track.of(good)
    except (DataflashError, KeyError) as error:
        raise FlightLogError(f"{file}: {error}") from error
    raise FlightLogError(f"{file}: neither POS nor GPS with a position")


def _clock_offset_s(stream: Timed, received: Path) -> float:
    """Return the receiver's time less the sender's time since boot, the median over what arrived."""
    pairs = [time_s - boot_s for time_s, boot_s, _ in _positions(stream, stream[0][1].sysid)]
    if not pairs:
        raise FlightLogError(
            f"{received}: no GLOBAL_POSITION_INT of system {stream[0][1].sysid}: nothing ties its clock to the sender's"
        )
    return float(np.median(pairs))


def _packets(stream: Timed, end_s: float) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return times, lengths and whether they arrived, of all packets of a stream up to an instant."""
    steps = [((b.seq - a.seq) % SEQUENCE, later - earlier) for (earlier, a), (later, b) in pairwise(stream)]
    near = [(step, gap) for step, gap in steps if 0.0 < gap < 1.0 and 0 < step < SEQUENCE // 2]
    seconds = sum(gap for _, gap in near)
    rate_hz = sum(step for step, _ in near) / seconds if seconds > 0.0 else 0.0
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


def _receivers(
    frames: Timed, received: Path, sender: int, given: Place | None, time_s: FloatArray
) -> FloatArray:
    """Return where the receiver was at instants, shape (3, instants)."""
    if given is not None:
        place = np.array([[given.lat_deg], [given.lon_deg], [given.alt_amsl_m]])
        return np.broadcast_to(place, (3, time_s.size))
    others = [(sysid, n) for sysid, n in _systems_with_positions(frames).most_common() if sysid != sender]
    if not others:
        raise FlightLogError(
            f"{received}: no GLOBAL_POSITION_INT but the sender's: say where the receiver stood (LAT,LON,ALT)"
        )
    return _Track.of((time_s, *place) for time_s, _, place in _positions(frames, others[0][0])).at(time_s)


def _distance_m(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the distance between places on a sphere, good to 0.5 % over the ranges of a radio."""
    north = np.radians(second[0] - first[0]) * EARTH_RADIUS_M
    east = (
        np.radians(second[1] - first[1]) * EARTH_RADIUS_M * np.cos(np.radians(0.5 * (first[0] + second[0])))
    )
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
