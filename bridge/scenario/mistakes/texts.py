"""Refuses what is no text: YAML's escapes can write half of a pair of surrogates, which no file and no message has."""

from __future__ import annotations

from collections.abc import Iterator

from bridge.scenario.document.written import Path_, Written
from bridge.scenario.mistakes.error import ScenarioError


def refuse_no_texts(root: Written) -> None:
    """See that UTF-8 can encode every text in a scenario, keys too.

    Raises:
        ScenarioError: with one line per text that it cannot.
    """
    mistakes = [
        f"{root.at(path).place}: {root.dotted(path)}: has to be text that UTF-8 can encode (got {text!r})"
        for path, text in _texts(root)
        if not _is_encodable(text)
    ]
    if mistakes:
        raise ScenarioError("\n".join(dict.fromkeys(mistakes)).encode(errors="backslashreplace").decode())


def _texts(written: Written, path: Path_ = ()) -> Iterator[tuple[Path_, str]]:
    for key in written.keys:
        yield (*path, key), key
        yield from _texts(written.content[key], (*path, key))
    for index, item in enumerate(written.items()):
        yield from _texts(item, (*path, index))
    if isinstance(written.content, str):
        yield path, written.content


def _is_encodable(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
