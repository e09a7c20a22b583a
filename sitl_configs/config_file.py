"""YAML files, and where in one a mistake is."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from sitl_configs.mistakes import mistakes_in
from sitl_configs.near import near_miss
from sitl_configs.yaml_text import YamlMistake, read_yaml, ships

M = TypeVar("M", bound=BaseModel)


def read_model(path: Path, model: type[M], mistake: type[Exception]) -> M:
    """What a YAML file says.

    Args:
        path: the file.
        model: what its keys and values are to be.
        mistake: what is raised if they are not; the text has a line for each, with file, line and key.
    """
    try:
        text = path.read_text(encoding="utf-8")
        return model.model_validate(read_yaml(text, is_ours=ships(path)))
    except OSError as error:
        raise mistake(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise mistake(f"{path}: is not UTF-8 text") from None
    except YamlMistake as error:
        line = "" if error.line is None else f":{error.line}"
        raise mistake(f"{path}{line}: {error}") from None
    except ValidationError as error:
        raise mistake(
            "\n".join(
                f"{path}:{(lines_of(text, key) or [1])[-1]}: {'.'.join(map(str, key)) or '(file)'}: {problem}"
                for key, problem in mistakes_in(error, model)
            )
        ) from None


def unknown(what: str, name: object, known: Iterable[str]) -> str:
    """There is no such thing of a kind: with the name that may have been meant, and the known ones."""
    names = list(known)
    hint = near_miss(name, names)
    there = f"{' Known are' if hint else ': known are'} {', '.join(names)}"
    return f"{what} {str(name)!r}{hint}{there}; or give the path of a YAML file"


def lines_of(text: str, location: Iterable[int | str]) -> list[int]:
    """Lines (from 1) of the nodes on the way to `location`, as far as the file has them."""
    node: Any = yaml.compose(text)
    lines: list[int] = []
    for part in location:
        if isinstance(node, yaml.MappingNode):
            found = next((pair for pair in node.value if pair[0].value == str(part)), None)
            if found is None:
                break
            key, node = found
            lines.append(key.start_mark.line + 1)
        elif isinstance(node, yaml.SequenceNode) and str(part).isdigit() and int(part) < len(node.value):
            node = node.value[int(part)]
            lines.append(node.start_mark.line + 1)
        else:
            break
    return lines
