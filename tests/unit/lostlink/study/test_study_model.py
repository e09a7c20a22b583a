"""Studies: what their files say, which runs that makes, and what becomes of values in the table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from lostlink.study.case_process import CasePlan
from lostlink.study.cases import cases_of
from lostlink.study.metrics import load, own
from lostlink.study.model import Function, StudyError, read_study, study_from
from lostlink.study.table import _of_one_kind, write_table

AGENT = "from bridge.agents.agent import Agent\n\n\nclass Mine(Agent):\n    pass\n"


def write(folder: Path, text: str, scenario: str = "separation") -> Path:
    file = folder / "study.yaml"
    file.write_text(f"schema: 1\nname: mine\nscenario: {scenario}\n{text}", encoding="utf-8")
    return file


def cases(folder: Path, text: str, scenario: str = "separation"):
    file = write(folder, text, scenario)
    return cases_of(read_study(file), folder)


def test_every_combination_is_a_run_and_seeds_vary_fastest(tmp_path):
    runs = cases(
        tmp_path,
        "seeds: [3, 4]\nvary: {radio: [moon2020, corrected], nodes.1.agent.distance_m: [300, 600]}\n",
    )
    assert [
        (run.labels["radio"], run.labels["nodes.1.agent.distance_m"], run.labels["seed"]) for run in runs
    ] == [
        (radio, distance, seed)
        for radio in ("moon2020", "corrected")
        for distance in (300, 600)
        for seed in (3, 4)
    ]
    assert [run.scenario.seed for run in runs] == [3, 4] * 4
    assert runs[-1].scenario.radio == "corrected"
    assert runs[0].scenario.ua[1].agent.distance_m == 300


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ("{from: 0.5, to: 3.0, count: 3}", [0.5, 1.75, 3.0]),
        ("{count: 4, from: 0.1, to: 0.4}", [0.1, 0.2, 0.3, 0.4]),
        ("{from: 0.1, to: -0.1, count: 3}", [0.1, 0.0, -0.1]),
        ("{from: 1, to: 2, count: 3}", [1.0, 1.5, 2.0]),
        ("{from: 300, to: 700, count: 3}", [300, 500, 700]),
    ],
)
def test_numbers_in_a_row_are_varied_from_one_to_another(tmp_path, words, values):
    study = read_study(write(tmp_path, f"vary: {{nodes.1.home.north_m: {words}}}\n"))
    assert study.vary == {"nodes.1.home.north_m": {str(value): value for value in values}}
    assert {type(value) for value in study.vary["nodes.1.home.north_m"].values()} == {type(values[0])}
    labels = [case.labels["nodes.1.home.north_m"] for case in cases_of(study, tmp_path)]
    assert labels == values


def test_labels_may_be_called_as_the_ends_of_a_range(tmp_path):
    text = "vary: {radio: {from: moon2020, to: corrected}}\n"
    assert [run.labels["radio"] for run in cases(tmp_path, text)] == ["from", "to"]


def test_cases_change_several_values_together_and_win_over_those_of_all_runs(tmp_path):
    runs = cases(
        tmp_path,
        "set: {duration_s: 30, tick_rate_hz: 10}\n"
        "cases: {far: {radio: corrected, duration_s: 40}, near: {radio: moon2020}}\n",
    )
    assert [(run.labels["case"], run.scenario.duration_s, run.scenario.radio) for run in runs] == [
        ("far", 40, "corrected"),
        ("near", 30, "moon2020"),
    ]
    assert {run.scenario.tick_rate_hz for run in runs} == {10}


def test_runs_are_flown_as_fast_as_possible_unless_the_study_says_otherwise(tmp_path):
    assert cases(tmp_path, "")[0].scenario.speed == "max"
    assert cases(tmp_path, "set: {speed: 2}")[0].scenario.speed == 2


def test_runs_write_what_the_study_keeps_unless_it_says_otherwise(tmp_path):
    def written(text):
        (run,) = cases(tmp_path, text)
        scenario = run.scenario
        return run.id, (scenario.hosts, scenario.figure, scenario.mcap.write, scenario.mavlink.tlog)

    kept = written("keep: all\n")
    failed = written("keep: failed\n")
    said = written("keep: failed\nset: {hosts: 2, mcap.write: true, mavlink: {tlog: true}, figure: true}\n")
    assert (kept[1], failed[1]) == (("auto", False, True, True), ("auto", False, False, False))
    assert said[1] == (2, True, True, True)
    assert kept[0] == failed[0] == said[0]  # the same run


def test_seeds_in_a_row(tmp_path):
    assert [run.scenario.seed for run in cases(tmp_path, "seeds: {first: 7, count: 3}")] == [7, 8, 9]


def test_labels_may_stand_for_values(tmp_path):
    runs = cases(
        tmp_path, "vary: {radio: {quiet: {preset: corrected, noise: {noise_figure_db: 3}}, plain: corrected}}"
    )
    assert [run.labels["radio"] for run in runs] == ["quiet", "plain"]


def test_numbers_that_vary_come_back_as_numbers(tmp_path):
    runs = cases(
        tmp_path,
        "vary: {nodes.1.agent.speed_mps: [5, 7.5], nodes.1.agent.distance_m: {near: 300, 600: 600}, zenoh: [true]}\n",
    )
    write_table([run.labels for run in runs], tmp_path / "table.parquet")
    table = pq.read_table(tmp_path / "table.parquet").to_pydict()
    assert table["nodes.1.agent.speed_mps"] == [5.0, 5.0, 7.5, 7.5]
    assert table["nodes.1.agent.distance_m"] == ["near", "600"] * 2  # some have labels: text, all of them
    assert table["zenoh"] == [True] * 4


def test_numbers_and_truth_values_that_vary_together_come_back_as_text(tmp_path):
    gain = AGENT.replace("    pass\n", "    async def fly(self):\n        self.gain = self.options['gain']\n")
    (tmp_path / "mine.py").write_text(gain, encoding="utf-8")
    runs = cases(
        tmp_path,
        "set: {nodes.0.agent: {type: own, class: mine.py:Mine}}\nvary: {nodes.0.agent.options.gain: [false, 0.5]}\n",
    )
    assert [run.labels["nodes.0.agent.options.gain"] for run in runs] == ["False", "0.5"]
    write_table([run.labels for run in runs], tmp_path / "table.parquet")


def test_a_run_is_called_what_its_scenario_is_called(tmp_path):
    (tmp_path / "mine.yaml").write_text("schema: 1\nextends: separation\nname: far-apart\n")
    (tmp_path / "other.yaml").write_text("schema: 1\nextends: separation\n")
    runs = cases(tmp_path, "", scenario="[mine.yaml, separation]")
    assert [run.labels["scenario"] for run in runs] == ["far-apart", "separation"]
    with pytest.raises(StudyError, match=r"other.yaml and separation are both called separation"):
        cases(tmp_path, "", scenario="[other.yaml, separation]")


def test_the_same_run_has_the_same_id_and_another_another(tmp_path):
    first = cases(tmp_path, "seeds: [1, 2]")
    again = cases(tmp_path, "seeds: [2, 5]\nset: {hosts: 1}")
    assert first[1].id == again[0].id
    assert len({run.id for run in (*first, *again)}) == 3


def test_other_code_of_an_agent_is_another_run(tmp_path):
    agent = tmp_path / "mine.py"
    agent.write_text(AGENT, encoding="utf-8")
    text = "set: {nodes.0.agent: {type: own, class: mine.py:Mine}}"
    before = cases(tmp_path, text)[0].id
    assert cases(tmp_path, text)[0].id == before
    agent.write_text(AGENT + "\n# other\n", encoding="utf-8")
    assert cases(tmp_path, text)[0].id != before


def test_other_code_of_a_module_that_an_agent_imports_is_another_run(tmp_path):
    (tmp_path / "mine.py").write_text("import numpy\nfrom parts.way import way\n" + AGENT, encoding="utf-8")
    (tmp_path / "parts").mkdir()
    for name in ("parts/__init__.py", "parts/way.py", "parts/law.py", "figures.py"):
        (tmp_path / name).write_text(
            "from . import law\n" if name == "parts/way.py" else "", encoding="utf-8"
        )
    text = "set: {nodes.0.agent: {type: own, class: mine.py:Mine}}"
    ids = [cases(tmp_path, text)[0].id]
    for name in ("figures.py", "parts/law.py", "parts/__init__.py", "parts/way.py"):
        with (tmp_path / name).open("a", encoding="utf-8") as file:
            file.write("# other\n")
        ids.append(cases(tmp_path, text)[0].id)
    assert ids[1] == ids[0]  # nobody imports it
    assert len(set(ids)) == 4


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Modules in a package of Python's path, which is not beside the study."""
    folder = tmp_path / "elsewhere" / "flocking_here"
    folder.mkdir(parents=True)
    monkeypatch.syspath_prepend(folder.parent)
    (folder / "__init__.py").write_text("", encoding="utf-8")
    (folder / "agent.py").write_text("from flocking_here import rules\n" + AGENT, encoding="utf-8")
    (folder / "rules.py").write_text("def measure(run):\n    return {}\n", encoding="utf-8")
    return folder


@pytest.mark.parametrize("name", ["flocking_here.agent:Mine", "shim.py:Mine"])
def test_other_code_of_a_package_on_the_path_is_another_run(tmp_path, package, name):
    (tmp_path / "shim.py").write_text("from flocking_here.agent import Mine\n", encoding="utf-8")
    text = f"set: {{nodes.0.agent: {{type: own, class: '{name}'}}}}"
    ids = [cases(tmp_path, text)[0].id]
    for module in ("agent.py", "rules.py", "__init__.py"):
        with (package / module).open("a", encoding="utf-8") as file:
            file.write("# other\n")
        ids.append(cases(tmp_path, text)[0].id)
    assert len(set(ids)) == 4


@pytest.mark.parametrize("place", ["own.py", "flocking_here.rules"])
def test_other_code_of_a_package_that_a_metric_imports_measures_anew(tmp_path, package, place):
    (tmp_path / "own.py").write_text("from flocking_here.rules import measure\n", encoding="utf-8")
    (one,) = read_study(write(tmp_path, f"metrics: '{place}:measure'\n")).metrics
    plan = CasePlan("", (one,), "all")
    before = plan.measures
    with (package / "rules.py").open("a", encoding="utf-8") as file:
        file.write("# other\n")
    assert plan.measures != before
    assert load(one)(None) == {}
    plan.write(tmp_path)
    assert CasePlan.read(tmp_path) == plan


def test_other_code_of_a_module_that_a_metric_imports_measures_anew(tmp_path):
    (tmp_path / "own.py").write_text("import law\n\n\ndef measure(run):\n    return {}\n", encoding="utf-8")
    (tmp_path / "law.py").write_text("", encoding="utf-8")
    plan = CasePlan("", (Function(place=str(tmp_path / "own.py"), name="measure"),), "all")
    before = plan.measures
    (tmp_path / "law.py").write_text("# other\n", encoding="utf-8")
    assert plan.measures != before


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("sedes: 3\n", "yaml:4: sedes: unknown key; did you mean seeds\\?"),
        ("seeds: []\n", "seeds: .*at least one"),
        ("seeds: [1, 1]\n", "seeds: .*each once"),
        ("vary: {radio: []}\n", "radio has no values"),
        ("vary: {radio.base_loss: 0.3}\n", "vary: radio.base_loss has to be a list of values, .*got 0.3"),
        ("metrics: flocking_nowhere.rules:f\n", "metrics: .*no module flocking_nowhere.rules"),
        ("metrics: mine.py\n", "metrics: has to be FILE.py:FUNCTION"),
        ("metrics: nothing.py:f\n", "nothing.py: no such file"),
        ("keep: some\n", "yaml:4: keep: has to be 'all', 'failed' or 'none' \\(got 'some'\\)"),
        ("set: {a: 2020-13-45}\n", "is not YAML: month must be in 1..12"),
        ("seeds: 3\nseeds: 4\n", "yaml:5: seeds: given twice, before on line 4"),
        ("vary: {x: [1, '1']}\n", "vary: .*x has the value 1 more than once"),
        ("vary: {x: [1, 1.0]}\n", "vary: .*x has the value 1.0 more than once"),
        ("vary: {x: [1.0, true, 1]}\n", "vary: .*x has the value 1 more than once"),
        (
            "vary: {duration_s: {from: 1, to: 3, step: 1}}\n",
            "vary: .*duration_s: from, to, step .*{from: 0.5, to:",
        ),
        (
            "vary: {duration_s: {first: 1, count: 3}}\n",
            "vary: .*duration_s: first, count are not taken for labels",
        ),
        (
            "vary: {duration_s: {from: 1, to: 3 m, count: 3}}\n",
            "vary: .*from, to, count are not taken for labels",
        ),
        ("vary: {duration_s: {from: 1, to: 3, count: 1}}\n", "vary: .*a count of 2 or more"),
        ("vary: {duration_s: {from: 1, to: 3, count: 2.5}}\n", "vary: .*a count of 2 or more"),
        (
            f"vary: {{duration_s: {{from: 1, to: {10**400}, count: 3}}}}\n",
            "vary: duration_s: from, to, count are not taken for labels",
        ),
        ("vary: {duration_s: {from: 1, to: 1, count: 2}}\n", "vary: .*the value 1 more than once"),
        ("vary: {seed: [1, 2]}\n", "vary: .*seed is given by seeds:"),
        ("set: {seed: 5}\n", "set: .*seed is given by seeds:"),
        ("cases: {a: {seed: 5}}\n", "cases: .*seed is given by seeds:"),
    ],
)
def test_mistakes_name_the_file_and_the_key(tmp_path, text, says):
    with pytest.raises(StudyError, match=says) as caught:
        read_study(write(tmp_path, text))
    assert "study.yaml" in str(caught.value)


def test_a_program_may_give_ranges():
    content = {"schema": 1, "name": "mine", "scenario": "separation", "seeds": range(3)}
    study = study_from(content | {"vary": {"duration_s": range(10, 30, 10)}})
    assert (study.seeds, study.vary) == ((0, 1, 2), {"duration_s": {"10": 10, "20": 20}})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("schema: 1\nname: a b\nscenario: separation\n", "name: "),
        ("schema: 1\nname: mine\nscenario: []\n", "scenario: .*at least one"),
        ("- 1\n", "a study is a mapping"),
    ],
)
def test_a_whole_file_that_is_no_study_is_refused(tmp_path, text, says):
    file = tmp_path / "study.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(StudyError, match=says) as caught:
        read_study(file)
    assert "study.yaml" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("vary: {radio: [moon2021]}\n", "radio moon2021, seed 1: radio.*did you mean moon2020"),
        (
            "set: {duration: 3}\n",
            "^scenario separation, seed 1: duration: unknown key; did you mean duration_s",
        ),
        ("vary: {hosts: [1, 2]}\n", "are the same run"),
    ],
)
def test_runs_that_cannot_be_are_named(tmp_path, text, says):
    with pytest.raises(StudyError, match=says):
        cases(tmp_path, text)


def function(folder: Path, body: str) -> Function:
    (folder / "own.py").write_text(
        f"import numpy as np\n\n\ndef measure(run):\n    return {body}\n", encoding="utf-8"
    )
    return Function(place=str(folder / "own.py"), name="measure")


def test_own_metrics_may_be_numbers_texts_and_lists(tmp_path):
    body = "{'a': np.float64(1.5), 'b': 'x', 'c': np.array([1, 2]), 'd': True, 'e': None}"
    found = own(None, (function(tmp_path, body),))
    assert found == {"a": 1.5, "b": "x", "c": [1.0, 2.0], "d": True, "e": None}
    assert json.dumps(found)


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("3", "mapping"),
        ("{'a': object()}", "measure: a"),
        ("{'a': ['x']}", "a"),
        ("{'failure': ''}", "failure: is a column of the study's own"),
        ("{'a': 1, 'seed': 2}", "seed: is a column of the study's own"),
    ],
)
def test_other_metrics_are_refused_by_name(tmp_path, body, says):
    with pytest.raises(StudyError, match=says):
        own(None, (function(tmp_path, body),))


def test_a_metric_does_not_take_the_place_of_one_of_ours(tmp_path):
    with pytest.raises(StudyError, match="measure: delivery: is a column of the study's own"):
        own(None, (function(tmp_path, "{'delivery': 1}"),), {"delivery": 0.5})


def test_two_functions_give_no_column_twice(tmp_path):
    one = function(tmp_path, "{'a': 1}")
    (tmp_path / "more.py").write_text("def other(run):\n    return {'b': 2, 'a': 3}\n", encoding="utf-8")
    other = Function(place=str(tmp_path / "more.py"), name="other")
    with pytest.raises(StudyError, match=r"more\.py:other: a: is a column of another function"):
        own(None, (one, other))


def test_a_function_that_is_not_there_is_named(tmp_path):
    missing = function(tmp_path, "{}").model_copy(update={"name": "other"})
    with pytest.raises(StudyError, match=r"own\.py:other: there is no such function"):
        load(missing)


def test_the_table_has_all_columns_and_empty_places(tmp_path):
    rows = [{"seed": 1, "x": 1, "c": [1.0]}, {"seed": 2, "x": 2.5, "late": "yes"}]
    write_table(rows, tmp_path / "t.parquet")
    table = pq.read_table(tmp_path / "t.parquet")
    assert table.column_names == ["seed", "x", "c", "late"]
    assert table.to_pylist()[0] == {"seed": 1, "x": 1.0, "c": [1.0], "late": None}
    assert np.array_equal(table["x"].to_numpy(), [1.0, 2.5])


def test_a_column_of_several_kinds_is_named(tmp_path):
    with pytest.raises(StudyError, match="column x"):
        write_table([{"x": 1}, {"x": "one"}], tmp_path / "t.parquet")


def test_many_rows_of_whole_numbers_and_others_take_a_moment(tmp_path):
    """Looked at again for each value, a column of 20000 would take minutes."""
    looked_at = 0

    class Looked(list):
        def __iter__(self):
            nonlocal looked_at
            looked_at += 1
            return super().__iter__()

    assert list(_of_one_kind(Looked([1, True, None, 2.5]))) == [1.0, True, None, 2.5]
    assert looked_at <= 2


@pytest.mark.parametrize("values", ["[true, 1]", "[1, true]"])
def test_a_truth_value_is_no_number(tmp_path, values):
    assert len(read_study(write(tmp_path, f"vary: {{x: {values}}}\n")).vary["x"]) == 2
