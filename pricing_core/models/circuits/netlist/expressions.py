"""Expressions of parameters, evaluated by a parser of their own: numbers, names, arithmetic and a few functions."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from pricing_core.errors import InvalidInputError
from pricing_core.models.circuits.quantity import NUMBER, quantity

LONGEST = 500  # characters
DEEPEST = 30  # brackets inside each other
MOST_BITS = 4000  # of a numerator or denominator
LARGEST_POWER = 64  # up to which powers of fractions are exact

_TOKEN = re.compile(rf"\s*(?:({NUMBER})(?![\w.])|([a-z_]\w*)|(\*\*|[-+*/^(),]))", re.IGNORECASE | re.ASCII)
_FUNCTIONS: dict[str, tuple[int, Callable[..., Fraction | float]]] = {
    "abs": (1, abs),
    "sqrt": (1, math.sqrt),
    "exp": (1, math.exp),
    "ln": (1, math.log),
    "log": (1, math.log),
    "log10": (1, math.log10),
    "sin": (1, math.sin),
    "cos": (1, math.cos),
    "tan": (1, math.tan),
    "atan": (1, math.atan),
    "int": (1, lambda value: Fraction(math.trunc(value))),
    "floor": (1, lambda value: Fraction(math.floor(value))),
    "ceil": (1, lambda value: Fraction(math.ceil(value))),
    "min": (2, min),
    "max": (2, max),
    "pow": (2, math.pow),
}
FORM = (
    "an expression of numbers, parameters, + - * / ** ^, brackets and "
    + ", ".join(_FUNCTIONS)
    + ", with the constant pi"
)


def evaluate(field: str, text: str, lookup: Callable[[str], Fraction | None]) -> Fraction:
    """Return the value of an expression, exact as far as its operations are.

    Parameters
    ----------
    field : str
        What an error message calls it.
    text : str
    lookup : callable
        The value of a parameter by its name in lower case, None where there is none.

    Raises
    ------
    InvalidInputError
        It is no expression, too long, or has no value; it is never run as a program.

    Examples
    --------
    >>> str(evaluate("d", "(1 - duty) * 10u / 2", {"duty": Fraction(2, 5)}.get))
    '3/1000000'
    """
    if len(text) > LONGEST:
        raise InvalidInputError(field, text, f"an expression of at most {LONGEST} characters")
    parser = _Parser(field, text, lookup, _tokens(field, text))
    value = parser.sum(0)
    if parser.place != len(parser.tokens):
        raise parser.fault()
    return value


def _tokens(field: str, text: str) -> list[str]:
    tokens, place = [], 0
    stripped = text.rstrip()
    while place < len(stripped):
        match = _TOKEN.match(stripped, place)
        if match is None:
            raise InvalidInputError(field, text, FORM)
        tokens.append(match[0].strip())
        place = match.end()
    return tokens


@dataclass(slots=True)
class _Parser:
    """Recursive descent: sum of products of signed powers of atoms."""

    field: str
    text: str
    lookup: Callable[[str], Fraction | None]
    tokens: list[str]
    place: int = 0

    def fault(self, allowed: str = FORM) -> InvalidInputError:
        return InvalidInputError(self.field, self.text, allowed)

    def next_is(self, *tokens: str) -> bool:
        return self.place < len(self.tokens) and self.tokens[self.place] in tokens

    def take(self) -> str:
        if self.place == len(self.tokens):
            raise self.fault()
        self.place += 1
        return self.tokens[self.place - 1]

    def sum(self, depth: int) -> Fraction:
        if depth > DEEPEST:
            raise self.fault(f"an expression of at most {DEEPEST} brackets inside each other")
        value = self.product(depth)
        while self.next_is("+", "-"):
            sign = 1 if self.take() == "+" else -1
            value = self.checked(value + sign * self.product(depth))
        return value

    def product(self, depth: int) -> Fraction:
        value = self.signed(depth)
        while self.next_is("*", "/"):
            if self.take() == "*":
                value = self.checked(value * self.signed(depth))
            else:
                divisor = self.signed(depth)
                if divisor == 0:
                    raise self.fault("an expression that does not divide by zero")
                value = self.checked(value / divisor)
        return value

    def signed(self, depth: int) -> Fraction:
        if self.next_is("+", "-"):
            if depth > DEEPEST:
                raise self.fault(f"an expression of at most {DEEPEST} signs in a row")
            sign = 1 if self.take() == "+" else -1
            return sign * self.signed(depth + 1)
        base = self.atom(depth)
        if self.next_is("**", "^"):
            self.take()
            return self.called(_power, base, self.signed(depth + 1))
        return base

    def atom(self, depth: int) -> Fraction:
        token = self.take()
        if token == "(":
            value = self.sum(depth + 1)
            self.expect(")")
            return value
        if token[0].isdigit() or token[0] == ".":
            return quantity(self.field, token)
        if not (token[0].isalpha() or token[0] == "_"):
            raise self.fault()
        return self.function(token.lower(), depth) if self.next_is("(") else self.name(token.lower())

    def function(self, name: str, depth: int) -> Fraction:
        if name not in _FUNCTIONS:
            raise self.fault(FORM)
        self.take()
        count, function = _FUNCTIONS[name]
        arguments = [self.sum(depth + 1)]
        while self.next_is(","):
            self.take()
            arguments.append(self.sum(depth + 1))
        self.expect(")")
        if len(arguments) != count:
            raise self.fault(f"an expression with {count} arguments of {name}")
        return self.called(function, *arguments)

    def name(self, name: str) -> Fraction:
        value = self.lookup(name)
        if value is None and name == "pi":
            return as_fraction(math.pi)
        if value is None:
            raise self.fault(f"an expression of known parameters: there is no {name}")
        return value

    def called(self, function: Callable[..., Fraction | float], *arguments: Fraction) -> Fraction:
        try:
            value = function(*arguments)
            if isinstance(value, float) and not math.isfinite(value):
                raise OverflowError
            return self.checked(as_fraction(value))
        except (ValueError, OverflowError, ZeroDivisionError, TypeError):
            raise self.fault("an expression that has a finite real value") from None

    def checked(self, value: Fraction) -> Fraction:
        if max(value.numerator.bit_length(), value.denominator.bit_length()) > MOST_BITS:
            raise self.fault(f"an expression whose numbers have fewer than {MOST_BITS} binary digits")
        return value

    def expect(self, token: str) -> None:
        if not self.next_is(token):
            raise self.fault()
        self.place += 1


def _power(base: Fraction, exponent: Fraction) -> Fraction | float:
    if exponent.denominator == 1 and abs(exponent) <= LARGEST_POWER:
        return base**exponent.numerator
    return math.pow(base, exponent)


def as_fraction(value: Fraction | float) -> Fraction:
    """Return a fraction; a float stands for its shortest decimal number."""
    return value if isinstance(value, Fraction) else Fraction(repr(float(value)))
