"""Reads the scenario of a run's directory, which we wrote: quickly, and with mistakes for people if it was changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from bridge.scenario.document.yaml_text import read_yaml
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.mistakes.explain import explained
from bridge.scenario.model import Scenario
from sitl_configs.yaml_text import NO_VALUE


def read_recorded(file: Path, placed: Callable[[Any], Any]) -> Scenario:
    """The scenario of a file, as `Scenario.from_yaml` reads it.

    Args:
        file: written by `Scenario.to_yaml`.
        placed: gives the same content with the files that it names where they are now.

    Raises:
        ScenarioError: it is no scenario; one line per mistake.
        OSError: it cannot be read.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{file}: cannot be read: {error}") from error
    try:
        return Scenario.from_yaml(text, placed)
    except ValidationError as error:
        root = read_yaml(text, str(file), file.parent)
        raise ScenarioError("\n".join(explained(root, error, Scenario))) from error
    except (yaml.YAMLError, RecursionError, *NO_VALUE) as error:
        read_yaml(text, str(file), file.parent)  # tells the line
        raise ScenarioError(f"{file}: is none of ours: {error}") from error
