"""Where the ends of a link are: files of distances, and what a medium is told of them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bridge.modem.tracks import Guide, apart_over_time, read_distances
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import load_radio

S = 1_000_000_000


def test_the_air_goes_along_its_rows_linearly() -> None:
    medium = Medium(Radio(load_radio("perfect")), seed=1, nodes=("ground", "air"))
    rows = [(0.0, 100.0), (10.0, 300.0), (20.0, 200.0), (30.0, 500.0)]
    guide = Guide(medium, apart_over_time(rows, (2.0, 50.0)))
    for at_s in (0.0, 2.5, 10.0, 15.0, 29.0, 30.0, 60.0):
        guide.lead(int(at_s * S))
        north_m, east_m, down_m = medium.at(int(at_s * S)).position_ned_m.reshape(3, 2)
        expected_m = np.interp(at_s, [row[0] for row in rows], [row[1] for row in rows])
        assert north_m.tolist() == pytest.approx([0.0, expected_m])
        assert (east_m.tolist(), down_m.tolist()) == ([0.0, 0.0], [-2.0, -50.0])


def test_rows_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "away.csv"
    file.write_text("distance_m,note,time_s\n100,,0\n250.5,far,12.5\n")
    assert read_distances(file) == [(0.0, 100.0), (12.5, 250.5)]


def test_a_file_as_spreadsheets_write_it(tmp_path: Path) -> None:
    file = tmp_path / "away.csv"
    file.write_bytes(b"\xef\xbb\xbftime_s,distance_m\r\n0,100\r\n")
    assert read_distances(file) == [(0.0, 100.0)]
    file.write_bytes("time_s,distance_m\n0,100\n".encode("utf-16"))
    with pytest.raises(ValueError, match=r"away\.csv: no text in UTF-8"):
        read_distances(file)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,100\n", r"away\.csv:1: the first line has to name the columns time_s, distance_m"),
        ("time_s,distance_m\n", "no row below"),
        ("time_s,distance_m\n0,100\n5,far\n", r"away\.csv:3: .* have to be numbers"),
        ("time_s,distance_m\n0,100\n5\n", r"away\.csv:3: .* have to be numbers"),
        ("time_s,distance_m\n0,100\n0,200\n", r"away\.csv:3: 0 s does not come after 0 s"),
        ("time_s,distance_m\n0,-1\n", r"away\.csv:2: 0 s, -1 m: from 0 to 1e\+09 s and 1e\+09 m"),
        ("time_s,distance_m\n0,nan\n", r"away\.csv:2: "),
        ("time_s,distance_m\n0,100,5\n", r"away\.csv: .* line 2 has 3 fields under 2 headings"),
        ("time_s,distance_m,time_s\n0,100,5\n", r"away\.csv: .* it has 2 columns time_s"),
        (f"time_s,distance_m\n{'9' * 200_000},1\n", r"away\.csv: .* field larger than"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "away.csv"
    file.write_text(text)
    with pytest.raises(ValueError, match=said):
        read_distances(file)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([], "distances: no row"),
        ([(10.0, 100.0), (0.0, 200.0)], "distances.1: 0 s does not come after 10 s"),
        ([(0.0, -5.0)], "distances.0: 0 s, -5 m"),
        ([(float("inf"), 5.0)], "distances.0: inf s, 5 m"),
        ([(0.0, float("nan"))], "distances.0: 0 s, nan m"),
    ],
)
def test_rows_given_in_python_are_looked_at_as_those_of_a_file(
    rows: list[tuple[float, float]], said: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        apart_over_time(rows, (2.0, 50.0))
