"""Messages round-trip for any content, and no bytes can make the decoder fail otherwise than by DecodeError."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from bridge.bus.messages import (
    AircraftState,
    DataPackage,
    DecodeError,
    Header,
    Message,
    Waypoint,
    decode,
    encode,
    types,
)

TEXT = st.text(max_size=20).filter(lambda text: "\0" not in text)
MESSAGES = [cls for cls in vars(types).values() if hasattr(cls, "TYPE")]
FLOATS = st.floats(allow_nan=False)


@given(
    st.integers(0, 2**31 * 10**9 - 1),
    TEXT,
    st.lists(st.builds(Waypoint, FLOATS, FLOATS, FLOATS), max_size=5).map(tuple),
    st.lists(FLOATS, max_size=5).map(tuple),
    st.integers(0, 65535),
)
def test_any_package_round_trips(
    sim_time_ns: int,
    name: str,
    waypoints: tuple[Waypoint, ...],
    powers: tuple[float, ...],
    frequency_mhz: int,
) -> None:
    package = DataPackage(
        Header.at(sim_time_ns, name), frequency_mhz, AircraftState(mode=name), waypoints, powers
    )
    assert decode(encode(package), DataPackage) == package


@given(st.binary(max_size=400), st.sampled_from(MESSAGES))
def test_arbitrary_bytes_decode_or_are_refused(payload: bytes, cls: type[Message]) -> None:
    try:
        message = decode(payload, cls)
    except DecodeError:
        return
    assert isinstance(message, cls)


@given(st.integers(4, 250), st.integers(0, 255))
def test_mutated_package_decodes_or_is_refused(index: int, value: int) -> None:
    raw = bytearray(encode(DataPackage(waypoints=(Waypoint(), Waypoint()), received_power_dbm=(1.0,))))
    raw[index % len(raw)] = value
    try:
        decode(bytes(raw), DataPackage)
    except DecodeError:
        return
