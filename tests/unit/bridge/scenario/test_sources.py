"""What a class or function is made of is found by reading its imports, wherever Python would find them."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from bridge.scenario.resolve.sources import code_of
from sitl_configs.own_code import put_first


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on Python's path that is not beside."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    return folder


def written(folder: Path, **texts: str) -> None:
    """Modules by name, with ``__`` for the dot in it; each would end whoever runs it."""
    for name, text in texts.items():
        file = folder / f"{name.replace('__', '/')}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{text}\nraise SystemExit('it ran')\n")


def names(place: str | Path, below: Path) -> list[str]:
    return sorted(str(file.relative_to(below)) for file in code_of(str(place)).files)


def test_a_file_and_what_it_imports_beside_and_on_the_path(tmp_path: Path, elsewhere: Path) -> None:
    written(tmp_path, mine="import json\nimport beside_here\nfrom pack_here.one import Thing", other="")
    written(tmp_path, beside_here="import lostlink, bridge.agents")
    written(elsewhere, pack_here__init="", pack_here__one="from . import two", pack_here__two="")
    written(elsewhere, pack_here__three="")
    (elsewhere / "pack_here" / "init.py").rename(elsewhere / "pack_here" / "__init__.py")
    assert names(tmp_path / "mine.py", tmp_path) == [
        "beside_here.py",
        "elsewhere/pack_here/__init__.py",
        "elsewhere/pack_here/one.py",
        "elsewhere/pack_here/two.py",
        "mine.py",
    ]
    assert names("pack_here.two", elsewhere) == ["pack_here/__init__.py", "pack_here/two.py"]


@pytest.mark.parametrize(
    "text",
    ["import spaced_here.deep.one", "import importlib\nimportlib.import_module('spaced_here.deep.one')"],
)
def test_packages_without_an_init_and_modules_imported_by_a_text(
    tmp_path: Path, elsewhere: Path, text: str
) -> None:
    written(tmp_path, mine=text)
    written(elsewhere, spaced_here__deep__one="")
    assert names(tmp_path / "mine.py", tmp_path) == ["elsewhere/spaced_here/deep/one.py", "mine.py"]


def test_of_what_is_installed_the_version_counts_and_of_an_editable_install_the_files(
    tmp_path: Path, elsewhere: Path
) -> None:
    written(tmp_path, mine="import solid_here.one, soft_here")
    written(elsewhere, solid_here__one="")
    sources = tmp_path / "sources"
    written(sources, soft_here="")
    sys.path.append(str(sources))  # as the .pth file does
    for name, record in (("Solid", "solid_here/one.py,,\n"), ("Soft", "soft.pth,,\n")):
        about = elsewhere / f"{name}-1.5.dist-info"
        about.mkdir()
        (about / "RECORD").write_text(record)
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.5\n")
    code = code_of(str(tmp_path / "mine.py"))
    assert [file.name for file in code.files] == ["mine.py", "soft_here.py"]
    assert code.packages == {"Solid": "1.5"}
    assert names("solid_here.one", elsewhere) == []
    assert [file.name for file in code_of("solid_here.one", "solid_here").files] == ["one.py"]


def test_a_package_that_only_a_hook_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As setuptools installs packages without an ``__init__`` with -e."""
    written(tmp_path / "sources", one="")
    name = "__editable__.hooked_here-0.1.finder.__path_hook__"

    class Finder:
        @classmethod
        def hook(cls, path: str) -> type[Finder]:
            if path != name:
                raise ImportError
            return cls

        @classmethod
        def find_spec(cls, module: str, target: object = None) -> ModuleSpec | None:
            spec = ModuleSpec(module, None, is_package=True)
            spec.submodule_search_locations = [str(tmp_path / "sources")]
            return spec if module == "hooked_here" else None

    monkeypatch.setattr(sys, "path_hooks", [*sys.path_hooks, Finder.hook])
    monkeypatch.setattr(sys, "path", [*sys.path, name])
    assert names("hooked_here.one", tmp_path) == ["sources/one.py"]


def test_what_changes_is_read_again(tmp_path: Path, elsewhere: Path) -> None:
    written(tmp_path, mine="import first_here, second_here")
    written(elsewhere, first_here="")
    assert names(tmp_path / "mine.py", tmp_path) == ["elsewhere/first_here.py", "mine.py"]
    written(elsewhere, second_here="")
    written(tmp_path, mine="import second_here")
    assert names(tmp_path / "mine.py", tmp_path) == ["elsewhere/second_here.py", "mine.py"]


def test_folders_of_other_files_are_not_looked_in(tmp_path: Path) -> None:
    """They are on the path of a process that has loaded these."""
    written(tmp_path, mine="import strange_here")
    written(tmp_path / "other", strange_here="")
    put_first(tmp_path / "other")
    assert names(tmp_path / "mine.py", tmp_path) == ["mine.py"]
