"""What UA tell each other."""

from __future__ import annotations

import pytest
from localisation.model import reading
from localisation.wire import PlannedPoint, Shared, SharedEstimate, pack, unpack

SHARED = Shared(
    (
        reading(7, 1, 12_345_678_901, (10.1, -20.2, -40.3), -63.5),
        reading(8, 0, 2**40, (0.0, 0.0, 0.0), -70.0),
    ),
    (SharedEstimate(1, 100.5, -3.25, 25.0, -1.5, 36.0),),
    (PlannedPoint(5, 1.5, 2.5), PlannedPoint(6, 3.5, 4.5)),
)


def test_what_is_told_is_what_was_measured_to_the_bit() -> None:
    assert unpack(pack(SHARED)) == SHARED
    assert unpack(pack(Shared())) == Shared()


@pytest.mark.parametrize(
    "payload", [b"", b"\x01", b"\x02\x00\x00\x00", pack(SHARED)[:-1], pack(SHARED) + b"\x00"]
)
def test_other_bytes_are_no_message(payload: bytes) -> None:
    assert unpack(payload) is None


def test_numbers_that_are_none_are_refused() -> None:
    assert unpack(pack(Shared((reading(1, 0, 0, (0.0, 0.0, 0.0), float("nan")),)))) is None
    assert unpack(pack(Shared(plan=(PlannedPoint(0, float("inf"), 0.0),)))) is None


def test_too_many_of_a_kind_are_refused_by_number() -> None:
    with pytest.raises(ValueError, match="256"):
        pack(Shared(plan=(PlannedPoint(0, 0.0, 0.0),) * 256))
