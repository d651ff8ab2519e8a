"""Expressions of max, min, plus and scaling: what a max-min-plus-scaling system is written in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pricing_core.arrays import Vector, as_vector, as_whole_number
from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.scalars import as_number


class Expression:
    """A function of a vector, put together from variables and numbers by +, -, scaling, `largest` and `least`.

    Examples
    --------
    >>> x = variables(2)
    >>> largest(x[0] + 1.0, 2.0 * x[1]).value([3.0, 5.0])
    10.0
    """

    __slots__ = ()

    @property
    def parts(self) -> tuple[Expression, ...]:
        """The expressions that this one is put together from."""
        return ()

    def value(self, x: Vector) -> float:
        """Return the value at x, shape (n,)."""
        return values_of((self,), as_vector("x", x))[0]

    def value_from(self, x: Vector, parts: Sequence[float]) -> float:
        """Return the value at x from those of the `parts`."""
        raise InvalidInputError("expression", Told(type(self).__name__), "of max, min, plus and scaling")

    def __add__(self, other: Expression | float) -> Expression:
        return Sum((self, as_expression(other)), (1.0, 1.0))

    def __sub__(self, other: Expression | float) -> Expression:
        return Sum((self, as_expression(other)), (1.0, -1.0))

    def __mul__(self, factor: float) -> Expression:
        return Sum((self,), (_number("factor", factor),))

    def __neg__(self) -> Expression:
        return self * -1.0

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: float) -> Expression:
        return Sum((as_expression(other), self), (1.0, -1.0))


@dataclass(frozen=True, slots=True)
class Variable(Expression):
    """The component x_i."""

    index: int

    def value_from(self, x: Vector, parts: Sequence[float]) -> float:
        """Return x_i, whatever the parts."""
        if not 0 <= self.index < len(x):
            raise InvalidInputError("x", Told(f"{len(x)} numbers"), f"long enough for variable {self.index}")
        return float(x[self.index])


@dataclass(frozen=True, slots=True)
class Constant(Expression):
    """A finite number."""

    number: float

    def value_from(self, x: Vector, parts: Sequence[float]) -> float:
        """Return the number."""
        return self.number


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sum(Expression):
    """The sum of factors times terms."""

    terms: tuple[Expression, ...]
    factors: tuple[float, ...]

    @property
    def parts(self) -> tuple[Expression, ...]:
        """The terms of the sum."""
        return self.terms

    def value_from(self, x: Vector, parts: Sequence[float]) -> float:
        """Return the sum."""
        return sum(factor * part for part, factor in zip(parts, self.factors, strict=True))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Largest(Expression):
    """The maximum of one or more terms."""

    terms: tuple[Expression, ...]

    @property
    def parts(self) -> tuple[Expression, ...]:
        """The terms of the maximum."""
        return self.terms

    def value_from(self, x: Vector, parts: Sequence[float]) -> float:
        """Return the maximum."""
        return max(parts)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Least(Expression):
    """The minimum of one or more terms."""

    terms: tuple[Expression, ...]

    @property
    def parts(self) -> tuple[Expression, ...]:
        """The terms of the minimum."""
        return self.terms

    def value_from(self, x: Vector, parts: Sequence[float]) -> float:
        """Return the minimum."""
        return min(parts)


def with_parts(expressions: Sequence[Expression]) -> list[Expression]:
    """Return the expressions and all that they are put together from, each once and after its parts.

    Examples
    --------
    >>> x = variables(1)[0]
    >>> len(with_parts([largest(x, x + 1.0)]))
    4
    """
    found: dict[int, Expression] = {}
    waiting = [(one, False) for one in reversed(expressions)]
    while waiting:
        one, opened = waiting.pop()
        if opened:
            found.setdefault(id(one), one)
        elif id(one) not in found:
            waiting.append((one, True))
            waiting += [(part, False) for part in reversed(one.parts)]
    return list(found.values())


def values_of(expressions: Sequence[Expression], x: Vector) -> list[float]:
    """Return the values of several expressions at x; what they share is evaluated once."""
    values: dict[int, float] = {}
    for one in with_parts(expressions):
        values[id(one)] = one.value_from(x, [values[id(part)] for part in one.parts])
    return [values[id(one)] for one in expressions]


def variables(n: int) -> tuple[Variable, ...]:
    """Return the n components of the vector as expressions."""
    return tuple(Variable(i) for i in range(as_whole_number("n", n, 0)))


def largest(*terms: Expression | float) -> Expression:
    """Return the maximum of the `terms`, one or more expressions or numbers."""
    return Largest(_terms(terms))


def least(*terms: Expression | float) -> Expression:
    """Return the minimum of the `terms`, one or more expressions or numbers."""
    return Least(_terms(terms))


def as_expression(value: Expression | float) -> Expression:
    """Return an expression, which a number is as well."""
    return value if isinstance(value, Expression) else Constant(_number("term", value))


def _terms(terms: Sequence[Expression | float]) -> tuple[Expression, ...]:
    if not terms:
        raise InvalidInputError("terms", (), "one or more")
    return tuple(as_expression(term) for term in terms)


def _number(field: str, value: object) -> float:
    try:
        return float(as_number(field, value))
    except InvalidInputError as error:
        raise InvalidInputError(field, error.value, "a finite number or an expression") from None
