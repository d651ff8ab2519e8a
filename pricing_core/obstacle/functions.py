"""Numbers, or functions of place and time, as a problem is stated with them: read once, and checked at every value."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Vector, as_number
from pricing_core.errors import InvalidInputError, PricingCoreError, Told

Given: TypeAlias = float | Callable[..., ArrayLike]


@dataclass(frozen=True, slots=True, eq=False)
class Function:
    """A number or a function of x (n,), or of x and t, that has been given under a name.

    Parameters
    ----------
    name : str
        How messages call it.
    given : float or callable
    has_x, has_t : bool
        On what it depends.
    """

    name: str
    given: Any
    has_x: bool
    has_t: bool

    def __call__(self, x: Vector, t: float) -> Vector:
        """Return the values at the places x, shape (n,), and at the time t.

        Raises
        ------
        InvalidInputError
            A value is not finite, or there is not one value for each place.
        """
        if not callable(self.given):
            return np.full(x.shape, self.given)
        arguments = [x] * self.has_x + [t] * self.has_t
        try:
            found = np.asarray(self.given(*arguments))
            if found.dtype.kind == "c":
                raise TypeError("a complex number")
            values = np.broadcast_to(np.asarray(found, dtype=np.float64), x.shape)
        except PricingCoreError:  # of a function that is made of others
            raise
        except Exception as error:
            told = Told(f"{type(error).__name__} at t = {t:g} ({error})")
            raise InvalidInputError(self.name, told, "a function with a number for each x") from error
        wrong = ~np.isfinite(values)
        if wrong.any():
            first = int(np.argmax(wrong))
            place = Told(f"{values.flat[first]} at x = {x.flat[first]:.6g}, t = {t:.6g}")
            raise InvalidInputError(self.name, place, "finite at every x and t")
        return values


def read_function(name: str, given: Given, *, always: tuple[str, ...] = ("x", "t")) -> Function:
    """Read a number or a function.

    Parameters
    ----------
    always : tuple of str
        The arguments of a function: ("x", "t"), of which the second may be left out, or ("t",).

    Raises
    ------
    InvalidInputError
        It is neither a finite number nor a function of these arguments.
    """
    if not callable(given):
        return Function(name, as_number(name, given), False, False)
    count = _arguments(given, len(always))
    if not 1 <= count <= len(always):
        raise InvalidInputError(name, Told(f"a function of {count} arguments"), f"f({', '.join(always)})")
    named = always[:count]
    return Function(name, given, "x" in named, "t" in named)


def _arguments(function: Callable[..., Any], most: int) -> int:
    """Return how many positional arguments a function needs, or takes at most where it says so."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # of NumPy, which says nothing
        return 1
    if any(parameter.kind is parameter.VAR_POSITIONAL for parameter in parameters):
        return most
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    return sum(p.default is p.empty for p in positional)
