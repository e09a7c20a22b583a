"""Texts with the index of a node in them: ``{i}``, ``sensor-{i:02}``, ``{30 + 5 * i}``."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from string import Formatter
from typing import Any

Number = int | float
OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Number]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
}


def filled(text: str, names: Mapping[str, int]) -> Any:
    """The text with each ``{...}`` computed; a number if it is nothing else.

    Args:
        text: ``{{`` and ``}}`` stand for braces.
        names: numbers by name.

    Raises:
        ValueError: what is in braces cannot be computed.
    """
    try:
        parts = list(Formatter().parse(text))
    except ValueError as error:
        raise ValueError(f"{text!r}: {error}; {{{{ and }}}} stand for braces") from None
    if len(parts) == 1 and parts[0][0] == "" and parts[0][1] is not None and not (parts[0][2] or parts[0][3]):
        return computed(parts[0][1], names)
    return "".join(_part(*part, names) for part in parts)


def computed(expression: str, names: Mapping[str, int]) -> Number:
    """The number that an expression of names, numbers, ``+ - * / // %`` and brackets gives.

    Raises:
        ValueError: it is none.
    """
    try:
        return _value(ast.parse(expression.strip(), mode="eval").body, names)
    except (SyntaxError, ZeroDivisionError, OverflowError, RecursionError, MemoryError) as error:
        raise ValueError(_mistake(expression, names)) from error


def _part(
    literal: str, expression: str | None, spec: str | None, conversion: str | None, names: Mapping[str, int]
) -> str:
    if expression is None:
        return literal
    if conversion:
        raise ValueError(_mistake(f"{expression}!{conversion}", names))
    try:
        return literal + format(computed(expression, names), spec or "")
    except (ValueError, MemoryError) as error:
        raise ValueError(_mistake(expression if not spec else f"{expression}:{spec}", names)) from error


def _value(node: ast.AST, names: Mapping[str, int]) -> Number:
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return value
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand, names)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            return OPERATORS[type(op)](_value(left, names), _value(right, names))
    raise ValueError(_mistake(ast.unparse(node), names))


def _mistake(expression: str, names: Mapping[str, int]) -> str:
    known = " and ".join(names)
    return f"{{{expression}}} cannot be computed: numbers, {known}, + - * / // % and brackets can, as in {{30 + 5 * i}}"
