"""Expressions of max, min, plus and scaling: what a max-min-plus-scaling system is written in."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError


class Expression:
    """A function of a vector, put together from variables and numbers by +, -, scaling, `largest` and `least`.

    Examples
    --------
    >>> x = variables(2)
    >>> largest(x[0] + 1.0, 2.0 * x[1]).value(np.array([3.0, 5.0]))
    10.0
    """

    __slots__ = ()

    def value(self, x: Vector) -> float:
        """Return the value at x, shape (n,)."""
        raise NotImplementedError

    def __add__(self, other: "Expression | float") -> "Expression":
        return Sum((self, as_expression(other)), (1.0, 1.0))

    def __sub__(self, other: "Expression | float") -> "Expression":
        return Sum((self, as_expression(other)), (1.0, -1.0))

    def __mul__(self, factor: float) -> "Expression":
        return Sum((self,), (_number("factor", factor),))

    def __neg__(self) -> "Expression":
        return self * -1.0

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: float) -> "Expression":
        return Sum((as_expression(other), self), (1.0, -1.0))


@dataclass(frozen=True, slots=True)
class Variable(Expression):
    """The component x_i."""

    index: int

    def value(self, x: Vector) -> float:
        """Return x_i."""
        return float(x[self.index])


@dataclass(frozen=True, slots=True)
class Constant(Expression):
    """A finite number."""

    number: float

    def value(self, x: Vector) -> float:
        """Return the number."""
        return self.number


@dataclass(frozen=True, slots=True)
class Sum(Expression):
    """The sum of factors times terms."""

    terms: tuple[Expression, ...]
    factors: tuple[float, ...]

    def value(self, x: Vector) -> float:
        """Return the sum at x."""
        return sum(factor * term.value(x) for term, factor in zip(self.terms, self.factors, strict=True))


@dataclass(frozen=True, slots=True)
class Largest(Expression):
    """The maximum of one or more terms."""

    terms: tuple[Expression, ...]

    def value(self, x: Vector) -> float:
        """Return the maximum at x."""
        return max(term.value(x) for term in self.terms)


@dataclass(frozen=True, slots=True)
class Least(Expression):
    """The minimum of one or more terms."""

    terms: tuple[Expression, ...]

    def value(self, x: Vector) -> float:
        """Return the minimum at x."""
        return min(term.value(x) for term in self.terms)


def variables(n: int) -> tuple[Variable, ...]:
    """Return the n components of the vector as expressions."""
    return tuple(Variable(i) for i in range(n))


def largest(*terms: Expression | float) -> Expression:
    """Return the maximum of one or more expressions or numbers."""
    return Largest(_terms(terms))


def least(*terms: Expression | float) -> Expression:
    """Return the minimum of one or more expressions or numbers."""
    return Least(_terms(terms))


def as_expression(value: Expression | float) -> Expression:
    """Return an expression, which a number is as well."""
    return value if isinstance(value, Expression) else Constant(_number("term", value))


def _terms(terms: Sequence[Expression | float]) -> tuple[Expression, ...]:
    if not terms:
        raise InvalidInputError("terms", (), "one or more")
    return tuple(as_expression(term) for term in terms)


def _number(field: str, value: object) -> float:
    if not isinstance(value, float | int | np.floating | np.integer) or not np.isfinite(value):
        raise InvalidInputError(field, value, "a finite number or an expression")
    return float(value)
