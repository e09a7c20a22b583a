"""Links of all pages, as forges show them, and pages that code, examples and messages name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = (
    "aps",
    "benchmarks",
    "bridge",
    "channel",
    "examples",
    "fdm",
    "lostlink",
    "sitl_configs",
    "standin",
    "tests",
)
TEXTS = {".md", ".py", ".toml", ".xml", ".yaml", ".yml", ".json"}


def headings(page: Path) -> set[str]:
    """The anchors of a page, as forges make them."""
    lines = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.*)", lines, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize(
    "page",
    sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]),
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]+))?\)", page.read_text(encoding="utf-8"))
    for target, anchor in links:
        file = page.parent / target if target else page
        assert file.exists(), target
        assert not anchor or anchor in headings(file), f"{target}#{anchor}"


@pytest.mark.parametrize("folder", FOLDERS)
def test_pages_that_are_named_are_there(folder: str) -> None:
    for file in (ROOT / folder).rglob("*"):
        if file.suffix in TEXTS:
            for page in re.findall(r"\bdocs/[\w./-]+\.(?:md|png|svg)\b", file.read_text(encoding="utf-8")):
                assert (ROOT / page).exists(), f"{file.relative_to(ROOT)}: {page}"
