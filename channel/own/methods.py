"""What the methods of a user's model give is looked at: on a few links before anything flies, and at each call."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from types import new_class
from typing import Any, Final, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel.checks import ChannelInputError, FloatArray
from channel.variant import Variant
from sitl_configs.own_code import told

LARGEST: Final = sys.float_info.max
ROUNDING: Final = 1e-9
"""By which a number may be beyond its bounds: of a sum of shares that are together 1."""


class OwnModelError(ValueError):
    """A user's model raises, or gives what no model may give; the text has its class, and what it was given."""


class Method(Protocol):
    """What a method of a kind of model has to do."""

    def check(self, called: str, found: Any, given: tuple[Any, ...]) -> Any:
        """Return what it gave, numbers as float64.

        Args:
            called: the method, with its class.
            found: what it gave.
            given: its arguments.

        Raises:
            OwnModelError: that may not be.
        """

    def tried(self, called: str, call: Callable[..., Any]) -> None:
        """Call it before anything flies.

        Raises:
            OwnModelError: it raises, or gives what may not be.
        """


@dataclass(frozen=True, slots=True)
class Numbers:
    """A method that gives numbers, one for each element of what it is given.

    Attributes:
        trial: arguments for a few links.
        at: what these elements are.
        elements: they themselves, by the arguments; the shape of what is given is theirs.
        low, high: the numbers are from here to there.
        of_vectors: whether an element is a vector, whose components are the last axis; one number for all will do then.
        hint: what an author may want to know.
    """

    trial: tuple[Any, ...]
    at: str
    elements: Callable[..., ArrayLike]
    low: float = -LARGEST
    high: float = LARGEST
    of_vectors: bool = False
    hint: str = ""

    def check(self, called: str, found: Any, given: tuple[Any, ...]) -> Any:
        """Return what it gave as float64; as it is if its model calls it with other arguments."""
        if len(given) != len(self.trial):
            return found
        elements = np.asarray(self.elements(*given))
        shape = self._shape(elements)
        try:
            numbers = real_numbers(found)
            if numbers.shape != shape:
                shape = np.broadcast_shapes(numbers.shape, shape)
        except (TypeError, ValueError):
            is_array = isinstance(found, np.ndarray)
            what = f"an array of {found.dtype} of shape {found.shape}" if is_array else repr(found)
            raise OwnModelError(f"{called} gave {what} for {shape} of {self.at}") from None
        low, high = self.low - ROUNDING, self.high + ROUNDING
        if not numbers.size or (numbers.min() >= low and numbers.max() <= high):
            return numbers[()]
        numbers = np.broadcast_to(numbers, shape)
        elements = np.broadcast_to(elements, (*shape, *elements.shape[-1:]) if self.of_vectors else shape)
        place = tuple(np.argwhere(~((numbers >= low) & (numbers <= high)))[0])
        where = elements[place] if self.of_vectors else f"{elements[place]:.12g}"
        raise OwnModelError(
            f"{called} gave {numbers[place]:.12g} at {self.at} {where}: has to be {self._allowed}"
        )

    def tried(self, called: str, call: Callable[..., Any]) -> None:
        """Call it for a few links, twice."""
        try:
            first, second = (call(*self.trial) for _ in range(2))
        except OwnModelError as error:
            raise OwnModelError(f"{error}{'' if error.__cause__ is None else self.hint}") from error.__cause__
        shape = self._shape(np.asarray(self.elements(*self.trial)))
        if np.shape(first) != shape and not (self.of_vectors and np.shape(first) == ()):
            raise OwnModelError(
                f"{called} gave {np.shape(first) or 'one number'} for {shape} of {self.at}: has to give an array, a "
                "number for each"
            )
        if not np.array_equal(first, second):
            raise OwnModelError(
                f"{called} gave something else for the same {self.at} the second time: what is random is drawn "
                "elsewhere"
            )

    def _shape(self, elements: NDArray[Any]) -> tuple[int, ...]:
        shape: tuple[int, ...] = elements.shape
        return shape[:-1] if self.of_vectors else shape

    @property
    def _allowed(self) -> str:
        if self.high < LARGEST:
            return f"from {self.low:g} to {self.high:g}"
        return (
            "a number"
            if self.low < -LARGEST
            else "finite"
            if self.low == -LARGEST
            else f"{self.low:g} at least"
        )


@dataclass(frozen=True, slots=True)
class Made:
    """A method that makes something: it is not tried."""

    of: type

    def check(self, called: str, found: Any, given: tuple[Any, ...]) -> Any:
        """Return what it gave."""
        del given
        if not isinstance(found, self.of):
            raise OwnModelError(f"{called} gave {found!r}: has to give a subclass of {self.of.__name__}")
        return found

    def tried(self, called: str, call: Callable[..., Any]) -> None:
        """Do nothing."""


def real_numbers(found: Any) -> FloatArray:
    """Return numbers of any real type, or a list of them, as float64; masked ones as nan.

    Raises:
        TypeError, ValueError: they are anything else.
    """
    if np.asarray(found).dtype.kind not in "fiubO":
        raise TypeError(found)
    if isinstance(found, np.ma.MaskedArray):
        found = np.where(np.ma.getmaskarray(found), np.nan, found.data)
    return np.asarray(found, dtype=np.float64)


def _to_read(given: Any) -> Any:
    """Return an array, or those of a named tuple, so that nobody can write to it."""
    if isinstance(given, np.ndarray):
        given = given.view()
        given.flags.writeable = False
    return type(given)(*map(_to_read, given)) if hasattr(given, "_fields") else given


def _field(name: str, model: Variant) -> Any:
    return model.__dict__[name]


def looked_at(
    found: type[Variant], label: str, base: type[Variant], methods: Mapping[str, Method]
) -> type[Variant]:
    """Return a model's class with what it lacks of a base, where what some of its methods give is looked at.

    They raise `OwnModelError`, but for `ChannelInputError`, by which a model says for what it does not hold. What they
    are given is to be read only: others use it, too.
    """

    def watched(name: str, method: Method) -> Callable[..., Any]:
        called = f"{label}.{name}"

        def call(self: Variant, *given: Any, **named: Any) -> Any:
            try:
                result = getattr(super(made, self), name)(*map(_to_read, given), **named)
            except (ChannelInputError, OwnModelError):
                raise
            except Exception as error:
                raise OwnModelError(f"{called}: {told(error)}") from error
            return result if named else method.check(called, result, given)  # with names its model calls it

        return call

    lacks = {
        name: default
        for name, default in vars(base).items()
        if not (name.startswith("_") or hasattr(found, name) or name in found.model_fields)
    }
    own = {"__module__": found.__module__, "__qualname__": found.__qualname__, "__doc__": found.__doc__}
    calls = {name: watched(name, method) for name, method in methods.items() if hasattr(found, name)}
    # a base has something under the name of a field, which would be its default, and as a property hide it
    hidden = {name: field for name, field in found.model_fields.items() if hasattr(found, name)}
    fields = {"__annotations__": {name: field.annotation for name, field in hidden.items()}, **hidden}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Field name", UserWarning)  # its author was told as it was loaded
        bases, body = (found,), own | calls | fields
        made = cast(type[Variant], new_class(found.__name__, bases, {}, lambda names: names.update(body)))
    for name, default in lacks.items():
        setattr(made, name, default)
    for name in hidden:
        setattr(made, name, property(partial(_field, name)))
    return made


def tried(
    model: Variant,
    label: str,
    methods: Mapping[str, Method],
    trial: Callable[[Any, str], None] | None = None,
) -> None:
    """Try the methods of a model, and what else it has to do; what it says it does not hold for is not tried.

    Raises:
        OwnModelError: one of them raises, or gives what may not be.
    """
    with np.errstate(all="ignore"), suppress(ChannelInputError):
        for name, method in methods.items():
            if hasattr(model, name):
                method.tried(f"{label}.{name}", getattr(model, name))
        if trial is not None:
            trial(model, label)
