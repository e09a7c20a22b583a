"""The settings in which lostlink's DCF is held against ns-3's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from math import cos, inf, pi, sin
from typing import NamedTuple

CLOSE_DBM = -50.0
"""Received by all from all, where all are close: a carrier by preamble and energy."""
Place = tuple[float, float]


class By(Enum):
    """What a setting's packets are told apart by."""

    ALL = "all"
    SENDER = "sender"
    PART = "part"


class Count(NamedTuple):
    """Of the packets of one sender that entered its radio in one part of the time, s."""

    offered: int
    transmitted: int
    delivered: int
    delay_sum_s: float


Counts = Mapping[tuple[int, int], Count]
"""By sender and part."""


@dataclass(frozen=True)
class Setting:
    """Stations of 802.11a or b, what they send, and what they hear.

    Attributes:
        places_m: x and y of each node; the last one only listens, unless all send.
        senders: nodes.
        length_bytes: of a packet, without LLC and MAC headers.
        seconds: that are simulated, for each seed.
        to: the node that packets are for; None: all, and the last node counts.
        a_second: packets that enter each sender's radio, a Poisson process; 0: always one waits.
        is_b: 802.11b with acknowledgements at the rate of data, else 802.11a with those at 6 Mb/s.
        rate_mbps: of all data.
        received_dbm: from all by all; None: by distance.
        exponent, transmit_dbm: of the law of distance, 46.6777 dB at 1 m.
        preamble_dbm, energy_dbm: from which a preamble, and any power, is sensed.
        capture_db: a later frame that is stronger by this is received; inf: none is.
        capture_window_us: after a preamble, in which it is, in ns-3; lostlink has no such limit.
        rts: whether unicasts are announced.
        speed_mps: of the last node, along x.
        parts: of the time, counted apart.
        whole_headers: whether headers have no errors in ns-3.
        uses_eifs: in lostlink.
        by: what packets are told apart by.
        note: why the two differ, if they do.
    """

    places_m: tuple[Place, ...]
    senders: tuple[int, ...]
    length_bytes: int
    seconds: float
    to: int | None = None
    a_second: float = 0.0
    is_b: bool = False
    rate_mbps: float = 6.0
    received_dbm: float | None = None
    exponent: float = 3.0
    transmit_dbm: float = 16.0
    preamble_dbm: float = -82.0
    energy_dbm: float = -62.0
    capture_db: float = inf
    capture_window_us: float = 16.0
    rts: bool = False
    speed_mps: float = 0.0
    parts: int = 1
    whole_headers: bool = False
    uses_eifs: bool = True
    by: By = By.ALL
    note: str = ""

    @property
    def observer(self) -> int:
        """Whose receptions count."""
        return len(self.places_m) - 1 if self.to is None else self.to


def close(stations: int, seconds: float, length_bytes: int, **keys: object) -> Setting:
    """Stations about a listener in the middle, all hearing all equally well."""
    turn = 2.0 * pi / stations
    ring = tuple((cos(turn * node), sin(turn * node)) for node in range(stations))
    return Setting(
        (*ring, (0.0, 0.0)),
        tuple(range(stations)),
        length_bytes,
        seconds,
        received_dbm=CLOSE_DBM,
        **keys,  # type: ignore[arg-type]
    )


def hidden(**keys: object) -> Setting:
    """Two that do not hear each other, and a third between them that hears both."""
    return Setting(((-40.0, 0.0), (40.0, 0.0), (0.0, 0.0)), (0, 1), 1000, 20.0, 2, 60.0, **keys)  # type: ignore[arg-type]


def capture(**keys: object) -> Setting:
    """Two that do not hear each other, 7 dB apart at a third between them."""
    places = ((-57.0, 0.0), (33.0, 0.0), (0.0, 0.0))
    given: dict[str, object] = {"a_second": 120.0, "preamble_dbm": -86.0, "by": By.SENDER, **keys}
    return Setting(places, (0, 1), 1000, 20.0, None, **given)  # type: ignore[arg-type]


WINDOW = "ns-3 goes over to a stronger frame only in the first 16 us of the weaker one"
NO_EIFS = "ns-3 waits DIFS after a frame whose header is lost"
SETTINGS: Mapping[str, Setting] = {
    "unicast, 5 saturated, 11a 6": close(5, 4.0, 1500, to=5, uses_eifs=False, note=NO_EIFS),
    "unicast, 5 saturated, 11a 6, EIFS": close(5, 4.0, 1500, to=5, whole_headers=True),
    "unicast, 15 saturated, 11b 11": close(15, 4.0, 1500, to=15, is_b=True, rate_mbps=11.0),
    "broadcast, 2 saturated": close(2, 4.0, 200),
    "broadcast, 10 saturated": close(10, 4.0, 200, uses_eifs=False, note=NO_EIFS),
    "broadcast, 10 saturated, EIFS": close(10, 4.0, 200, whole_headers=True),
    "broadcast, 20 at 50 a second": close(20, 4.0, 200, a_second=50.0),
    "hidden pair": hidden(),
    "hidden pair, RTS": hidden(rts=True),
    "errors": Setting(((0.0, 0.0), (98.37, 0.0)), (0,), 1000, 20.0, 1, 100.0, preamble_dbm=-110.0),
    "capture, none": capture(whole_headers=True),
    "capture, same slot": capture(a_second=0.0, preamble_dbm=-95.0, capture_db=5.0),
    "capture, 5 dB": capture(whole_headers=True, capture_db=5.0, note=WINDOW),
    "moving receiver": Setting(
        ((0.0, 0.0), (50.0, 0.0)),
        (0,),
        200,
        55.0,
        a_second=100.0,
        exponent=2.0,
        transmit_dbm=8.2,
        preamble_dbm=-110.0,
        speed_mps=10.0,
        parts=11,
        by=By.PART,
    ),
}

Figure = Callable[[Count, Setting], float]
FIGURES: Mapping[str, Figure] = {
    "carried, kb/s": lambda count, setting: (
        8e-3 * count.delivered * setting.length_bytes / (setting.seconds / setting.parts)
    ),
    "received per frame": lambda count, _: count.delivered / max(count.transmitted, 1),
    "received of offered": lambda count, _: count.delivered / count.offered,
    "mean delay, ms": lambda count, _: 1e3 * count.delay_sum_s / max(count.delivered, 1),
}


def figures_of(counts: Counts, setting: Setting) -> dict[tuple[str, str], float]:
    """The figures of one seed, by group and name."""
    found = {}
    for group, count in _grouped(counts, setting).items():
        for name in _names(setting):
            found[group, name] = FIGURES[name](count, setting)
    return found


def _names(setting: Setting) -> tuple[str, ...]:
    if setting.by is By.PART:
        return ("received of offered",)
    if not setting.a_second:
        return ("carried, kb/s", "received per frame")
    frames = ("received per frame",) if setting.to is not None else ()
    return (*frames, "received of offered", "mean delay, ms")


def _grouped(counts: Counts, setting: Setting) -> dict[str, Count]:
    groups: dict[str, list[Count]] = {}
    for (sender, part), count in sorted(counts.items()):
        groups.setdefault(_group(sender, part, setting), []).append(count)
    return {
        group: Count(*(sum(column) for column in zip(*found, strict=True)))  # type: ignore[arg-type]
        for group, found in groups.items()
    }


def _group(sender: int, part: int, setting: Setting) -> str:
    if setting.by is By.ALL:
        return ""
    if setting.by is By.SENDER:
        return f"from {abs(setting.places_m[sender][0]):g} m"
    step_m = setting.speed_mps * setting.seconds / setting.parts
    first_m = setting.places_m[-1][0] + part * step_m
    return f"{first_m:g} to {first_m + step_m:g} m"
