"""All errors of the command begin alike."""

from __future__ import annotations

import sys

import pytest

from lostlink.cli.main import main


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["run", "--sett", "x=1"], "lostlink: No such option"),
        (["runn"], "lostlink: there is no command 'runn'; did you mean run? (lostlink --help lists them)"),
        (["export", "/nowhere"], "lostlink: Invalid value for 'RUN'"),
        (
            ["check", "seperation"],
            "lostlink: seperation: no such file, and no scenario of that name; did you mean",
        ),
        (["run", "--set", "a"], "lostlink: --set a: has to be KEY=VALUE"),
    ],
)
def test_errors_begin_with_the_commands_name(
    arguments: list[str], says: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["lostlink", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    told = capsys.readouterr().err
    assert ended.value.code == 2
    assert told.startswith(says)
    assert "Error:" not in told


def test_help_ends_well(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["lostlink", "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    assert "check" in capsys.readouterr().out
