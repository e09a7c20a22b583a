"""What the commands say of the view before anything is started."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from lostlink.cli.main import lostlink
from lostlink.view import beside as viewing


@pytest.mark.parametrize(("command", "status"), [(["run", "--view"], 2), (["view", "anything"], 1)])
def test_without_the_package_it_is_told_what_to_install(
    command: list[str], status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewing, "find_spec", lambda _: None)
    result = CliRunner().invoke(lostlink, command)
    assert result.exit_code == status
    assert result.stderr == "lostlink: the live view needs NiceGUI: pip install 'lostlink[view]'\n"


def test_control_needs_a_view() -> None:
    result = CliRunner().invoke(lostlink, ["run", "--control"])
    assert result.exit_code == 2
    assert "needs --view" in result.stderr


def test_the_token_comes_from_the_environment_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOSTLINK_API_TOKEN", "short")
    result = CliRunner().invoke(lostlink, ["view", "anything"])
    assert result.exit_code == 2
    assert "the token must have at least 16 characters" in result.stderr
