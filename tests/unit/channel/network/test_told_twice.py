"""A medium of a user's own that has two fates of a packet at a receiver is named."""

from __future__ import annotations

import numpy as np
import pytest

from channel.access.agenda import ACTS
from channel.access.media.plain import PlainMedium
from channel.access.packets import PLAIN
from channel.access.settings.base import Serial, Surroundings
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import Packets
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Network
from channel.own.methods import OwnModelError
from channel.presets import radio_from_mapping
from tests.unit.channel.network.test_band import MS, RADIO, S

NODES = ("a", "b", "c")


class Stammering(PlainMedium):
    """Transmits each packet twice, one frame after the other or at one instant of the outcomes."""

    again_ns = 0

    def _wake(self, node: int) -> None:
        packet = self._next(node)
        if packet is not None:
            self._transmit(packet, lambda: None)
            later = self.agenda.now_ns + self.again_ns
            self.agenda.at(later, ACTS, node, self._transmit, packet, lambda: None)


@pytest.mark.parametrize("again_ns", [100 * MS, 400 * MS])
def test_a_packet_that_is_transmitted_twice_is_told_with_the_mediums_class(again_ns: int) -> None:
    config, settings = radio_from_mapping(RADIO), Serial()
    medium = Medium(Radio(config), seed=7, nodes=NODES)
    for number, node in enumerate(NODES):
        medium.place(node, (50.0 * number, 0.0, -100.0))

    def opened(world: object) -> Stammering:
        around = Surroundings.of(world, medium.index, 7, config, medium.radios[0].noise_floor_dbm)  # type: ignore[arg-type]
        made = Stammering(
            around.world, settings.timings(around), settings.queue.limits, settings.hearing(around)
        )
        made.again_ns = again_ns
        return made

    entry = EntryInstants(NODES, EntrySettings(phase_s=0.0), 50 * MS, medium.draws.common)
    network = Network(medium, opened, entry)
    network.send(Packets(*(np.array([one]) for one in (0, 1, 0, 40, -1))), [PLAIN])
    told = r"^the medium Stammering has two fates of packet 0 of node b at one"
    with pytest.raises(OwnModelError, match=told):
        [network.live(until_ns) for until_ns in (200 * MS, 400 * MS, S)]
