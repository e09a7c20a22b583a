"""docs/reference/channel-models.md has a row for each model that a radio may name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from channel import config

TEXT = (Path(__file__).parents[3] / "docs" / "reference" / "channel-models.md").read_text(encoding="utf-8")
KINDS = ("Propagation", "Shadowing", "Fading", "Antenna", "Bursts", "Noise", "Error")


@pytest.mark.parametrize("kind", KINDS)
def test_each_model_has_a_row(kind: str) -> None:
    models = get_args(get_args(getattr(config, kind))[0])
    assert len(models) > 1
    for each in models:
        name = each.model_fields["model"].default
        key = rf"({kind.lower()}: )?{re.escape(name)}"
        assert name == "none" or re.search(rf"^\| .*`{key}`", TEXT, re.MULTILINE), f"{kind.lower()}: {name}"
