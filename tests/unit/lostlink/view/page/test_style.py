"""Text that can be read: contrasts of WCAG 2.1, 1.4.3, level AA, of what the page's colours are used for."""

from __future__ import annotations

import re

import pytest

from lostlink.view.page.style import CSS

LEAST = 4.5


def luminance(colour: str) -> float:
    """Relative luminance of ``#rrggbb``, WCAG 2.1."""
    shares = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    linear = [share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares]
    return sum(weight * share for weight, share in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one: str, other: str) -> float:
    """Contrast ratio, WCAG 2.1."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("theme", ["body {", "body.body--dark {"])
def test_text_has_contrast(theme: str) -> None:
    colours = dict(re.findall(r"(--[\w-]+):(#[0-9a-f]{6});", CSS.split(theme)[1].split("}")[0]))
    filled = "#ffffff" if theme == "body {" else colours["--ll-ground"]
    assert contrast(colours["--ll-button"], colours["--ll-panel"]) >= LEAST
    assert contrast(colours["--ll-button"], filled) >= LEAST
    for name in ("--ll-ink", "--ll-loss"):
        assert contrast(colours[name], colours["--ll-panel"]) >= LEAST
    assert contrast(colours["--ll-bar"], "#ffffff") >= LEAST
