"""A frame whose noise changes while it is on the air: one draw against the product over the pieces."""

from __future__ import annotations

import numpy as np

from channel.access.packets import AirFrame
from channel.access.world import Piece
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.network.link_world import LinkWorld
from channel.numbers.units import db_from_ratio
from channel.presets import load_radio

NODES = ("a", "b")
NS = 1_000_000
DRAWS = 400


def world_of() -> tuple[LinkWorld, Radio]:
    medium = Medium(Radio(load_radio("wifi-2.4")), seed=1, nodes=NODES)
    for number, node in enumerate(NODES):
        medium.place(node, (50.0 * number, 0.0, -40.0))
    return LinkWorld(medium), medium.radios[0]


def test_a_draw_decides_as_the_product_over_all_pieces_does() -> None:
    """The same to the last bit, whichever piece is loudest: also where the draw is next to the error rate."""
    world, radio = world_of()
    rng = np.random.default_rng(1)
    frame = AirFrame(0, 0, "data", 200, 0, NS)
    decided = [0, 0]
    for _ in range(DRAWS):
        pieces = [
            Piece(int(lasts_ns), float(10.0 ** rng.uniform(-1.2, 0.3)))
            for lasts_ns in rng.integers(1, NS, size=4)
        ]
        whole = 1.0
        for lasts_ns, noise_mw in pieces:
            share = 200 * lasts_ns / sum(piece.duration_ns for piece in pieces)
            whole *= 1.0 - float(radio.per_unchecked(db_from_ratio(2.0 / noise_mw), share))
        lost = 1.0 - whole
        for drawn in (lost, np.nextafter(lost, 0.0), np.nextafter(lost, 2.0), rng.uniform()):
            outlasts = world._outlasts(float(drawn), frame, 1, 2.0, pieces)
            assert outlasts == (drawn > lost)
            decided[outlasts] += 1
    assert min(decided) > DRAWS // 2


def test_where_the_loudest_piece_decides_no_other_is_asked() -> None:
    world, _ = world_of()
    frame = AirFrame(0, 0, "data", 200, 0, NS)
    pieces = [Piece(NS // 8, 0.1 * number) for number in range(1, 7)]
    assert not world._outlasts(0.5, frame, 1, 1e-3, [*pieces[:3], Piece(NS // 8, 1e3), *pieces[3:]])
    assert world._per.cache_info().misses == 1
