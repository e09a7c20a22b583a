"""`lostlink judge` of runs that left little."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner

from lostlink.cli.records.judge import judge
from lostlink.flight.exits import UNEXPECTED
from tests.unit.lostlink.replay.flown import flown, scenario_of

WANTED = """expectations:
  - {type: delivery, at_least: 0.5, name: hears}
  - {type: separation, at_least_m: 5, name: apart}
  - {type: age, node: 1, at_most_s: 3, name: fresh}
  - {type: ending, ending: done, name: ends}
"""


def test_a_run_that_broke_off_before_its_first_tick_meets_nothing(tmp_path: Path) -> None:
    scenario = scenario_of("moon2020", ("0", "1"), extra=WANTED)
    run = flown(tmp_path / "made", scenario, ticks=0, killed=True)
    done = CliRunner().invoke(judge, [str(run)])
    assert done.exit_code == UNEXPECTED
    lines = done.stdout.splitlines()
    assert [line.partition(": wanted")[0] for line in lines] == [
        "FAILED: hears",
        "FAILED: apart",
        "FAILED: fresh",
        "FAILED: ends",
    ]
    assert all(line.endswith("found nothing of the kind") for line in lines[:3])
    assert lines[3].endswith("found no end")


def test_a_function_that_raises_is_not_met_and_the_rest_is_judged(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("def breaks(run):\n    return 1 / 0\n")
    wanted = f"""expectations:
  - {{type: function, function: "{tmp_path}/mine.py:breaks", at_most: 1, name: breaks}}
  - {{type: ending, ending: done, name: ends}}
"""
    run = flown(tmp_path / "made", scenario_of("moon2020", ("0", "1"), extra=wanted), ticks=2, killed=True)
    done = CliRunner().invoke(judge, [str(run)])
    assert done.exit_code == UNEXPECTED
    raised, ended = done.stdout.splitlines()
    assert raised.startswith("FAILED: breaks: wanted at most 1, cannot be judged: ")
    assert raised.endswith("mine.py:breaks raised ZeroDivisionError: division by zero")
    assert ended.startswith("FAILED: ends")
