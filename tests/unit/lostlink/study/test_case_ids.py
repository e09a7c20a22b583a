"""A run of a study is reused as long as all that it is made of is what it was."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from importlib import metadata, util
from pathlib import Path

import pytest

from bridge.record.digests import file_digest
from bridge.record.provenance import collect, write_provenance
from lostlink.study import made_of
from lostlink.study.case_process import (
    PLAN_FILE,
    RESULT_FILE,
    RUN_FOLDER,
    CasePlan,
    fly_case,
    measures_of,
    read_result,
    write_whole,
)
from lostlink.study.study import Study
from tests.unit.bridge.scenario.test_named_files import GAINS, SCENARIO, made

STUDY = "schema: 1\nname: mine\nscenario: scenario.yaml\nseeds: [1, 2]\n"
ORIGIN, ON_THE_TILE = "lat_deg: 47.4, lon_deg: 8.5", "lat_deg: 40.1331, lon_deg: -105.2404"
TERRAIN = "preset: moon2020\npropagation: {model: terrain, file: maps/hills.tif, extent_m: 100}\n"
TILE = Path(__file__).parents[3] / "data" / "ridge.tif"
needs_rasterio = pytest.mark.skipif(util.find_spec("rasterio") is None, reason="needs lostlink[terrain]")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A study of two runs, both done, of a scenario that names files of all kinds."""
    made(tmp_path)
    model = tmp_path / "jsbsim" / "aircraft" / "hexa550" / "hexa550.xml"
    model.write_text('<fdm_config><system file="../shared/motors"/></fdm_config>')
    (tmp_path / "jsbsim" / "aircraft" / "shared").mkdir()
    (tmp_path / "jsbsim" / "aircraft" / "shared" / "motors.xml").write_text("<system/>")
    (tmp_path / "study.yaml").write_text(STUDY)
    finish(tmp_path)
    return tmp_path


def finish(folder: Path) -> None:
    ours = Study(folder / "study.yaml", folder)
    for case in ours.cases:
        ours.path(case).mkdir(parents=True, exist_ok=True)
        ours._plan(case).write(ours.path(case))
        result = {"failure": "", "measures": CasePlan("", (), "all").measures, "metrics": {}, "timing": {}}
        write_whole(ours.path(case) / RESULT_FILE, result)


def left(folder: Path) -> int:
    return len(Study(folder / "study.yaml", folder).left())


def test_an_untouched_study_is_reused(folder: Path) -> None:
    (folder / "maps" / "other.csv").write_text("nobody names it")
    assert left(folder) == 0


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("maps/shear.nc", b"\0"),
        ("maps/gains.csv", b"0,0,1,9,0,1,-70\n"),
        ("own.yaml", b"# other\n"),
        ("jsbsim/aircraft/hexa550/hexa550.xml", b"<!-- other -->"),
        ("jsbsim/aircraft/hexa550/Engines/motor.xml", b"<!-- other -->"),
        ("jsbsim/aircraft/shared/motors.xml", b"<!-- other -->"),
        ("models/mine.py", b"# other\n"),
    ],
)
def test_another_content_of_a_file_is_another_run(folder: Path, name: str, more: bytes) -> None:
    with (folder / name).open("ab") as file:
        file.write(more)
    assert left(folder) == 2


@pytest.mark.parametrize("option", ["weights", "weights_file"])
def test_another_content_of_a_file_in_options_of_an_agent_is_another_run(folder: Path, option: str) -> None:
    weights = folder / "policy.npz"
    weights.write_bytes(b"1")
    (folder / "agent.py").write_text(
        f"from lostlink import Agent\nclass Own(Agent):\n    def on_tick(self, now): self.options['{option}']\n"
    )
    text = (folder / "scenario.yaml").read_text()
    own = 'class: "agent.py:Own"'
    (folder / "scenario.yaml").write_text(text.replace(own, f"{own}, options: {{{option}: policy.npz}}"))
    finish(folder)
    assert left(folder) == 0
    weights.write_bytes(b"2")
    assert left(folder) == 2


@needs_rasterio
def test_another_terrain_is_another_run(folder: Path) -> None:
    hills = folder / "maps" / "hills.tif"
    shutil.copyfile(TILE, hills)
    (folder / "radio.yaml").write_text(TERRAIN)
    scenario = (folder / "scenario.yaml").read_text()
    (folder / "scenario.yaml").write_text(scenario.replace(ORIGIN, ON_THE_TILE))
    finish(folder)
    assert left(folder) == 0
    hills.write_bytes(hills.read_bytes() + b"\0")
    assert left(folder) == 2


def test_another_version_of_lostlink_is_another_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "version", lambda _package: "99.0")
    assert left(folder) == 2


def test_another_commit_of_lostlink_is_another_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its version stays the same from commit to commit."""
    monkeypatch.setattr(made_of, "git_commit", lambda: f"{'a' * 40}-dirty-{'b' * 12}")
    assert left(folder) == 2


@pytest.mark.parametrize("place", ["scenario.yaml", "radio.yaml"])
def test_another_schedule_of_slots_is_another_run(folder: Path, place: str) -> None:
    """Whether the scenario names it or a radio of its own does."""
    medium = "medium: {model: tdma, schedule_file: slots.yaml}"
    slots = "slots: [{nodes: 0, duration_s: 0.1}, {nodes: 1, duration_s: 0.2}]\n"
    (folder / "slots.yaml").write_text(slots)
    file = folder / place
    old, new = (
        ("radio: radio.yaml", f"radio: {{preset: radio.yaml, {medium}}}")
        if place == "scenario.yaml"
        else ("antenna:", f"{medium}\nantenna:")
    )
    file.write_text(file.read_text().replace(old, new))
    finish(folder)
    assert left(folder) == 0
    (folder / "slots.yaml").write_text(slots.replace("0.2", "0.3"))
    assert left(folder) == 2


def test_a_study_is_resumed_wherever_its_folder_lies(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Whatever lies before it in the order of names: files beside, and code on the path."""
    elsewhere = tmp_path_factory.mktemp("zz") / "unzipped"
    shutil.copytree(folder, elsewhere)
    shutil.move(folder, folder.with_name("gone"))
    assert left(elsewhere) == 0


@pytest.mark.parametrize(("last", "is_another"), [("one", False), ("two", True)])
def test_which_of_two_files_of_a_name_a_node_has_counts(tmp_path: Path, last: str, is_another: bool) -> None:
    """Also where the two are the same, and only what they name differs."""
    for gain_db, name in ((-60, "one"), (-70, "two")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "gains.csv").write_text(GAINS.replace("-60", str(gain_db)))
        (tmp_path / name / "radio.yaml").write_text(
            "preset: moon2020\npropagation: {model: gain-map, file: gains.csv}\n"
        )
    head = SCENARIO.partition("nodes:")[0].replace("radio.yaml", "moon2020").replace("wind.yaml", "calm")
    (tmp_path / "study.yaml").write_text(STUDY)
    ids = []
    for third in ("one", last):
        radios = enumerate(("one", "two", third))
        nodes = [f"  - {{id: {k}, radio: {name}/radio.yaml, agent: {{type: still}}}}\n" for k, name in radios]
        (tmp_path / "scenario.yaml").write_text(f"{head}nodes:\n{''.join(nodes)}")
        ids.append(Study(tmp_path / "study.yaml", tmp_path).cases[0].id)
    assert (ids[0] != ids[1]) is is_another


def test_code_on_the_path_may_lie_elsewhere_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the two lie in the order of names says nothing; what a metric is made of is the same as well."""
    found = []
    for study, libraries in (("a", "b"), ("d", "c")):
        folder, package = tmp_path / study, tmp_path / libraries / "shared_laws"
        folder.mkdir()
        package.mkdir(parents=True)
        (package / "__init__.py").write_text("GAIN = 2\n")
        made(folder)
        (folder / "agent.py").write_text(
            "import shared_laws\nfrom lostlink import Agent\nclass Own(Agent): ...\n"
        )
        (folder / "own.py").write_text("import shared_laws\ndef measure(run):\n    return {}\n")
        (folder / "study.yaml").write_text(f"{STUDY}metrics: own.py:measure\n")
        with monkeypatch.context() as context:
            context.syspath_prepend(package.parent)
            ours = Study(folder / "study.yaml", folder)
            found.append((ours.cases[0].id, measures_of(ours.content.metrics)))
    assert found[0] == found[1]


def earlier(folder: Path) -> list[str]:
    return list(Study(folder / "study.yaml", folder).earlier().values())


def edit(file: Path) -> None:
    with file.open("a") as text:
        text.write("# other\n")


def test_a_study_says_why_runs_with_results_are_flown_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = Study(folder / "study.yaml", folder).cases[0].made_of.lostlink
    assert earlier(folder) == []
    edit(folder / "own.yaml")
    edit(folder / "models" / "mine.py")
    assert earlier(folder) == ["other files (mine.py, own.yaml)"] * 2
    monkeypatch.setattr(made_of, "git_commit", lambda: "a" * 40)
    lostlink = f"lostlink {metadata.version('lostlink')} at commit {'a' * 40} in place of {before}"
    assert earlier(folder) == [f"other files (mine.py, own.yaml), {lostlink}"] * 2
    finish(folder)
    assert earlier(folder) == []


def test_the_last_earlier_result_of_a_run_is_told_and_none_of_other_runs(folder: Path) -> None:
    study = folder / "study.yaml"
    study.write_text(STUDY.replace("[1, 2]", "[2, 3]"))
    edit(folder / "own.yaml")
    finish(folder)
    edit(folder / "models" / "mine.py")
    assert earlier(folder) == ["other files (mine.py)"] * 2
    study.write_text(STUDY.replace("[1, 2]", "[1, 4]"))
    assert earlier(folder) == ["other files (mine.py, own.yaml)"]
    study.write_text(STUDY.replace("[1, 2]", "[2, 3]") + "set: {duration_s: 7}\n")
    assert earlier(folder) == ["other files (mine.py)"] * 2


def test_other_settings_are_told_where_nothing_else_is_other(folder: Path) -> None:
    (folder / "study.yaml").write_text(f"{STUDY}set: {{duration_s: 7}}\n")
    assert earlier(folder) == ["another scenario, or other settings"] * 2


@pytest.mark.parametrize("is_kept", [True, False])
def test_of_results_of_older_plans_the_record_says_what_made_them(folder: Path, is_kept: bool) -> None:
    ours = Study(folder / "study.yaml", folder)
    for case in ours.cases:
        plan = json.loads((ours.path(case) / PLAN_FILE).read_text())
        plan["labels"] = list(plan.pop("made_of") and plan["labels"])
        write_whole(ours.path(case) / PLAN_FILE, plan)
        if is_kept:
            (ours.path(case) / RUN_FOLDER).mkdir()
            files = map(Path, case.made_of.files)
            write_provenance(replace(collect({}, files), git_commit="c" * 40), ours.path(case) / RUN_FOLDER)
    edit(folder / "own.yaml")
    now = Study(folder / "study.yaml", folder).cases[0].made_of.lostlink
    known = f"other files (own.yaml), {now} in place of lostlink {metadata.version('lostlink')} at commit {'c' * 40}"
    assert earlier(folder) == [known if is_kept else "what these were made of is not known"] * 2


def test_what_another_lostlink_was_to_fly_is_not_flown(folder: Path) -> None:
    """On a worker of a cluster, say."""
    ours = Study(folder / "study.yaml", folder)
    case, directory = ours.cases[0], ours.path(ours.cases[0])
    (directory / RESULT_FILE).unlink()
    theirs = replace(case.made_of, id="0123456789abcdef", lostlink="lostlink 0.0.9")
    replace(ours._plan(case), made_of=theirs).write(directory)
    assert fly_case(directory) == 1
    result = read_result(directory)
    assert result is not None
    assert result["failure"] == (
        "no result of this run, as something was changed after the study was read: "
        f"{case.made_of.lostlink} in place of lostlink 0.0.9; start the study again"
    )
    assert case in Study(folder / "study.yaml", folder).left()


def test_each_run_has_the_files_that_it_names_itself_or_through_others(folder: Path) -> None:
    """Each file is looked into once, whichever run names it first."""
    study = f"{STUDY.replace('[1, 2]', '1')}vary: {{radio: [radio.yaml, moon2020]}}\n"
    (folder / "study.yaml").write_text(study)
    own, preset = (case.made_of.files for case in Study(folder / "study.yaml", folder).cases)
    assert {Path(path).name for path in own.keys() - preset.keys()} == {
        "radio.yaml",
        "base.yaml",
        "gains.csv",
        "mine.py",
    }
    assert str(folder / "maps" / "shear.nc") in preset
    assert all(digest == file_digest(Path(path)) for path, digest in own.items())
