"""Several modems on one medium: each hears all that the radio reaches, and shares its air."""

from __future__ import annotations

from itertools import count

import pytest

from bridge.modem.heard import RadioMeter
from bridge.modem.modem import Modem
from bridge.modem.network import ModemNetwork, OnAir
from bridge.modem.settings import ModemSettings, has_transmitter
from channel.access.media.airtime import AirTime
from channel.access.packets import AirFate, AirPacket
from channel.access.settings.elrs import ElrsMedium
from channel.access.settings.sik import SikMedium
from channel.access.timing import BitRate
from channel.access.world import PlainWorld
from channel.medium.reception import Fate
from tests.unit.bridge.modem.frames import frame_of, heartbeat
from tests.unit.bridge.modem.links import plain_cause

S = 1_000_000_000
RATE_BPS = 8_000


class Net:
    """Modems at nodes of a plain serial medium."""

    def __init__(self, world: PlainWorld, *, packet_bytes: int = 1 << 20) -> None:
        self.medium = AirTime(world, BitRate(RATE_BPS))
        self._numbers = count()
        modem = ModemSettings(packet_bytes=packet_bytes)
        modems = {node: Modem(modem, RadioMeter(), lambda: 0) for node in world.nodes}
        self.network = ModemNetwork(modems, self._offer, plain_cause)

    def _offer(self, node: int, data: bytes, now_ns: int) -> OnAir:
        packet = AirPacket(node, next(self._numbers), None, len(data), now_ns)
        self.medium.offer(packet)
        return OnAir(packet.number, self.medium.receivers_of(packet))

    def live(self, until_ns: int) -> dict[int, bytes]:
        while (at_ns := self.network.next_ns(self.medium.agenda.next_ns)) <= until_ns:
            self.network.listen(int(at_ns) - 1)
            fates = [each for each in self.medium.run(int(at_ns)) if isinstance(each, AirFate)]
            self.network.step(int(at_ns), fates)
        found = dict.fromkeys(self.network.modems, b"")
        for node, out in self.network.outputs(until_ns):
            found[node] += out.data
        return found


def test_all_hear_a_unit_and_nobody_hears_its_own() -> None:
    net = Net(PlainWorld([0, 1, 2]))
    net.network.modems[1].receive(heartbeat(), 0)
    assert net.live(S) == {0: heartbeat(), 1: b"", 2: heartbeat()}
    assert net.network.modems[1].counts.units_sent == 1
    assert net.network.modems[1].counts.units_arrived == 2
    assert net.network.units_under_way == 0


def test_two_at_once_spoil_each_other_at_the_third() -> None:
    net = Net(PlainWorld([0, 1, 2], sinr_min=2.0))
    for node in (0, 1):
        net.network.modems[node].receive(frame_of(100, 0), 0)
    assert net.live(S) == {0: b"", 1: b"", 2: b""}
    assert net.network.modems[0].counts.units_lost == {Fate.HALF_DUPLEX: 1, Fate.COLLIDED: 1}


def test_a_unit_of_several_packets_is_lost_where_one_of_them_is() -> None:
    net = Net(PlainWorld([0, 1, 2], loss=0.3, seed=3), packet_bytes=20)
    frames = [frame_of(60, seq) for seq in range(60)]
    for at_s, frame in enumerate(frames):
        net.network.modems[0].receive(frame, at_s * S)
    out = net.live(100 * S)
    for node in (1, 2):
        whole = [frame for frame in frames if frame in out[node]]
        assert len(out[node]) == sum(map(len, whole))
        assert 60 * 0.7**4 / 3 < len(whole) < 60 * 0.7**2


@pytest.mark.parametrize(("parts", "bytes_out"), [(1, 40), (2, 140), (4, 190), (5, 200)])
def test_the_last_piece_of_a_unit_needs_room_however_often_it_was_tried(parts: int, bytes_out: int) -> None:
    """Of 200 bytes 200 / parts come last, and find room for 40: the pieces before have left by then."""
    settings = ModemSettings(9600, to_host_bytes=40)
    modems = {node: Modem(settings, RadioMeter(), lambda: 0) for node in (0, 1)}
    network = ModemNetwork(modems, lambda node, data, now_ns: OnAir(0, (1,)), plain_cause)
    modems[0].receive(frame_of(200, 0), 0)
    network.step(S, ())
    packet = AirPacket(0, 0, 1, 200, S)
    network.step(2 * S, [AirFate(packet, 1, 2 * S, S, 2 * S, attempts=90, loss=None, parts=parts)])
    assert modems[1].counts.bytes_out == bytes_out


@pytest.mark.parametrize(
    ("medium", "transmitters"),
    [
        (ElrsMedium(), ["0", "2"]),
        (ElrsMedium(pairs=(("gcs", "0"),)), ["gcs"]),
        (SikMedium(), []),
    ],
)
def test_who_has_a_transmitter_module(medium: ElrsMedium | SikMedium, transmitters: list[str]) -> None:
    nodes = ["0", "1", "2", "gcs"]
    assert [node for node in nodes if has_transmitter(medium, nodes, node)] == transmitters
