"""What a run says of its air in the end: its medium, the load on it, waits, delays, and a warning of too much."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from bridge.bus.keys import MAIN
from bridge.record.tables.deliveries import FATES
from bridge.scenario.model import Scenario
from channel.medium.reception import Fate
from lostlink.reading.air.capacity import Capacity, SharedBy, rate_text
from lostlink.reading.air.too_long import TooLong, remark_of, too_long_of, warnings_of
from lostlink.reading.air.use import (
    BUSY_NS,
    NEEDED,
    NS_PER_S,
    Delays,
    FrameColumns,
    Numbers,
    Offered,
    ReceivedBits,
    delays_of,
    edges_of,
    frame_rows,
    frames_of,
    offered_of,
    packet_rows,
    received_of,
)
from lostlink.reading.rows import RUN_ENDED, Deliveries, DeliveryRows

WAITING: Final = (Fate.QUEUE_FULL, Fate.EXPIRED, Fate.REPLACED, Fate.RUN_ENDED)
"""Fates of packets for which there was no time on the air."""
OVERLAPPING_LEAST: Final = 0.05
"""Of all receptions: a run does not warn if fewer were lost as frames overlapped."""
CONTENDING: Final = ("csma", "airtime")
"""Media on which any node may transmit at any time."""
OVERLAPPING: Final = (Fate.COLLIDED, Fate.HALF_DUPLEX)
"""Fates of frames at receivers at which others were at once, or that transmitted themselves."""


@dataclass(frozen=True, slots=True)
class AirAccount:
    """The air of one network over a run.

    Attributes:
        radio: its name, and that of its nodes' radios.
        medium: its name.
        takes_time: whether packets take time on it.
        is_shared: whether all nodes share ``capacity_bps``.
        shared_by: who does: all, or each group or sender has so much.
        packets: given to the radio.
        offered_bps: payload of these.
        capacity_bps: what the network carries of such packets; with `ideal`, what the radio's bit rate could; if not
            all share it, of those of the group or sender with the greatest share. None without packets.
        share: ``offered_bps`` as a share of that; if not all share it, of that group or sender.
        busiest_share: the same in the busiest `BUSY_NS`, whenever these begin.
        ticks_share: of those ticks alone in which several nodes gave packets to the radio, as ``share``; 0 of none.
        overlapping_share: of all receptions, those that were lost as frames were on the air at once (OVERLAPPING).
        is_routed: whether nodes hand packets on, of which the shares above know nothing.
        use_share: of the time in which frames were on the air, added up over senders. None if nothing takes time.
        wait_p50_s, wait_p95_s: from entering the radio to the transmission that decided. None as above.
        delay_p50_s, delay_p95_s: from the sender's stamp to arrival. None as above.
        lost_waiting: receptions for which there was no time on the air.
        waiting_at_end: those of them that were not lost before the run ended.
        replaced: those of them whose place in the queue a newer packet with their key took.
        lost_overlapping: receptions that were lost as frames were on the air at once, where no node waits for others;
            0 where nodes do.
        received_most_bps: payload that one node received in the busiest such time of its own.
        received_most_node: that node; that with the most for its bit rate.
        received_most_share: the same over the bit rate of its radio.
        too_long: packets that were too long to be on the air, by node.
    """

    radio: str
    medium: str
    takes_time: bool
    is_shared: bool
    shared_by: SharedBy
    packets: int
    offered_bps: float
    capacity_bps: float | None
    share: float
    busiest_share: float
    ticks_share: float
    overlapping_share: float
    is_routed: bool
    use_share: float | None
    wait_p50_s: float | None
    wait_p95_s: float | None
    delay_p50_s: float | None
    delay_p95_s: float | None
    lost_waiting: int
    waiting_at_end: int
    replaced: int
    lost_overlapping: int
    received_most_bps: float
    received_most_node: str
    received_most_share: float
    too_long: tuple[TooLong, ...]

    @property
    def is_overloaded(self) -> bool:
        """Whether more was offered than it can carry, and it showed: packets came that could not, or were lost."""
        if self.takes_time:
            is_too_much = self.busiest_share > 1.0 or self._is_filled_by_hops
            return is_too_much and self._lost_in_time + self.lost_overlapping > 0
        return self.busiest_share > 1.0

    @property
    def _is_filled_by_hops(self) -> bool:
        """Whether nodes that hand packets on, and share one air, had frames on it for longer than the run lasted."""
        return self.is_routed and self.is_shared and self.use_share is not None and self.use_share > 1.0

    @property
    def remark(self) -> str:
        """For the line of a verdict."""
        told = [f"{self._network}medium {self.medium}"]
        if self.is_overloaded:
            told.append(
                f"offered {self.busiest_share:.3g} times what it could carry"
                if self.busiest_share > 1.0
                else f"frames of all hops on the air for {self.use_share:.3g} times the run"
            )
        return ", ".join([*told, *filter(None, [remark_of(self.too_long)])])

    @property
    def warnings(self) -> list[str]:
        """What is likely not meant, a sentence each; normally none."""
        too_long = (f"{self._network}{text}" for text in warnings_of(self.too_long, self.medium))
        return [text for text in (self._overload, self._burst, *too_long) if text]

    @property
    def _overload(self) -> str:
        if not self.is_overloaded or self.capacity_bps is None:
            return ""
        if self.busiest_share <= 1.0:
            return (
                f"{self._network}nodes hand packets on (routing), and frames of all hops were on the air of the medium "
                f"{self.medium} for {self.use_share:.3g} times as long as the run lasted: {self._lost}"
            )
        if self.takes_time:
            whose = "" if self.is_shared else f" of one {self.shared_by}"
            return (
                f"{self._network}the nodes offered {rate_text(self.offered_bps)} to the medium {self.medium}, in the "
                f"busiest {BUSY_NS / NS_PER_S:g} s {self.busiest_share:.3g} times the {rate_text(self.capacity_bps)}"
                f"{whose} that it carries of such packets: {self._lost}"
            )
        key = "radio.medium" if self.radio == MAIN else f"networks.{self.radio}.medium"
        return (
            f"{self._network}the medium is ideal, where packets take no time: {self._too_much}; "
            f"give it a medium: {key}"
        )

    @property
    def _burst(self) -> str:
        """Nodes that wait for the same tick collide on an air that is nearly empty."""
        is_full = self.busiest_share <= 1.0 < self.ticks_share
        is_told = is_full and not self.is_routed and self.medium in CONTENDING
        if not is_told or self.overlapping_share < OVERLAPPING_LEAST:
            return ""
        return (
            f"{self._network}nodes transmitted at the same ticks: {self.ticks_share:.3g} times what the medium "
            f"{self.medium} carries in these, though {self.share:.2g} over the run, and "
            f"{100 * self.overlapping_share:.0f} % of the receptions were lost as frames overlapped; lower "
            "tick_rate_hz and transmit.every_ticks alike, or give each node ticks of its own (transmit_package)"
        )

    @property
    def _lost_in_time(self) -> int:
        """Receptions that were lost for want of time on the air while the run lasted."""
        return self.lost_waiting - self.waiting_at_end

    @property
    def _lost(self) -> str:
        if self.lost_overlapping:
            return (
                "no node waits for others there, and "
                f"{self.lost_overlapping} receptions were lost as frames were on the air at once"
            )
        lost = f"{self._lost_in_time} receptions were lost for want of time on the air"
        return f"{lost}, {self.replaced} of them to newer packets with their key" if self.replaced else lost

    @property
    def _network(self) -> str:
        """How a line on a network other than `main` begins."""
        return "" if self.radio == MAIN else f"{self.radio}: "

    @property
    def _too_much(self) -> str:
        """What no radio of that bit rate could have done."""
        times = f"{self.busiest_share:.3g} times what the radio's bit rate carries"
        if self.received_most_share <= 1.0:
            return f"the nodes offered {rate_text(self.offered_bps)}, {times}"
        bit_rate = rate_text(self.received_most_bps / self.received_most_share)
        received = f"node {self.received_most_node} received {rate_text(self.received_most_bps)}"
        return f"{received} over a radio of {bit_rate}, and the nodes offered {times}"

    @property
    def plain(self) -> dict[str, Any]:
        """As `summary.json` has it."""
        return asdict(self)


class AirTally:
    """What the account of a network needs of its rows: little, beside one for each receiver of each packet.

    Args:
        capacity: of the network.
        tick_ns: of the run; 0: the ticks of its packets do not matter.

    Attributes:
        capacity: as given.
    """

    def __init__(self, capacity: Capacity, tick_ns: int = 0) -> None:
        self.capacity = capacity
        self._tick_ns = tick_ns
        self._packets: list[DeliveryRows] = []
        self._frames: list[DeliveryRows] = []
        self._delays: list[Delays] = []
        self._received: list[ReceivedBits] = []
        self._fates = np.zeros(len(FATES), dtype=np.int64)

    def add(self, rows: DeliveryRows) -> None:
        """Rows come, behind those before: of the network, with `NEEDED`, one for each receiver."""
        c = rows.columns
        self._packets.append(packet_rows(rows))
        self._received.append(received_of(rows, self.capacity))
        self._fates += np.rint(np.bincount(c["fate"], c["packets"], len(FATES))).astype(np.int64)
        if self.capacity.takes_time:
            self._frames.append(frame_rows(rows))
            self._delays.append(delays_of(rows))

    def account(self, end_ns: int, on_air_ns: int | None = None) -> AirAccount:
        """The account of the network over a run, of which some rows have come, if none of this network.

        Args:
            end_ns: the end of the run, its last tick included.
            on_air_ns: of all frames, where nodes hand packets on; unless given, as the rows say.
        """
        capacity, packets, offered = self.capacity, self._all_packets, self.offered
        whole = edges_of(end_ns, max(end_ns, 1))
        waits, delays, use = self._times(whole) if capacity.takes_time else (None, None, None)
        if on_air_ns is not None:
            use = on_air_ns / max(end_ns, 1)
        received_bps = ReceivedBits(*map(np.concatenate, zip(*self._received, strict=True))).most_per_s(
            len(packets.nodes), end_ns
        )
        own_bps = {node: radio.config.bit_rate_bps for node, radio in capacity.radios.items()}
        bit_rates_bps = np.array([own_bps.get(node, np.inf) for node in packets.nodes])
        most = int(np.argmax(received_bps / bit_rates_bps))
        capacity_bps, is_own = offered.busiest(whole)
        shared_by: SharedBy = "sender" if is_own else capacity.shared_by
        return AirAccount(
            radio=capacity.network,
            medium=capacity.medium,
            takes_time=capacity.takes_time,
            is_shared=shared_by == "all",
            shared_by=shared_by,
            packets=len(offered.tx),
            offered_bps=float(offered.bits_per_s(whole)[0]),
            capacity_bps=capacity_bps,
            share=float(offered.shares(whole)[0]),
            busiest_share=offered.busiest_share(end_ns),
            ticks_share=offered.share_of_ticks(self._tick_ns) if self._tick_ns else 0.0,
            overlapping_share=self._lost(*OVERLAPPING) / max(int(self._fates.sum()), 1),
            is_routed=on_air_ns is not None,
            use_share=use,
            wait_p50_s=_number(waits, 0),
            wait_p95_s=_number(waits, 1),
            delay_p50_s=_number(delays, 0),
            delay_p95_s=_number(delays, 1),
            lost_waiting=self._lost(*WAITING),
            waiting_at_end=int(self._fates[RUN_ENDED]),
            replaced=self._lost(Fate.REPLACED),
            lost_overlapping=0 if capacity.has_turns else self._lost(*OVERLAPPING),
            received_most_bps=float(received_bps[most]),
            received_most_node=packets.nodes[most],
            received_most_share=float(received_bps[most] / bit_rates_bps[most]),
            too_long=tuple(too_long_of(packets, capacity)),
        )

    @cached_property
    def _all_packets(self) -> DeliveryRows:
        return DeliveryRows.joined(self._packets)

    @cached_property
    def offered(self) -> Offered:
        """Of all rows, when they have come."""
        return offered_of(self._all_packets, self.capacity)

    @cached_property
    def frames(self) -> FrameColumns:
        """Of all rows, when they have come, of a network on which packets take time."""
        return frames_of(DeliveryRows.joined(self._frames))

    @cached_property
    def delays(self) -> Delays:
        """As `frames`."""
        return Delays(*map(np.concatenate, zip(*self._delays, strict=True)))

    def _times(self, whole: Any) -> tuple[Numbers, Numbers, float]:
        """Quantiles of waits and delays over the run, and the use of the air."""
        waits, delays = self.frames.waits(whole)[:, 0], self.delays.over_time(whole)[:, 0]
        return waits, delays, float(self.frames.use(whole)[0])

    def _lost(self, *fates: Fate) -> int:
        return sum(int(self._fates[FATES.index(fate.value)]) for fate in fates)


def tallies_of(deliveries: Deliveries, scenario: Scenario) -> list[AirTally]:
    """Of each radio network of a scenario; none if there are no deliveries."""
    tick_ns = scenario.tick_period_ns
    tallies = {name: AirTally(Capacity.of(scenario, name), tick_ns) for name in scenario.network_names}
    has_any = False
    for rows in deliveries.parts(*NEEDED):
        has_any = has_any or len(rows) > 0
        for name, tally in tallies.items():
            mine = rows.columns["radio"] == name
            tally.add(rows if mine.all() else rows.at(mine))
    return list(tallies.values()) if has_any else []


def _number(values: Numbers | None, row: int) -> float | None:
    return None if values is None or np.isnan(values[row]) else float(values[row])
