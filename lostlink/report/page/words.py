"""Numbers as people read them."""

from __future__ import annotations

from typing import Any

NOTHING = "–"


def num(value: Any, decimals: int | None = None) -> str:
    """A number with four digits that count, or so many decimals; a dash for none; text as it is."""
    if value is None:
        return NOTHING
    if isinstance(value, str | bool):
        return str(value)
    if decimals is not None:
        return f"{value:.{decimals}f}"
    if isinstance(value, int) or abs(value) >= 1000:
        return count(value)
    return f"{value:.4g}"


def count(value: float) -> str:
    """A whole number, with thin spaces between thousands."""
    return f"{value:,.0f}".replace(",", "\u202f")


def share(value: float | None) -> str:
    """A share in per cent."""
    return NOTHING if value is None else f"{100 * value:.1f} %"
