"""Names of streams are typed in one place, read back, and are safe as files."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.record.names import (
    Kind,
    Stream,
    from_autopilot,
    inputs_path,
    packets,
    report_path,
    streams_of,
    to_autopilot,
)

ALL = {
    "mavlink/0/from_autopilot": from_autopilot("0"),
    "mavlink/0/to_autopilot": to_autopilot("0"),
    "packets/gcs-1.a": packets("gcs-1.a"),
    "modem/gcs-1.a/telemetry/to_modem": Stream(Kind.TO_MODEM, "gcs-1.a", "telemetry"),
    "modem/0/near.2/from_modem": Stream(Kind.FROM_MODEM, "0", "near.2"),
}


@pytest.mark.parametrize(("name", "stream"), ALL.items())
def test_name_and_back(name: str, stream: Stream) -> None:
    assert str(stream) == name
    assert Stream.parse(name) == stream


@pytest.mark.parametrize("node", ["..", "a/b", "", "../x", "a\0", ".hidden", "n" * 201])
def test_unsafe_node_is_refused(node: str) -> None:
    for make in (from_autopilot, to_autopilot, packets):
        with pytest.raises(ValueError, match=r"cannot be part of a key|longer than"):
            make(node)
    for path in (inputs_path, report_path):
        with pytest.raises(ValueError, match=r"cannot be part of a key|longer than"):
            path(Path("run"), node)


@pytest.mark.parametrize(
    "name",
    ["", "packets", "truth/0", "x/0", "mavlink/0", "mavlink/0/truth", "from_autopilot/0", "packets/0/1"],
)
def test_foreign_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="not the name of a stream"):
        Stream.parse(name)


def test_streams_of_a_directory_are_found_and_foreign_ones_refused(tmp_path: Path) -> None:
    assert streams_of(tmp_path) == []
    for stream in ALL.values():
        stream.path(tmp_path).parent.mkdir(parents=True, exist_ok=True)
        stream.path(tmp_path).touch()
    assert [str(stream) for stream in streams_of(tmp_path)] == sorted(ALL)
    (tmp_path / "streams" / "odd.bin").touch()
    with pytest.raises(ValueError, match=r"odd\.bin: 'odd' is not the name"):
        streams_of(tmp_path)
