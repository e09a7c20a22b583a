"""What `lostlink run` refuses before it looks at the scenario."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner

from lostlink.cli.flying.run import run


def test_json_and_digest_exclude_each_other(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        run, ["--json", "--digest", "--out", str(tmp_path / "runs"), "no-such-scenario"]
    )
    assert (done.exit_code, done.stdout) == (2, "")
    assert "--digest and --json: choose one" in done.stderr
    assert list(tmp_path.iterdir()) == []
