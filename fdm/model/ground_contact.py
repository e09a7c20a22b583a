"""Whether a JSBSim model's landing gear is stable at a step size, from its XML.

JSBSim integrates the contact forces explicitly. A damper that takes more momentum in one step than the
aircraft has throws it back harder than it came: with all contacts on the ground a step must be no longer than
mass / sum of the damping coefficients (the F450 of the jsbsim package, which has three of 100 N s/m on 1.4 kg,
explodes at 100 Hz and is calm from 250 Hz on; the rule says 214 Hz). Turning is not in the
rule: b r^2 / I of a point far out can be more than b / m, and whoever makes a model looks at both (f450.xml does).
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from fdm.errors import AirframeError

POUND_SECOND_PER_FOOT = 14.5939029
"""N s/m per lbf s/ft."""


def contact_damping_ns_per_m(model_file: Path) -> float:
    """Sum of the damping coefficients of all contacts of a JSBSim aircraft, N s/m.

    Args:
        model_file: the aircraft's XML; ``<ground_reactions file="...">`` is followed.

    Raises:
        AirframeError: a file cannot be read as XML, or holds a coefficient that is no number.
    """
    root = _parse(model_file)
    total = 0.0
    for section in root.iter("ground_reactions"):
        included = section.get("file")
        source = section if included is None else _parse(model_file.parent / included)
        for damping in source.iter("damping_coeff"):
            total += _value(damping, model_file)
    return total


def slowest_stable_rate_hz(model_file: Path, mass_kg: float) -> float:
    """Slowest step rate at which the landing gear is stable; 0 without any contact."""
    return contact_damping_ns_per_m(model_file) / mass_kg


def _value(damping: ElementTree.Element, model_file: Path) -> float:
    try:
        value = float(damping.text or "")
    except ValueError:
        raise AirframeError(f"{model_file}: damping_coeff {damping.text!r} is no number") from None
    return value if damping.get("unit", "").upper().startswith("N") else value * POUND_SECOND_PER_FOOT


def _parse(path: Path) -> ElementTree.Element:
    try:
        return ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise AirframeError(f"{path}: {error}") from None
