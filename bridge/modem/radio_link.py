"""From a radio and two tracks to the pair of modems on its links: those of a run, with all that is drawn for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from bridge.modem.heard import HeardWorld
from bridge.modem.ideal import IdealMedium
from bridge.modem.network import Output
from bridge.modem.pair import AIR, ENDS, GROUND, ModemPair
from bridge.modem.settings import counts_foreign, handling_of, modem_of, peers_of
from bridge.modem.tracks import Guide, Track
from channel.access.media.medium import AccessMedium
from channel.access.settings.base import Ideal, Surroundings
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.network.fates import cause_of
from channel.network.link_world import LinkWorld

NODES = ("ground", "air")
AHEAD_NS = 1_000_000_000
"""A frame meets the link at its start, and may meet it until its end: places are told so far ahead."""


@dataclass(frozen=True, slots=True)
class LinkPlan:
    """What a link is made of.

    Attributes:
        radios: of both ends.
        tracks: where they are.
        seed: of all that is drawn.
        bauds: of both serial lines; None: as the modem's firmware has it.
        nodes: what they are called: draws hang on it.
        bases: which of them stand on the ground.
    """

    radios: tuple[Radio, Radio]
    tracks: tuple[Track, Track]
    seed: int = 1
    bauds: tuple[int | None, int | None] = (None, None)
    nodes: tuple[str, str] = NODES
    bases: Sequence[str] = NODES[:1]


class RadioLink:
    """Two modems on the links of a run's channel, at given places.

    Raises:
        ValueError: the medium cannot be that of two nodes.
    """

    def __init__(self, plan: LinkPlan) -> None:
        radios = dict(zip(plan.nodes, plan.radios, strict=True))
        channel = Medium(radios, seed=plan.seed, nodes=plan.nodes, bases=plan.bases)
        self._guide = Guide(channel, plan.tracks)
        floors_dbm = {end: radio.noise_floor_dbm for end, radio in enumerate(plan.radios)}
        configs = {node: radio.config for node, radio in radios.items()}
        settings = plan.radios[GROUND].config.medium
        links, peers = LinkWorld(channel, expects=False, keeps=False), peers_of(settings, plan.nodes)
        world = HeardWorld(links, floors_dbm, peers, counts_foreign=counts_foreign(settings))
        medium: AccessMedium
        if isinstance(settings, Ideal):
            medium = IdealMedium(world)
        else:
            seed, floor_dbm = channel.draws.seed, min(floors_dbm.values())
            medium = settings.open(Surroundings.of(world, channel.index, seed, configs, floor_dbm))
        modems = {end: modem_of(settings, plan.bauds[end], is_transmitter=end == GROUND) for end in ENDS}
        cause, handling = partial(cause_of, world=links), partial(handling_of, settings)
        self.pair = ModemPair(medium, modems, world.heard, cause, handling)

    def receive(self, end: int, data: bytes, at_ns: int) -> None:
        """The host of an end sends bytes from an instant on (`ModemPair.receive`)."""
        self.pair.receive(end, data, at_ns)

    def advance(self, until_ns: int) -> list[Output]:
        """Let the link live up to an instant (`ModemPair.advance`)."""
        self._guide.lead(until_ns + AHEAD_NS)
        return self.pair.advance(until_ns)


__all__ = ["AIR", "GROUND", "NODES", "LinkPlan", "RadioLink"]
