"""The page on identities has the table of rights, as it is in code."""

from __future__ import annotations

from pathlib import Path

from bridge.bus.identity.table import TABLE, AccessRole

PAGE = Path(__file__).parents[5] / "docs" / "reference" / "identities.md"


def names(roles: AccessRole) -> str:
    return ", ".join(str(role.name).lower() for role in AccessRole if role in roles)


def test_the_page_has_the_rights_of_the_table() -> None:
    page = PAGE.read_text(encoding="utf-8").split("## Rights")[1].split("##")[0]
    written = [line for line in page.splitlines() if line.startswith("| `")]
    assert written == [
        f"| `{row.key}` | {names(row.writes | row.serves | row.holds)} | "
        f"{names(row.reads | row.asks | row.watches)} |"
        for row in TABLE
    ]
