"""What is known of each link at a tick of a record: its newest packet, and counts from the run's beginning on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bridge.bus.messages import Links
from bridge.radio.picture import Picture
from bridge.record.tables.deliveries import FATES, GAPS_FROM
from bridge.record.tables.schema import Columns
from channel.medium.stations.switches import Switches


class KnownLinks:
    """What a run knew by a tick, from its deliveries.

    Args:
        nodes: their ids.
        networks: names of the radio networks, by which rows name them.
        radios: when each one's was off.

    Attributes:
        picture: of the newest packets.
    """

    def __init__(self, nodes: Sequence[str], networks: Sequence[str], radios: Switches) -> None:
        self.picture = Picture(nodes, networks)
        self._settled = np.zeros((len(networks), len(nodes), len(nodes), len(FATES)), dtype=np.int64)
        self._radios = radios

    def take(self, columns: Columns) -> None:
        """Take rows, one per receiver, as a run does: what was lost before the channel counts, and is in no picture."""
        counted = columns["radio"], columns["tx"], columns["rx"], columns["fate"]
        packets = columns["packets"].astype(np.int64)  # that of the sums: else numpy takes five times as long
        np.add.at(self._settled, counted, packets)
        settled = columns["fate"] < GAPS_FROM
        self.picture.take({name: values[settled] for name, values in columns.items()})

    def report(self, sim_time_ns: int) -> Links:
        """All links that carried a packet: the latest figures, and the counts."""
        return self.picture.links(sim_time_ns, [*self._settled], self._radios.off_at(sim_time_ns))
