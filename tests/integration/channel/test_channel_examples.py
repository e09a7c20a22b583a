"""Every example in the help of the channel's commands runs as it is printed."""

import re
import shlex

import click
import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.channel.fit_coverage import SETS, synthetic_log
from channel.cli.law_plots import PLOTS
from lostlink.cli.main import lostlink
from tests.unit.bridge.record.tables.rows import fleet_columns, write_deliveries

COMMANDS = ("link", "radios", "figures", "laws", "fit")


def examples():
    for name in COMMANDS:
        help_text = lostlink.get_command(click.Context(lostlink), name).help or ""
        lines = re.findall(r"^ *lostlink (.+?)(?:  .*)?$", help_text.partition("Examples:")[2], re.MULTILINE)
        yield from lines


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    log = synthetic_log(SETS["paper-like"], 600, (3,))
    rows = zip(log.distance_m, log.delivered, log.rssi_dbm, strict=True)
    lines = [f"{d:.2f},{int(ok)},{'' if np.isnan(r) else round(r)}" for d, ok, r in rows]
    write_deliveries(folder / "runs" / "20261121T120000Z-separation", list(fleet_columns(2, 300)), 2)
    (folder / "flight.csv").write_text("\n".join(["distance_m,delivered,rssi_dbm", *lines]))
    return folder


def test_every_command_has_examples():
    assert {line.split()[0] for line in examples()} == set(COMMANDS)


LONG = ("figures ", "laws ")
"""The first by a test of what it writes, for one radio of three."""


@pytest.mark.parametrize(
    "line",
    [
        pytest.param(line, marks=[pytest.mark.slow] if line.startswith(LONG) else [])
        for line in examples()
        if ".tlog" not in line
    ],
)
def test_examples_run(line, flight, monkeypatch):
    monkeypatch.chdir(flight)
    if "mine.yaml --ground-distance" in line:
        fit = CliRunner().invoke(lostlink, ["fit", "flight.csv", "--radio", "moon2020", "--out", "mine.yaml"])
        assert fit.exit_code == 0, fit.output
    result = CliRunner().invoke(lostlink, shlex.split(line))
    assert result.exit_code == 0, result.output
    assert result.output.strip()
    if line.startswith("laws "):
        pictures = [*PLOTS, "fading", "shadowing", "line-of-sight"]
        assert result.stdout.splitlines() == [f"laws/{name}.png" for name in pictures]
        assert all((flight / f"laws/{name}.png").read_bytes().startswith(b"\x89PNG") for name in pictures)
