"""What is certain to be wrong with an agent's class, from its file's syntax tree alone.

Only names that the file binds once are followed: what is imported, decorated or bound anew may be anything.
"""

from __future__ import annotations

import ast
import builtins
import inspect
from collections import Counter
from collections.abc import Iterator

from bridge.scenario.own.calls import CALLED_WITH, wrong_call

PLAIN_METHODS = ("on_tick", "on_packet", "on_measurement", "transmit_package", "package")
"""Methods of an agent that are called, not awaited."""
AWAITED = "fly"
"""The one that is."""
IS_ASYNC = (
    "is an async def, which nobody would await: make it a plain def, and start what has to wait with "
    "asyncio.create_task, or in fly"
)
IS_PLAIN = "is a plain def: make it an async def, as it is awaited"
IS_GENERATOR = (
    "has a yield, which makes it an asynchronous generator, and that cannot be awaited: take the yield out"
)
NO_AGENT = "is no subclass of bridge.agents.Agent"

_Function = ast.FunctionDef | ast.AsyncFunctionDef


def wrong_with_class(module: ast.Module, name: str) -> tuple[int, str] | None:
    """Line and mistake of the class ``name`` in a module; None: nothing that is certain."""
    file = _File(module)
    found = file.known.get(name)
    if isinstance(found, _Function) and not found.decorator_list:
        return found.lineno, f"{name} is a function, and no class"
    if not isinstance(found, ast.ClassDef):
        return None
    if file.leads_to_no_agent(found):
        return found.lineno, f"{name} {NO_AGENT}"
    may_be_changed = found.decorator_list or found.keywords
    for method in file.methods_of(found):
        if may_be_changed and method.name == "__init__":
            continue
        if wrong := _wrong_with(method):
            return method.lineno, f"{name}.{method.name} {wrong}"
    return None


class _File:
    """What a module's top level binds once.

    Attributes:
        known: classes and functions, by name.
    """

    def __init__(self, module: ast.Module) -> None:
        self._bound = Counter(_bound_in(module))
        self.known = {
            each.name: each
            for each in module.body
            if isinstance(each, ast.ClassDef | _Function) and self._bound[each.name] == 1
        }

    def leads_to_no_agent(self, one: ast.ClassDef) -> bool:
        """Whether it has nothing but builtins and classes of this file above it."""
        if one.decorator_list or one.keywords or self._bound["*"]:
            return False
        return all(isinstance(base, ast.Name) and self._is_no_agent(base.id) for base in one.bases)

    def _is_no_agent(self, name: str) -> bool:
        found = self.known.get(name)
        if isinstance(found, ast.ClassDef):
            return self.leads_to_no_agent(found)
        return not self._bound[name] and hasattr(builtins, name)

    def methods_of(self, one: ast.ClassDef) -> Iterator[_Function]:
        """Its own methods, and those of the classes of this file that it derives from, one from the other."""
        seen: set[str] = set()
        above: ast.AST | None = one
        while isinstance(above, ast.ClassDef):
            bound = Counter(name for each in above.body for name in _bound_in(each, below=False))
            yield from (
                each
                for each in above.body
                if isinstance(each, _Function) and each.name not in seen and bound[each.name] == 1
            )
            seen.update(bound)
            bases = above.bases
            above = (
                self.known.get(bases[0].id) if len(bases) == 1 and isinstance(bases[0], ast.Name) else None
            )


def _bound_in(tree: ast.AST, *, below: bool = True) -> Iterator[str]:
    """Names that a tree binds, ``*`` for an import of everything; ``below``: in classes and functions in it, too."""
    nodes = [tree]
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.ClassDef | _Function):
            yield node.name
            if not below:
                continue
        elif isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.alias):
            yield node.asname or node.name.partition(".")[0]
        nodes += ast.iter_child_nodes(node)


def _wrong_with(method: _Function) -> str:
    if isinstance(method, ast.AsyncFunctionDef) and method.name in PLAIN_METHODS:
        return IS_ASYNC
    if method.decorator_list or method.name not in CALLED_WITH:
        return ""
    if method.name == AWAITED and isinstance(method, ast.FunctionDef):
        return IS_PLAIN
    if method.name == AWAITED and _yields(method):
        return IS_GENERATOR
    return wrong_call(_signature_of(method.args), CALLED_WITH[method.name], "self")


def _signature_of(arguments: ast.arguments) -> inspect.Signature:
    """Of a function, without its annotations; what a default is, is left open."""
    positional = [*arguments.posonlyargs, *arguments.args]
    needed, only = len(positional) - len(arguments.defaults), len(arguments.posonlyargs)
    found: list[inspect.Parameter] = []
    for number, arg in enumerate(positional):
        kind = inspect.Parameter.POSITIONAL_ONLY if number < only else inspect.Parameter.POSITIONAL_OR_KEYWORD
        value = inspect.Parameter.empty if number < needed else None
        found.append(inspect.Parameter(arg.arg, kind, default=value))
    if arguments.vararg is not None:
        found.append(inspect.Parameter(arguments.vararg.arg, inspect.Parameter.VAR_POSITIONAL))
    for arg, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True):
        value = inspect.Parameter.empty if default is None else None
        found.append(inspect.Parameter(arg.arg, inspect.Parameter.KEYWORD_ONLY, default=value))
    if arguments.kwarg is not None:
        found.append(inspect.Parameter(arguments.kwarg.arg, inspect.Parameter.VAR_KEYWORD))
    return inspect.Signature(found)


def _yields(function: _Function) -> bool:
    """Whether it has a yield of its own; those of functions within are theirs."""
    nodes: list[ast.AST] = list(function.body)
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.Yield):
            return True
        if not isinstance(node, _Function | ast.Lambda | ast.ClassDef):
            nodes += ast.iter_child_nodes(node)
    return False
